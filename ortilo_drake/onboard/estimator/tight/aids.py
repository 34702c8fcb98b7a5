"""The tight filter's measurements beside the imu."""

from typing import NamedTuple

import numpy as np

from ortilo_drake.onboard.estimator.tight.watch import Watch
from ortilo_drake.onboard.landmarks.box_fix import BoxBelief


class Aids(NamedTuple):
    """The filter's model of the sensors beside the imu, in arrays for compiled functions."""

    anchors: np.ndarray
    """positions a_i of the anchors in W (n, 3) [m]."""
    lever: np.ndarray
    """position of the uwb antenna in B (3) [m]."""
    range_noise: np.ndarray
    """s_0 [m] and s_1 [1] of the noise sd s_0 + s_1 r of a range r (2)."""
    differences: bool
    """whether all ranges of a message share an unknown clock offset, so that only their differences count."""
    in_pairs: bool
    """whether the uwb's messages hold differences of ranges."""
    boxes: BoxBelief
    """landmarks, camera and settings of the association of boxes to landmarks; the errors and the gate are not read."""
    pixel_noise: np.ndarray
    """sd of a small box's centre [px], growth of this sd [1/px], share of the variance that lasts [1] (3)."""
    angle_sd: float
    """noise sd of a sample of the imu's angles [rad]; 0 leaves the angles out."""
    gates: np.ndarray
    """largest squared distance of a scalar, of a box's centre, and of a box in the association to a landmark (3)."""
    huber: float
    """constant c of Huber's weight, see update.py."""
    watch: Watch
    """settings of the watch; read only if Motion.watches."""
