"""An imu that says nothing new: samples stay away, or one is repeated for ever.

Then the last sample stands for those that are missing, changed as thrust and torque are (tick.py). What it is wrong by
grows, and it is wrong by the same for many ticks, as a bias is. So the states of the biases take it up: they walk as
fast as thrust and torque leave rates and force unexplained, and ranges and boxes correct them. When samples come again,
the biases are what they were before.
"""

from typing import Final

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.onboard.estimator.tight.layout import ACCEL, ADDITIVE, GYRO, N_INERTIAL

AFTER: Final = 0.1  # ticks without a sample that are no silence yet [s]
_N: Final = N_INERTIAL - GYRO  # biases of gyroscope and accelerometer

# What is kept: the last sample, its stamp, whether the imu is silent, the biases and their variances of before.
_SAMPLE, _STAMP, _SILENT, _BIAS, _VARIANCE = 0, _N, _N + 1, _N + 2, 2 * _N + 2
N_QUIET: Final = 3 * _N + 2


@register_jitable
def is_repeated(sample: np.ndarray, quiet: np.ndarray) -> bool:
    """Return whether body rates and specific force (6) are bit for bit those of the last sample: noise never is."""
    for i in range(_N):
        if sample[i] != quiet[_SAMPLE + i]:
            quiet[_SAMPLE : _SAMPLE + _N] = sample
            return False
    return True


@register_jitable
def in_silence(x: np.ndarray, C: np.ndarray, quiet: np.ndarray, now: float, h: float, silent: np.ndarray) -> None:
    """Let the biases of a silent imu walk for a tick of h [s] until t_k, now [s]; changes C and what is kept (N_QUIET).

    `silent` is the variance per second of body rates and specific force (2).
    """
    if now - quiet[_STAMP] <= AFTER:
        return
    if quiet[_SILENT] == 0.0:
        quiet[_SILENT] = 1.0
        for i in range(_N):
            quiet[_BIAS + i], quiet[_VARIANCE + i] = x[ADDITIVE + i], C[GYRO + i, GYRO + i]
    for i in range(_N):
        C[GYRO + i, GYRO + i] += h * silent[0 if GYRO + i < ACCEL else 1]


@register_jitable
def end_silence(x: np.ndarray, C: np.ndarray, held: np.ndarray, quiet: np.ndarray, stamp: float) -> None:
    """Note that a sample came, and when [s]; after a silence give the biases back what they were.

    Arguments as in_silence; held, body rates and specific force that stood for samples (6), becomes what they were
    believed to be.
    """
    quiet[_STAMP] = stamp
    if quiet[_SILENT] == 0.0:
        return
    quiet[_SILENT] = 0.0
    for i in range(_N):
        held[i] += quiet[_BIAS + i] - x[ADDITIVE + i]
        x[ADDITIVE + i] = quiet[_BIAS + i]
        C[GYRO + i, :], C[:, GYRO + i] = 0.0, 0.0
    for i in range(_N):
        C[GYRO + i, GYRO + i] = quiet[_VARIANCE + i]
