"""Four rotors between the commanded and the actual wrench."""

import numpy as np
from numba import njit
from pydrake.systems.framework import BasicVector, Context, ContinuousState, LeafSystem

from ortilo_drake.model.signals import N_U
from ortilo_drake.model.vehicle import Vehicle


def mixing_matrix(vehicle: Vehicle) -> np.ndarray:
    """Return M (4 x 4) with u = M [W_1^2 ... W_4^2], W_i the rotor speeds [rad/s].

    X configuration: rotors 1 to 4 stand front left, front right, rear right, rear left, each at 45 degrees from
    B's axes; 1 and 3 turn clockwise seen from above, so that their drag turns the body the other way (+tau_z).
    """
    k, c, a = vehicle.rotor_lift, vehicle.rotor_drag, vehicle.arm_length / np.sqrt(2.0)
    return np.array(
        [
            [k, k, k, k],
            [k * a, -k * a, -k * a, k * a],
            [-k * a, -k * a, k * a, k * a],
            [c, -c, c, -c],
        ]
    )


@njit(cache=True)
def commanded_speeds(u: np.ndarray, M_inverse: np.ndarray, max_speed: float) -> np.ndarray:
    """Return the rotor speeds that make u, each limited to [0, max_speed] [rad/s]."""
    squared = np.zeros(4)
    for i in range(4):
        for j in range(4):
            squared[i] += M_inverse[i, j] * u[j]
    return np.minimum(np.sqrt(np.maximum(squared, 0.0)), max_speed)


@njit(cache=True)
def rotor_acceleration(speeds: np.ndarray, commanded: np.ndarray, time_constant: np.ndarray) -> np.ndarray:
    """Return the first-order lag (commanded - speed) / tau, tau by whether the rotor speeds up or slows down."""
    error = commanded - speeds
    return error / np.where(error >= 0.0, time_constant[0], time_constant[1])


@njit(cache=True)
def wrench_of(speeds: np.ndarray, M: np.ndarray) -> np.ndarray:
    """Return u = M [W_1^2 ... W_4^2]."""
    u = np.zeros(4)
    for i in range(4):
        for j in range(4):
            u[i] += M[i, j] * speeds[j] ** 2
    return u


class Rotors(LeafSystem):
    """Mixing to four rotor speeds, their limits and a first-order lag.

    Ports:
        control (4): the commanded u.
        wrench (4, output): u as the rotors make it; depends on the state alone.

    Continuous state: the four rotor speeds [rad/s], at hover in the default context. The lag is stiff beside the
    control period (tau = 12.5 ms): simulate with steps of at most 10 ms.
    """

    def __init__(self, vehicle: Vehicle):
        super().__init__()
        self.set_name("rotors")
        self._M = mixing_matrix(vehicle)
        self._M_inverse = np.linalg.inv(self._M)
        self._max_speed = vehicle.rotor_max_speed
        self._time_constant = np.array(vehicle.rotor_time_constant)
        self._control = self.DeclareVectorInputPort("control", N_U)
        hover = BasicVector(np.full(4, vehicle.hover_rotor_speed))
        self.DeclareContinuousState(hover)
        self.DeclareVectorOutputPort("wrench", N_U, self._calc_wrench, prerequisites_of_calc={self.xc_ticket()})

    def DoCalcTimeDerivatives(self, context: Context, derivatives: ContinuousState) -> None:
        """Write the four accelerations (Drake's hook)."""
        speeds = context.get_continuous_state_vector().CopyToVector()
        commanded = commanded_speeds(self._control.Eval(context), self._M_inverse, self._max_speed)
        derivatives.SetFromVector(rotor_acceleration(speeds, commanded, self._time_constant))

    def _calc_wrench(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(wrench_of(context.get_continuous_state_vector().CopyToVector(), self._M))
