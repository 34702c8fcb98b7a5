"""The filter of an onboard half that was away: what it knew, and how much less it knows now.

While no command came the world's failsafe flew the vehicle (world/vehicle/failsafe.py), by no model that the filter
has. So the estimate is not predicted through the gap; what was known last stands, with the variances of a vehicle that
may have gone any way at its speed. Where nothing is known, it may be anywhere about the reference.
"""

from typing import Final

import numpy as np

from ortilo_drake.model.signals import N_X, N_XBAR

SPEED: Final = 0.5  # [m/s] at which it may have gone, in any direction
VELOCITY_SD, ANGLE_SD, RATE_SD = 0.3, 0.1, 0.3  # [m/s], [rad], [rad/s]: braking bends all of them
LOST_SD: Final = 1.0  # error of the position of a vehicle that is somewhere about its reference [m]


def after_gap(xbar: np.ndarray, P: np.ndarray, seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """Return estimate (15) and covariance (15, 15) a gap of some seconds after they held."""
    sd = np.repeat([SPEED * seconds, ANGLE_SD, VELOCITY_SD, RATE_SD], 3)
    wider = P.copy()
    wider[:N_X, :N_X] += np.diag(sd**2)
    return xbar.copy(), wider


def about_reference(reference: np.ndarray, yaw: float) -> tuple[np.ndarray, np.ndarray]:
    """Return estimate (15) and covariance (15, 15) of a vehicle somewhere about r, r_dot (9), its integral at rest."""
    xbar = np.zeros(N_XBAR)
    xbar[0:3], xbar[5], xbar[6:9] = reference[0:3], yaw, reference[3:6]
    P = np.zeros((N_XBAR, N_XBAR))
    P[:N_X, :N_X] = np.diag(np.repeat([LOST_SD, ANGLE_SD, VELOCITY_SD, RATE_SD], 3) ** 2)
    return xbar, P
