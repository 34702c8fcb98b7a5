"""The gate of a stuck sensor: it refuses values that repeat exactly, which noise would have changed.

A frozen value stays close to the prediction for a while after it froze, so that a test against the prediction refuses
the value too late. But a sensor with noise never gives the same value twice.
"""

from typing import Any

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.loop.element import Box, Element, Values
from ortilo_drake.model.placing import fill, put
from ortilo_drake.model.signals import ARRIVED, PAYLOAD, STAMP

SAME = 1e-12  # values that differ by less count as equal: they may have been written as text and read again


@register_jitable
def put_said(message: np.ndarray, samples: int, said: np.ndarray) -> None:
    """Write the message's payload without stamps to `said`; of several samples, the payload of each."""
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
    """Return the number of equal messages in a row, including the present one with the payload `said` (n).

    `last` (1 + n) holds this number up to the last message, 0 before the first one, and the last message's payload.
    """
    if last[0] == 0.0:
        return 1.0
    for i in range(said.size):
        if not abs(said[i] - last[1 + i]) <= SAME:  # NaN is never the same
            return 1.0
    return float(last[0] + 1.0)


def stuck_gate_out(n: Any, message: np.ndarray, last: np.ndarray, said: np.ndarray, out: np.ndarray) -> None:
    """Output the message, or zeros if the sensor is stuck."""
    fill(out, 0.0)
    if message[ARRIVED] != 0.0:
        put_said(message, n.samples, said)
        if repeats(said, last) < n.stuck:
            put(message, out)


def stuck_gate_step(n: Any, message: np.ndarray, said: np.ndarray, last: np.ndarray) -> None:
    """Store the message's payload and the number of equal messages in a row."""
    if message[ARRIVED] != 0.0:
        put_said(message, n.samples, said)
        last[0] = repeats(said, last)
        put(said, last, 1)


STUCK = Element("stuck_gate", out=stuck_gate_out, step=stuck_gate_step)


def stuck_box(name: str, size: int, stuck: int, samples: int = 1) -> Box:
    """Return the gate's box for a sensor with messages of `size` numbers and `samples` samples; it reads the message.

    The gate refuses a message whose payload has come `stuck` times in a row.
    """
    payload = size - PAYLOAD - (samples if samples > 1 else 0)
    given = Values({"stuck": stuck, "samples": samples}, {"last": np.zeros(1 + payload)})
    return Box(f"{name}_stuck_gate", STUCK, size, given, {"said": (payload,)})
