"""What a compiled flight keeps of its sensors: made once, written anew in every tick.

A new array in every tick would cost as much as a noise number, and be counted besides, see borrowed.py.
"""

from typing import NamedTuple

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.flight.compiled.constants import CameraConstants, ImuConstants, LinkConstants, UwbConstants
from ortilo_drake.flight.compiled.faults import held_at_first
from ortilo_drake.flight.compiled.links import empty_link
from ortilo_drake.flight.compiled.slow import SlowConstants
from ortilo_drake.model.signals import DETECTIONS_SIZE, IMU_SIZE, PAYLOAD
from ortilo_drake.world.faults.table import FaultTable


class SensorMemory(NamedTuple):
    """What is kept of a sensor from tick to tick, changed in place.

    Attributes:
        message: that landed in this tick, zeros if none did.
        noise: standard normal numbers of a message.
        flying: messages in flight.
        bad: whether the link's chain is bad (1).
        slow: slow part of its errors.
        held: what it holds if it is to be stuck, see faults.py.
        said: what it said last, see robust.hear.
    """

    message: np.ndarray
    noise: np.ndarray
    flying: np.ndarray
    bad: np.ndarray
    slow: np.ndarray
    held: np.ndarray
    said: np.ndarray


class Sensed(NamedTuple):
    """What is kept of the sensors that every flight knows, and the imu's samples inside the tick (n - 1, 11)."""

    uwb: SensorMemory
    imu: SensorMemory
    camera: SensorMemory
    samples: np.ndarray


@register_jitable
def first_of_sensor(
    link: LinkConstants, faults: FaultTable | None, start: np.ndarray, size: int, noises: int, held: int
) -> SensorMemory:
    """Return what is kept of a sensor at first.

    Args:
        link: how its messages are delivered.
        faults: of them.
        start: slow part of their errors.
        size: of a message.
        noises: standard normal numbers that it takes.
        held: payload of what it holds if it is to be stuck.
    """
    return SensorMemory(
        np.zeros(size),
        np.zeros(noises),
        empty_link(link, size),
        np.zeros(1, dtype=np.bool_),
        start.copy(),
        held_at_first(faults, held),
        np.zeros(1 + size - PAYLOAD),
    )


@register_jitable
def first_of_camera(camera: CameraConstants | None) -> SensorMemory:
    """Return what is kept of the camera at first: arrays as empty as can be where there is none."""
    none = np.zeros(0)
    if camera is None:
        rows = np.zeros((0, PAYLOAD))
        return SensorMemory(np.zeros(PAYLOAD), none, rows, np.zeros(1, dtype=np.bool_), none, rows, none)
    return first_of_sensor(camera.link, camera.faults, none, DETECTIONS_SIZE, 0, DETECTIONS_SIZE - PAYLOAD)


@register_jitable
def first_sensed(
    imu: ImuConstants,
    imu_errors: SlowConstants,
    uwb: UwbConstants,
    uwb_errors: SlowConstants,
    camera: CameraConstants | None,
) -> Sensed:
    """Return what is kept of all three at first."""
    size, ranges = IMU_SIZE if imu.samples == 1 else PAYLOAD + imu.samples * IMU_SIZE, 2 * uwb.anchors.shape[0]
    return Sensed(
        first_of_sensor(uwb.link, uwb.faults, uwb_errors.start, PAYLOAD + ranges, uwb.anchors.shape[0], ranges),
        first_of_sensor(imu.link, imu.faults, imu_errors.start, size, IMU_SIZE - PAYLOAD, IMU_SIZE - PAYLOAD),
        first_of_camera(camera),
        np.zeros((imu.samples - 1, IMU_SIZE)),
    )
