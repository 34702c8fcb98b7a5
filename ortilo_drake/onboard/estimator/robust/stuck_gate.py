"""The gate of a sensor that is stuck: what its noise should have changed and did not is no measurement.

A frozen value is consistent with itself, and near what it was when it froze, so that no test against the prediction
refuses it in time. But no sensor with noise says the same twice.
"""

from typing import Any

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.loop.element import Box, Element, Values
from ortilo_drake.model.placing import fill, put
from ortilo_drake.model.signals import ARRIVED, PAYLOAD, STAMP

SAME = 1e-12  # values that differ by less are the same: they may have gone through text


@register_jitable
def put_said(message: np.ndarray, samples: int, said: np.ndarray) -> None:
    """Write what a message says beside when: its payload, of each sample where there are several."""
    if samples == 1:
        put(message[PAYLOAD:], said)
        return
    size, at = (message.size - PAYLOAD) // samples, 0
    for i in range(PAYLOAD, message.size):
        if (i - PAYLOAD) % size != STAMP:
            said[at] = message[i]
            at += 1


@cached_njit
def repeats(said: np.ndarray, last: np.ndarray) -> float:
    """Return the number of equal messages in a row, the one that says this (n) included.

    `last` is how many said the same up to the last one, 0 before any came, and what that was (1 + n).
    """
    if last[0] == 0.0:
        return 1.0
    for i in range(said.size):
        if not abs(said[i] - last[1 + i]) <= SAME:  # NaN is never the same
            return 1.0
    return float(last[0] + 1.0)


def stuck_gate_out(n: Any, message: np.ndarray, last: np.ndarray, said: np.ndarray, out: np.ndarray) -> None:
    """Output the message, or zeros where the sensor is stuck."""
    fill(out, 0.0)
    if message[ARRIVED] != 0.0:
        put_said(message, n.samples, said)
        if repeats(said, last) < n.stuck:
            put(message, out)


def stuck_gate_step(n: Any, message: np.ndarray, said: np.ndarray, last: np.ndarray) -> None:
    """Remember what a message said, and how many have in a row."""
    if message[ARRIVED] != 0.0:
        put_said(message, n.samples, said)
        last[0] = repeats(said, last)
        put(said, last, 1)


STUCK = Element("stuck_gate", out=stuck_gate_out, step=stuck_gate_step)


def stuck_box(name: str, size: int, stuck: int, samples: int = 1) -> Box:
    """Return the gate of a sensor whose messages have that size and so many samples: it reads the message as it lands.

    It refuses what has been said so many times in a row.
    """
    payload = size - PAYLOAD - (samples if samples > 1 else 0)
    given = Values({"stuck": stuck, "samples": samples}, {"last": np.zeros(1 + payload)})
    return Box(f"{name}_stuck_gate", STUCK, size, given, {"said": (payload,)})
