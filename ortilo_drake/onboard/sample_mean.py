"""The mean of the samples that a sensor faster than the tick takes in one tick, as elements.

The samples' noise is white, so the mean's noise has 1 / n of their covariance. If a sample is missing, there is no
mean, because its age and covariance would differ.
"""

from typing import Any

import numpy as np

from ortilo_drake.loop.element import Box, Element, Values
from ortilo_drake.model.placing import fill, put
from ortilo_drake.model.signals import ARRIVED, PAYLOAD, STAMP


def mean_out(n: Any, message: np.ndarray, out: np.ndarray) -> None:
    """Output [1, stamp of the newest sample, mean payload] of a message of n samples; zeros if there is no mean."""
    fill(out, 0.0)
    if message[ARRIVED] == 0.0:
        return
    for i in range(n.samples):
        if message[PAYLOAD + i * out.size + ARRIVED] == 0.0:
            return
    for i in range(n.samples):
        for j in range(PAYLOAD, out.size):
            out[j] += message[PAYLOAD + i * out.size + j]
    for j in range(PAYLOAD, out.size):
        out[j] /= n.samples
    out[ARRIVED], out[STAMP] = 1.0, message[message.size - out.size + STAMP]


def mean_fix_out(n: Any, fix: np.ndarray, out: np.ndarray) -> None:
    """Output a fix [arrived, stamp, value (m), covariance (m^2)] with 1 / n of its covariance."""
    put(fix, out)
    for j in range(PAYLOAD + n.rows, out.size):
        out[j] *= 1.0 / n.samples


MEAN = Element("sample_mean", out=mean_out)
MEAN_FIX = Element("mean_fix", out=mean_fix_out)


def sample_mean_box(name: str, message: Box, n: int) -> Box:
    """Return the box of the mean of a message's n samples."""
    size, reads = (message.size - PAYLOAD) // n, {"message": message.name}
    return Box(name, MEAN, size, Values({"samples": n}), reads=reads)


def mean_fix_box(name: str, fix: Box, rows: int, n: int) -> Box:
    """Return the box of the fix of n samples' mean, given the fix that holds one sample's covariance; rows is m."""
    given = Values({"samples": n, "rows": rows})
    return Box(name, MEAN_FIX, fix.size, given, reads={"fix": fix.name})
