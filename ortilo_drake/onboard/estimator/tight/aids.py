"""The tight filter's measurements beside the imu."""

from typing import NamedTuple

import numpy as np

from ortilo_drake.model.pinhole import Camera
from ortilo_drake.onboard.estimator.tight.watch import Watch


class Aids(NamedTuple):
    """The filter's model of the sensors beside the imu, as compiled functions take it.

    Attributes:
        anchors: a_i in W (n, 3) [m].
        lever: where the antenna is in B (3) [m].
        range_noise: s_0 [m] and s_1 of s_0 + s_1 r (2).
        differences: whether only differences of ranges count.
        in_pairs: whether the uwb's messages are differences.
        positions: p_WL of the landmarks as surveyed (l, 3) [m].
        outlines: their outlines as they are known onboard, see model/pinhole.py (l, m, 3).
        labels: their classes (l).
        camera: the camera.
        pixel_noise: see take_boxes (3).
        margin: of the association, see onboard/landmarks/landmark_association.py.
        inside: how far from the border a landmark's predicted box must end [px].
        angle_sd: noise of a sample of the imu's angles [rad]; 0 leaves them out.
        gates: largest squared innovations of a single number and of a box, and of a box that may be a landmark's (3).
        huber: see update.
        watch: what the watch goes by, if there is one (Motion.watches).
    """

    anchors: np.ndarray
    lever: np.ndarray
    range_noise: np.ndarray
    differences: bool
    in_pairs: bool
    positions: np.ndarray
    outlines: np.ndarray
    labels: np.ndarray
    camera: Camera
    pixel_noise: np.ndarray
    margin: float
    inside: float
    angle_sd: float
    gates: np.ndarray
    huber: float
    watch: Watch
