"""The wrench that the rotors really make: their lift and the centre of gravity are not what the mixing believes."""

import sys
from typing import Any

import numpy as np
from numba import njit
from pydrake.autodiffutils import AutoDiffXd
from pydrake.systems.framework import BasicVector_, LeafSystem_
from pydrake.systems.scalar_conversion import TemplateSystem

from ortilo_drake.loop.element import Array, Box, Element, Given
from ortilo_drake.model.signals import N_U
from ortilo_drake.world.vehicle.rotors import put_times, times

product = njit(cache=True)(times)


def wrench_matrix(thrust_factor: float, center_of_gravity: np.ndarray) -> np.ndarray:
    """Return T (4 x 4), u = T u_c of a commanded u_c = [f_T, tau_x, tau_y, tau_z].

    Lift that is s times the believed makes thrust and the torques of roll and pitch s times as large; yaw comes from
    drag. A centre of gravity at r from where it is believed to be feels the thrust f e_z turn it by -r x f e_z.

    Args:
        thrust_factor: s [1].
        center_of_gravity: r_x, r_y in B (2) [m]; along z it changes nothing.
    """
    r_x, r_y = center_of_gravity
    T = np.diag([thrust_factor, thrust_factor, thrust_factor, 1.0])
    T[1, 0], T[2, 0] = -thrust_factor * r_y, thrust_factor * r_x
    return T


def wrench_out(control: np.ndarray, wrench: np.ndarray, out: np.ndarray) -> None:
    """Say u = T u_c (4)."""
    put_times(out, wrench, control)


WRENCH = Element("wrench_error", out=wrench_out, tables=(Array("wrench", 2),))


def wrench_error_box() -> Box:
    """Return what says the wrench that rotors without dynamics really make: T is the identity unless it is drawn."""
    return Box("wrench_error", WRENCH, N_U, Given(tables={"wrench": np.eye(N_U)}))


# Without a scope Drake reads the sources of all frames to find it.
@TemplateSystem.define("WrenchError_", T_list=[float, AutoDiffXd], scope=sys.modules[__name__])
def WrenchError_(T: type) -> type:
    """Return the system for a scalar type: float or AutoDiffXd."""

    class Impl(LeafSystem_[T]):
        """Memoryless: u = T u_c.

        Ports:
            commanded (4): u_c, what the mixing believes that it makes.
            wrench (4, output): u as it acts on the body.

        Parameters of the Context:
            T (16): row by row; the identity by default.
        """

        def _construct(self, converter: Any = None) -> None:
            LeafSystem_[T].__init__(self, converter=converter)
            self.set_name("wrench_error")
            self._times = product if T is float else times
            self._T = self.DeclareNumericParameter(BasicVector_[T](np.eye(N_U).ravel()))
            self._commanded = self.DeclareVectorInputPort("commanded", N_U)
            needs = {self._commanded.ticket(), self.all_parameters_ticket()}
            self.DeclareVectorOutputPort("wrench", N_U, self._calc_wrench, prerequisites_of_calc=needs)

        def _construct_copy(self, other: Any, converter: Any = None) -> None:
            Impl._construct(self, converter=converter)

        def set_wrench_in(self, context: Any, matrix: np.ndarray) -> None:
            """Set T (4 x 4) in a context of this system."""
            context.get_mutable_numeric_parameter(self._T).SetFromVector(matrix.ravel())

        def _calc_wrench(self, context: Any, output: Any) -> None:
            matrix = context.get_numeric_parameter(self._T).CopyToVector().reshape(N_U, N_U)
            output.set_value(self._times(matrix, self._commanded.Eval(context)))

    return Impl
