"""A sensor whose clock is not the onboard computer's: what it stamps t_k it saw at t_k - delta.

    delta(t) = offset + drift t,   x(t - delta) = x(t) - delta [v_WB, Euler rates, 0, 0],

position and attitude going back along the velocities of the tick; what is left out is a delta^2 / 2, 0.01 mm for 1
m/s^2 and 5 ms, and of the velocities a delta. A sensor that is late is one of positive delta. Of negative delta it
shows what is yet to come: as if the onboard computer, and all else, were that much later than their ticks.
"""

import sys
from typing import Any

import numpy as np
from numba import njit
from numba.extending import register_jitable
from pydrake.autodiffutils import AutoDiffXd
from pydrake.systems.framework import BasicVector_, LeafSystem_
from pydrake.systems.scalar_conversion import TemplateSystem

from ortilo_drake.loop.element import Box, Element, Given, Number
from ortilo_drake.model.placing import put
from ortilo_drake.model.signals import N_X


@register_jitable
def take_back(before: np.ndarray, x: np.ndarray, delta: float) -> None:
    """Change x (12), written to `before`, to what it was delta [s] before."""
    for i in range(6):
        before[i] -= delta * x[6 + i]


@njit(cache=True)
def state_before(x: np.ndarray, delta: float) -> np.ndarray:
    """Return x (12) as it was delta [s] before, its velocities as they are."""
    before = x.copy()
    take_back(before, x, delta)
    return before


def seen_out(n: Any, k: int, state: np.ndarray, out: np.ndarray) -> None:
    """Say the state (12) as a sensor sees it whose clock is off."""
    put(state, out)
    take_back(out, state, n.offset + n.drift * (k * n.h))


CLOCK = Element("sensor_clock", out=seen_out, numbers=(Number("offset"), Number("drift"), Number("h")))


def clock_box(sensor: str, h: float) -> Box:
    """Return what says the true state as a sensor sees it, whose clock is right unless it is drawn."""
    return Box(f"{sensor}_clock", CLOCK, N_X, Given({"offset": 0.0, "drift": 0.0, "h": h}))


# Without a scope Drake reads the sources of all frames to find it.
@TemplateSystem.define("SensorClock_", T_list=[float, AutoDiffXd], scope=sys.modules[__name__])
def SensorClock_(T: type) -> type:
    """Return the system for a scalar type: float or AutoDiffXd."""

    class Impl(LeafSystem_[T]):
        """The state as a sensor sees it whose clock is off.

        Ports:
            state (12): x of the vehicle.
            seen (12, output): x(t - delta).

        Parameters of the Context:
            clock (2): offset [s] and drift [1], 0 by default.

        Args:
            name: of the system.
        """

        def _construct(self, name: str, converter: Any = None) -> None:
            LeafSystem_[T].__init__(self, converter=converter)
            self.set_name(name)
            self._before = state_before if T is float else state_before.py_func
            self._clock = self.DeclareNumericParameter(BasicVector_[T](np.zeros(2)))
            self._state = self.DeclareVectorInputPort("state", N_X)
            needs = {self._state.ticket(), self.time_ticket(), self.all_parameters_ticket()}
            self.DeclareVectorOutputPort("seen", N_X, self._calc_seen, prerequisites_of_calc=needs)

        def _construct_copy(self, other: Any, converter: Any = None) -> None:
            Impl._construct(self, other.get_name(), converter=converter)

        def set_clock_in(self, context: Any, offset: float, drift: float) -> None:
            """Set offset [s] and drift [1] in a context of this system."""
            context.get_mutable_numeric_parameter(self._clock).SetFromVector([offset, drift])

        def _calc_seen(self, context: Any, output: Any) -> None:
            offset, drift = context.get_numeric_parameter(self._clock).CopyToVector()
            output.set_value(self._before(self._state.Eval(context), offset + drift * context.get_time()))

    return Impl
