"""The tight filter's measurements beside the imu."""

from typing import NamedTuple

import numpy as np

from ortilo_drake.onboard.estimator.tight.watch import Watch
from ortilo_drake.onboard.landmarks.box_fix import BoxBelief


class Aids(NamedTuple):
    """The filter's model of the sensors beside the imu, as compiled functions take it."""

    anchors: np.ndarray
    """a_i in W (n, 3) [m]."""
    lever: np.ndarray
    """where the antenna is in B (3) [m]."""
    range_noise: np.ndarray
    """s_0 [m] and s_1 of s_0 + s_1 r (2)."""
    differences: bool
    """whether only differences of ranges count."""
    in_pairs: bool
    """whether the uwb's messages are differences."""
    boxes: BoxBelief
    """landmarks and camera, and by what boxes are given to landmarks; its errors and gate are not read."""
    pixel_noise: np.ndarray
    """sd of a small box's centre [px], its growth [1/px], and the share of the variance that lasts (3)."""
    angle_sd: float
    """noise of a sample of the imu's angles [rad]; 0 leaves them out."""
    gates: np.ndarray
    """largest squared innovations of a single number and of a box, and of a box that may be a landmark's (3)."""
    huber: float
    """see update."""
    watch: Watch
    """what the watch goes by, if there is one (Motion.watches)."""
