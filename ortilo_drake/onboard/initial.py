"""The initial estimate of a flight."""

import numpy as np

from ortilo_drake.model.signals import N_XBAR
from ortilo_drake.onboard.servo.lq_gain import gain_of
from ortilo_drake.onboard.servo.lq_servo import resting_integral
from ortilo_drake.scenario import Belief, LqServo


def initial_estimate(scenario: Belief, r_0: np.ndarray) -> np.ndarray:
    """Return the initial estimate xbar_0 (15): hover at r_0 (3) [m], with the integral at which the servo rests."""
    xbar_0 = np.zeros(N_XBAR)
    xbar_0[0:3] = r_0
    xbar_0[5] = scenario.yaw
    if isinstance(scenario.servo, LqServo):
        L = gain_of(scenario)
        xbar_0[12:15] = resting_integral(L, r_0, scenario.servo.form)
    return xbar_0
