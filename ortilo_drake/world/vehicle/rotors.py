"""Four rotors between the commanded and the actual wrench.

The functions are compiled by numba for floats; their ``.py_func`` is the same source as plain Python and runs on arrays
of Drake's AutoDiffXd. The limits and the two time constants are not smooth: where a rotor's speed is the commanded one,
the lag has a derivative to either side only, and AutoDiff takes the side on which rounding leaves the error. See
studies/linearization/operating_point.py.
"""

import sys
from typing import Any

import numpy as np
from numba import njit
from numba.extending import register_jitable
from pydrake.autodiffutils import AutoDiffXd
from pydrake.systems.framework import BasicVector_, LeafSystem_
from pydrake.systems.scalar_conversion import TemplateSystem

from ortilo_drake.model.signals import N_U
from ortilo_drake.model.vehicle import M100, Vehicle


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


@register_jitable
def times(M: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return M v for M (4 x 4), summed from the left; of any scalar."""
    return np.array([M[i, 0] * v[0] + M[i, 1] * v[1] + M[i, 2] * v[2] + M[i, 3] * v[3] for i in range(4)])


@njit(cache=True)
def commanded_speeds(u: np.ndarray, M_inverse: np.ndarray, max_speed: float) -> np.ndarray:
    """Return the rotor speeds that make u, each limited to [0, max_speed] [rad/s]."""
    squared = times(M_inverse, u)
    nothing = squared - squared  # 0 of the same scalar, whose root AutoDiff can take
    return np.minimum(np.sqrt(np.maximum(squared, nothing)), max_speed)


@njit(cache=True)
def rotor_acceleration(speeds: np.ndarray, commanded: np.ndarray, time_constant: np.ndarray) -> np.ndarray:
    """Return the first-order lag (commanded - speed) / tau, tau by whether the rotor speeds up or slows down."""
    error = commanded - speeds
    return error / np.where(error >= 0.0, time_constant[0], time_constant[1])


@njit(cache=True)
def wrench_of(speeds: np.ndarray, M: np.ndarray) -> np.ndarray:
    """Return u = M [W_1^2 ... W_4^2]."""
    return times(M, speeds**2)


_M, _M_INVERSE, _MAX_SPEED, _TIME_CONSTANT = slice(0, 16), slice(16, 32), 32, slice(33, 35)


def _rotors_of(vehicle: Vehicle) -> np.ndarray:
    M = mixing_matrix(vehicle)
    return np.concatenate((M.ravel(), np.linalg.inv(M).ravel(), [vehicle.rotor_max_speed], vehicle.rotor_time_constant))


# Without a scope Drake reads the sources of all frames to find it.
@TemplateSystem.define("Rotors_", T_list=[float, AutoDiffXd], scope=sys.modules[__name__])
def Rotors_(T: type) -> type:
    """Return the rotors for a scalar type: float or AutoDiffXd."""

    class Impl(LeafSystem_[T]):
        """Mixing to four rotor speeds, their limits and a first-order lag.

        Ports:
            control (4): the commanded u.
            wrench (4, output): u as the rotors make it; depends on the state alone.

        Continuous state: the four rotor speeds [rad/s], at hover in the default context. The lag is stiff beside the
        control period (tau = 12.5 ms): simulate with steps of at most 10 ms.

        Parameters of the Context:
            rotors (35): M row by row (16), M^-1 row by row (16), largest speed [rad/s], time constants of a rotor
                speeding up and slowing down [s]; the vehicle's by default.
        """

        def _construct(self, vehicle: Vehicle = M100, converter: Any = None) -> None:
            LeafSystem_[T].__init__(self, converter=converter)
            self.set_name("rotors")
            self._vehicle = vehicle
            functions = (commanded_speeds, rotor_acceleration, wrench_of)
            self._commanded_speeds, self._acceleration, self._wrench_of = (
                f if T is float else f.py_func for f in functions
            )
            self._rotors = self.DeclareNumericParameter(BasicVector_[T](_rotors_of(vehicle)))
            self._control = self.DeclareVectorInputPort("control", N_U)
            self.DeclareContinuousState(BasicVector_[T]([T(vehicle.hover_rotor_speed)] * 4))
            needs = {self.xc_ticket(), self.all_parameters_ticket()}
            self.DeclareVectorOutputPort("wrench", N_U, self._calc_wrench, prerequisites_of_calc=needs)

        def _construct_copy(self, other: Any, converter: Any = None) -> None:
            Impl._construct(self, other._vehicle, converter=converter)

        def SetVehicle(self, context: Any, vehicle: Vehicle) -> None:
            """Set the rotors' parameters in a context of this system; their speeds stay."""
            context.get_mutable_numeric_parameter(self._rotors).SetFromVector(_rotors_of(vehicle))

        def DoCalcTimeDerivatives(self, context: Any, derivatives: Any) -> None:
            speeds = context.get_continuous_state_vector().CopyToVector()
            p = context.get_numeric_parameter(self._rotors).CopyToVector()
            commanded = self._commanded_speeds(self._control.Eval(context), p[_M_INVERSE].reshape(4, 4), p[_MAX_SPEED])
            derivatives.SetFromVector(self._acceleration(speeds, commanded, p[_TIME_CONSTANT]))

        def _calc_wrench(self, context: Any, output: Any) -> None:
            M = context.get_numeric_parameter(self._rotors).CopyToVector()[_M].reshape(4, 4)
            output.SetFromVector(self._wrench_of(context.get_continuous_state_vector().CopyToVector(), M))

    return Impl
