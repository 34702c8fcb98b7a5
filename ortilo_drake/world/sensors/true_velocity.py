"""The true velocities as a message, for the scenarios that lend them to the servo as the authors did."""

import sys
from typing import Any

import numpy as np
from pydrake.autodiffutils import AutoDiffXd
from pydrake.systems.framework import LeafSystem_
from pydrake.systems.scalar_conversion import TemplateSystem

from ortilo_drake.model.scalars import time_in
from ortilo_drake.model.signals import N_X, VELOCITY_SIZE


# Without a scope Drake reads the sources of all frames to find it.
@TemplateSystem.define("TrueVelocity_", T_list=[float, AutoDiffXd], scope=sys.modules[__name__])
def TrueVelocity_(T: type) -> type:
    """Return the sensor for a scalar type: float or AutoDiffXd."""

    class Impl(LeafSystem_[T]):
        """Sends v_WB and the Euler rates, without noise or loss.

        Ports:
            state (12): x of the vehicle.
            velocity (8, output): the velocity message, see model/signals.py.
        """

        def _construct(self, converter: Any = None) -> None:
            LeafSystem_[T].__init__(self, converter=converter)
            self.set_name("true_velocity")
            self._state = self.DeclareVectorInputPort("state", N_X)
            needs = {self._state.ticket(), self.time_ticket()}
            self.DeclareVectorOutputPort("velocity", VELOCITY_SIZE, self._calc_velocity, prerequisites_of_calc=needs)

        def _construct_copy(self, other: Any, converter: Any = None) -> None:
            Impl._construct(self, converter=converter)

        def _calc_velocity(self, context: Any, output: Any) -> None:
            x = self._state.Eval(context)
            output.set_value(np.concatenate(([1.0, time_in(context)], x[6:12])))

    return Impl
