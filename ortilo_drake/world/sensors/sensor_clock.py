"""A sensor whose clock differs from the onboard computer's: at t_k it stamps what it measured at t_k - delta.

    delta(t) = offset + drift t,   x(t - delta) = x(t) - delta [v_WB, Euler rates, 0, 0],

where position and attitude go back along the velocities of the tick. The neglected part is a delta^2 / 2 of the
position, 0.01 mm for 1 m/s^2 and 5 ms, and a delta of the velocities. A late sensor has a positive delta. A negative
delta would need future measurements; it acts as if the onboard computer, and all else, were that much later.
"""

from typing import Any

import numpy as np

from ortilo_drake.loop.element import Box, Element, Values
from ortilo_drake.model.placing import put
from ortilo_drake.model.signals import N_X
from ortilo_drake.world.vehicle.continuous import PASSED


def delayed_state_out(n: Any, k: int, state: np.ndarray, out: np.ndarray) -> None:
    """Output the state (12) as a sensor with a clock error sees it."""
    put(state, out)
    delta = n.offset + n.drift * (k * n.h)
    for i in range(6):
        out[i] -= delta * state[6 + i]


def delayed_passed_out(n: Any, k: int, passed: np.ndarray, instants: np.ndarray, out: np.ndarray) -> None:
    """Output what has `passed` inside the last tick, with the states as a sensor with a clock error sees them."""
    put(passed, out)
    for i in range(instants.size):
        at, delta = i * PASSED, n.offset + n.drift * ((k - 1 + instants[i]) * n.h)
        for j in range(6):
            out[at + j] -= delta * passed[at + 6 + j]


CLOCK = Element("sensor_clock", out=delayed_state_out)
CLOCK_INSIDE = Element("sensor_clock_inside", out=delayed_passed_out)


def clock_box(sensor: str, h: float) -> Box:
    """Return the box of the true state at the time of a sensor's clock, which has no error unless it is drawn."""
    return Box(f"{sensor}_clock", CLOCK, N_X, Values({"offset": 0.0, "drift": 0.0, "h": h}))


def clock_inside_box(sensor: str, instants: np.ndarray, h: float) -> Box:
    """Return the box of what has `passed` inside the last tick at these instants, at the time of a sensor's clock."""
    given = Values({"offset": 0.0, "drift": 0.0, "h": h}, tables={"instants": instants})
    return Box(f"{sensor}_clock_inside", CLOCK_INSIDE, instants.size * PASSED, given)
