"""The initial estimate of a flight, and the belief of the filter after the onboard half was away.

Without commands the world's failsafe flies the vehicle (world/vehicle/failsafe.py); the filter has no model of it. So
the estimate is not predicted through the gap. The last estimate stands, with the added variances of a vehicle that may
have moved in any direction at SPEED. If no estimate is left, the vehicle may be anywhere about the reference.
"""

from typing import Final

import numpy as np

from ortilo_drake.model.signals import N_X, N_XBAR
from ortilo_drake.onboard.servo.lq_gain import gain_of
from ortilo_drake.onboard.servo.lq_servo import resting_integral
from ortilo_drake.scenario import Belief, LqServo

SPEED: Final = 0.5  # [m/s] at which the vehicle may have moved, in any direction
VELOCITY_SD, ANGLE_SD, RATE_SD = 0.3, 0.1, 0.3  # [m/s], [rad], [rad/s]: braking changes all three
LOST_SD: Final = 1.0  # sd of the position about the reference if no estimate is left [m]


def initial_estimate(scenario: Belief, r_0: np.ndarray) -> np.ndarray:
    """Return the initial estimate xbar_0 (15): hover at r_0 (3) [m], with the integral at which the servo rests."""
    xbar_0 = np.zeros(N_XBAR)
    xbar_0[0:3] = r_0
    xbar_0[5] = scenario.yaw
    if isinstance(scenario.servo, LqServo):
        L = gain_of(scenario)
        xbar_0[12:15] = resting_integral(L, r_0, scenario.servo.form)
    return xbar_0


def after_gap(xbar: np.ndarray, P: np.ndarray, seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the estimate (15) and the covariance (15, 15) after a gap of `seconds`, given both before the gap."""
    sd = np.repeat([SPEED * seconds, ANGLE_SD, VELOCITY_SD, RATE_SD], 3)
    wider = P.copy()
    wider[:N_X, :N_X] += np.diag(sd**2)
    return xbar.copy(), wider


def about_reference(reference: np.ndarray, yaw: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the estimate (15) and covariance (15, 15) of a vehicle near the reference [r, r_dot, ...], integral 0."""
    xbar = np.zeros(N_XBAR)
    xbar[0:3], xbar[5], xbar[6:9] = reference[0:3], yaw, reference[3:6]
    P = np.zeros((N_XBAR, N_XBAR))
    P[:N_X, :N_X] = np.diag(np.repeat([LOST_SD, ANGLE_SD, VELOCITY_SD, RATE_SD], 3) ** 2)
    return xbar, P
