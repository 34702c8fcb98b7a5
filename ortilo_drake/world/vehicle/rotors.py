"""Rotors between the commanded and the actual wrench.

The functions are compiled by numba for floats; their ``.py_func`` is the same source as plain Python and runs on arrays
of Drake's AutoDiffXd. The limits and the two time constants are not smooth: where a rotor's speed is the commanded one,
the lag has a derivative to either side only, and AutoDiff takes the side on which rounding leaves the error. See
studies/linearization/operating_point.py.
"""

import sys
from typing import Any

import numpy as np
from numba.extending import register_jitable
from pydrake.autodiffutils import AutoDiffXd
from pydrake.systems.framework import BasicVector_, LeafSystem_
from pydrake.systems.scalar_conversion import TemplateSystem

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.loop.element import Box, Element, Values
from ortilo_drake.model.signals import N_U
from ortilo_drake.model.vehicle import M100, Vehicle, mixing_inverse, mixing_matrix


@register_jitable
def times(M: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return M v, each row summed from the left, for any scalar type."""
    product = M[:, 0] * v[0]
    for j in range(1, M.shape[1]):
        product = product + M[:, j] * v[j]
    return product


@register_jitable
def put_times(product: np.ndarray, M: np.ndarray, v: np.ndarray) -> None:
    """Write M v to product, each row summed from the left as in `times`, without a new array."""
    for i in range(product.size):
        total = M[i, 0] * v[0]
        for j in range(1, v.size):
            total += M[i, j] * v[j]
        product[i] = total


@cached_njit
def commanded_speeds(u: np.ndarray, M_inverse: np.ndarray, max_speed: float) -> np.ndarray:
    """Return the rotor speeds (n) that make u, by M^+ (n x 4), each limited to [0, max_speed] [rad/s]."""
    squared = times(M_inverse, u)
    nothing = squared - squared  # 0 of the same scalar, whose root AutoDiff can take
    return np.minimum(np.sqrt(np.maximum(squared, nothing)), max_speed)


@register_jitable
def put_acceleration(
    acceleration: np.ndarray, speeds: np.ndarray, commanded: np.ndarray, time_constant: np.ndarray
) -> None:
    """Write the first-order lag (commanded - speed) / tau; tau depends on whether the rotor speeds up or slows down."""
    for i in range(speeds.size):
        error = commanded[i] - speeds[i]
        acceleration[i] = error / (time_constant[0] if error >= 0.0 else time_constant[1])


@cached_njit
def rotor_acceleration(speeds: np.ndarray, commanded: np.ndarray, time_constant: np.ndarray) -> np.ndarray:
    """Return the lag of put_acceleration (n)."""
    acceleration = np.empty_like(speeds)
    put_acceleration(acceleration, speeds, commanded, time_constant)
    return acceleration


@cached_njit
def wrench_of(speeds: np.ndarray, M: np.ndarray) -> np.ndarray:
    """Return u = M [W_1^2 ... W_n^2]."""
    return times(M, speeds**2)


def _rotors_of(vehicle: Vehicle) -> np.ndarray:
    M, M_inverse = mixing_matrix(vehicle), mixing_inverse(vehicle)
    return np.concatenate((M.ravel(), M_inverse.ravel(), [vehicle.rotor_max_speed], vehicle.rotor_time_constant))


# Without a scope Drake reads the sources of all frames to find it.
@TemplateSystem.define("Rotors_", T_list=[float, AutoDiffXd], scope=sys.modules[__name__])
def Rotors_(T: type) -> type:
    """Return the rotors for a scalar type: float or AutoDiffXd."""

    class Impl(LeafSystem_[T]):
        """Mixing to the speeds of n rotors, their limits and a first-order lag.

        Ports:
            control (4): the commanded u.
            wrench (4, output): u as the rotors make it; depends on the state alone.

        Continuous state: the rotor speeds (n) [rad/s], at hover in the default context. The lag is stiff beside the
        control period (tau = 12.5 ms): simulate with steps of at most 10 ms.

        Parameters of the Context:
            rotors (8 n + 3): M row by row (4 n), M^+ row by row (4 n), largest speed [rad/s], time constants of a
                rotor speeding up and slowing down [s]; the vehicle's by default.
        """

        def _construct(self, vehicle: Vehicle = M100, converter: Any = None) -> None:
            LeafSystem_[T].__init__(self, converter=converter)
            self.set_name("rotors")
            self._vehicle = vehicle
            functions = (commanded_speeds, rotor_acceleration, wrench_of)
            self._commanded_speeds, self._acceleration, self._wrench_of = (
                f if T is float else f.py_func for f in functions
            )
            n = vehicle.rotor_count
            self._M, self._M_inverse, self._max_speed = slice(0, 4 * n), slice(4 * n, 8 * n), 8 * n
            self._time_constant = slice(8 * n + 1, 8 * n + 3)
            self._rotors = self.DeclareNumericParameter(BasicVector_[T](_rotors_of(vehicle)))
            self._control = self.DeclareVectorInputPort("control", N_U)
            self.DeclareContinuousState(BasicVector_[T]([T(W) for W in vehicle.hover_rotor_speeds]))
            needs = {self.xc_ticket(), self.all_parameters_ticket()}
            self.DeclareVectorOutputPort("wrench", N_U, self._calc_wrench, prerequisites_of_calc=needs)

        def _construct_copy(self, other: Any, converter: Any = None) -> None:
            Impl._construct(self, other._vehicle, converter=converter)

        def SetVehicle(self, context: Any, vehicle: Vehicle) -> None:
            """Set the rotors' parameters in a context of this system; their speeds stay, and their number must."""
            if vehicle.rotor_count != self._vehicle.rotor_count:
                raise ValueError(f"arms: {vehicle.rotor_count} rotors: this world has {self._vehicle.rotor_count}")
            context.get_mutable_numeric_parameter(self._rotors).SetFromVector(_rotors_of(vehicle))

        def DoCalcTimeDerivatives(self, context: Any, derivatives: Any) -> None:
            speeds = context.get_continuous_state_vector().CopyToVector()
            p = context.get_numeric_parameter(self._rotors).CopyToVector()
            M_inverse = p[self._M_inverse].reshape(-1, N_U)
            commanded = self._commanded_speeds(self._control.Eval(context), M_inverse, p[self._max_speed])
            derivatives.SetFromVector(self._acceleration(speeds, commanded, p[self._time_constant]))

        def _calc_wrench(self, context: Any, output: Any) -> None:
            M = context.get_numeric_parameter(self._rotors).CopyToVector()[self._M].reshape(N_U, -1)
            output.SetFromVector(self._wrench_of(context.get_continuous_state_vector().CopyToVector(), M))

    return Impl


def wrench_matrix(thrust_factor: float, center_of_gravity: np.ndarray) -> np.ndarray:
    """Return T (4 x 4), which gives the true control u = T u_c from the command u_c = [f_T, tau_x, tau_y, tau_z].

    If the lift is s (thrust_factor) times the assumed lift, thrust and the torques of roll and pitch grow by s; yaw
    comes from drag. If the centre of gravity is off by r (r_x, r_y in B [m]; an offset along z changes nothing), the
    thrust f e_z adds the torque -r x f e_z.
    """
    r_x, r_y = center_of_gravity
    T = np.diag([thrust_factor, thrust_factor, thrust_factor, 1.0])
    T[1, 0], T[2, 0] = -thrust_factor * r_y, thrust_factor * r_x
    return T


def wrench_out(control: np.ndarray, wrench: np.ndarray, out: np.ndarray) -> None:
    """Output u = T u_c (4)."""
    put_times(out, wrench, control)


def wrench_error_box() -> Box:
    """Return the box of the true wrench of rotors without dynamics; T is the identity unless it is drawn."""
    return Box("wrench_error", Element("wrench_error", out=wrench_out), N_U, Values(tables={"wrench": np.eye(N_U)}))
