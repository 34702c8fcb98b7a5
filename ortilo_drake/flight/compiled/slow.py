"""Errors that last, in a compiled flight: see world/slow_error.py and world/sensors/message_error.py."""

from typing import NamedTuple

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.model.placing import put
from ortilo_drake.world.sensors.message_error import message_with_error
from ortilo_drake.world.sensors.sensor_clock import state_before
from ortilo_drake.world.slow_error import slow_noise_after


class SlowConstants(NamedTuple):
    """Errors of n numbers, 0 of them where there are none.

    Attributes:
        bias: constant (n).
        start: x_0 of the slow part (n).
        a: its decay over a tick (n).
        q: standard deviation of what is new of it in a tick (n).
        stream: number of its noise.
        factor: of the whole (n).
    """

    bias: np.ndarray
    start: np.ndarray
    a: np.ndarray
    q: np.ndarray
    stream: np.uint64
    factor: np.ndarray


_NOTHING = np.zeros(0)
NO_ERRORS = SlowConstants(_NOTHING, _NOTHING, _NOTHING, _NOTHING, np.uint64(0), _NOTHING)


@register_jitable(forceinline=True, error_model="numpy")
def step_slow(x: np.ndarray, errors: SlowConstants, k: int, h: float, seed: int) -> None:
    """Change x_k to x_{k+1}."""
    if errors.a.size > 0:
        put(slow_noise_after(x, errors.a, errors.q, seed, errors.stream, k * h, h), x)


@register_jitable(forceinline=True, error_model="numpy")
def add_errors(message: np.ndarray, errors: SlowConstants, x: np.ndarray, flagged: bool) -> None:
    """Add to a message what lasts of its errors."""
    if errors.a.size > 0:
        put(message_with_error(message, errors.factor, errors.bias + x, flagged), message)


@register_jitable(forceinline=True, error_model="numpy")
def seen_by(clock: np.ndarray, x: np.ndarray, time: float) -> np.ndarray:
    """Return the state (12) as a sensor sees it whose clock has that offset [s] and drift [1]."""
    if clock[0] == 0.0 and clock[1] == 0.0:
        return x
    return state_before(x, clock[0] + clock[1] * time)
