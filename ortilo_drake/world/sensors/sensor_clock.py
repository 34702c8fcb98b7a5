"""A sensor whose clock is not the onboard computer's: it stamps t_k what it measured at t_k - delta.

    delta(t) = offset + drift t,   x(t - delta) = x(t) - delta [v_WB, Euler rates, 0, 0],

position and attitude going back along the velocities of the tick; what is left out is a delta^2 / 2, 0.01 mm for 1
m/s^2 and 5 ms, and of the velocities a delta. A late sensor has a positive delta. A negative delta needs future
measurements: as if the onboard computer, and all else, were that much later than their ticks.
"""

from typing import Any

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.loop.element import Box, Element, Values
from ortilo_drake.model.placing import put
from ortilo_drake.model.signals import N_X


@register_jitable
def put_earlier_state(before: np.ndarray, x: np.ndarray, delta: float) -> None:
    """Change `before`, a copy of the state x (12), to the state delta [s] earlier."""
    for i in range(6):
        before[i] -= delta * x[6 + i]


def delayed_state_out(n: Any, k: int, state: np.ndarray, out: np.ndarray) -> None:
    """Output the state (12) as a sensor sees it whose clock is off."""
    put(state, out)
    put_earlier_state(out, state, n.offset + n.drift * (k * n.h))


CLOCK = Element("sensor_clock", out=delayed_state_out)


def clock_box(sensor: str, h: float) -> Box:
    """Return the box of the true state at the time of a sensor's clock, which is right unless its error is drawn."""
    return Box(f"{sensor}_clock", CLOCK, N_X, Values({"offset": 0.0, "drift": 0.0, "h": h}))
