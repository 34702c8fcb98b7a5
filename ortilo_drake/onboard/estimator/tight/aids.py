"""What the tight filter goes by beside the imu and the vehicle."""

from dataclasses import dataclass

import numpy as np

from ortilo_drake.model.pinhole import Camera
from ortilo_drake.model.room import Room
from ortilo_drake.onboard.estimator.tight.watch import Watch
from ortilo_drake.scenario import LandmarkFix


@dataclass(frozen=True)
class Aids:
    """What the filter believes of the sensors beside the imu.

    Attributes:
        anchors: a_i in W (n, 3) [m].
        lever: where the antenna is in B (3) [m].
        range_noise: s_0 [m] and s_1 of s_0 + s_1 r (2).
        differences: whether only differences of ranges count.
        room: landmarks as they are known onboard.
        camera: the camera.
        pixel_noise: see take_boxes (3).
        association: settings of the association.
        angle_sd: noise of a sample of the imu's angles [rad]; None leaves them out.
        gates: largest squared innovations of a single number and of a box, and of a box that may be a landmark's.
        huber: see update.
        watch: what the watch goes by; None without one.
    """

    anchors: np.ndarray
    lever: np.ndarray
    range_noise: np.ndarray
    differences: bool
    room: Room
    camera: Camera
    pixel_noise: np.ndarray
    association: LandmarkFix
    angle_sd: float | None
    gates: tuple[float, ...]
    huber: float
    watch: Watch | None
