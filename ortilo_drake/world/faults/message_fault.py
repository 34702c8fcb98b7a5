"""A fault between a sensor and its link, which changes the messages while it lasts and nothing else."""

import numpy as np
from numba import njit
from numba.extending import register_jitable

from ortilo_drake.model.signals import ARRIVED, DETECTION_SIZE, PAYLOAD
from ortilo_drake.world.faults.range_faults import Moment, with_range_fault
from ortilo_drake.world.faults.table import (
    CAMERA_BLINDED,
    GYRO_BIAS,
    YAW_JUMP,
    FaultTable,
    settings_of,
)
from ortilo_drake.world.faults.timing import is_active

_YAW, _RATES = PAYLOAD + 2, PAYLOAD + 3  # in an imu message


@njit(cache=True)
def with_fault(message: np.ndarray, faults: FaultTable, i: int, moment: Moment) -> np.ndarray:
    """Return a sensor's message under fault i, which is none of a stuck sensor."""
    if message[ARRIVED] == 0.0 or not is_active(faults, i, moment.t):
        return message.copy()
    kind, values = faults.kinds[i], settings_of(faults, i)
    if kind in (YAW_JUMP, GYRO_BIAS, CAMERA_BLINDED):
        said = message.copy()
        if kind == YAW_JUMP:
            said[_YAW] += values[0]
        elif kind == GYRO_BIAS:
            said[_RATES : _RATES + 3] += values
        else:
            said[PAYLOAD:] = 0.0
            said[PAYLOAD::DETECTION_SIZE] = -1.0
        return said
    return with_range_fault(message, faults, i, moment)


@register_jitable
def stuck_says(message: np.ndarray, held: np.ndarray, active: bool) -> np.ndarray:
    """Return the message of a sensor that may be stuck: while it is, its payload is the held one."""
    said = message.copy()
    if active:
        said[PAYLOAD:] = held
    return said


@register_jitable
def held_after(message: np.ndarray, held: np.ndarray, active: bool) -> np.ndarray:
    """Return the payload that is held after a message: the last one that was there while it was not stuck."""
    return message[PAYLOAD:] if message[ARRIVED] != 0.0 and not active else held
