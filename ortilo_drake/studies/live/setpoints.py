"""Attitude and thrust setpoints to hold a place, by the scenario's servo, and the failsafe that stops them.

The failsafe lets no setpoint through while the estimate is too old or too uncertain, or before the vehicle is near the
place. The failsafe does not fly: an autopilot whose setpoints stop does what it is set to do, and the pilot takes over.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ortilo_drake.model.input_error import InputError
from ortilo_drake.onboard.estimator.tight.attitude_rows import wrapped
from ortilo_drake.onboard.servo.outer_loop import attitude_along, wanted_force
from ortilo_drake.scenario import Scenario
from ortilo_drake.studies.live.stamped_estimate import Limits, StampedEstimate

# Largest standard deviations to fly by: with a wrong heading the thrust leans the wrong way and drives the vehicle off.
FLOWN_BY = Limits(deviation=0.5, yaw=0.2)
BEYOND = 2.0  # a place to hold may be so far outside the anchors [m]
BELOW = 10.0  # and so far below them, which may all hang from a ceiling [m]
WINDUP = 1.0  # bound of the integral of the position's error [m s]
NEAR, AWAY = 0.5, 2.0  # distances from the place within which setpoints begin, and beyond which they stop [m]
TURN = 0.3  # rate of the commanded yaw, from the present yaw to the yaw to hold [rad/s]


class Setpoint(NamedTuple):
    """Stamp [s], wanted roll, pitch and yaw (3) [rad], thrust over mass [m/s²], and why it must not be flown, or ""."""

    t: float
    rpy: np.ndarray
    thrust: float
    refused: str


class Holding:
    """Holds a place r (3) in the anchors' frame [m], by a scenario's servo, mass and failsafe limits.

    The yaw to hold [rad] is by default the estimated yaw when setpoints first begin. InputError if the servo has no
    gain.
    """

    def __init__(self, scenario: Scenario, place: Sequence[float], yaw: float | None = None):
        from ortilo_drake.onboard.servo.lq_gain import gain_of  # loads Drake, which takes a while

        self._L, self._mass, self._of_gain = gain_of(scenario), scenario.vehicle.mass, scenario.yaw
        self._h, self._place, self._yaw = scenario.h, np.array(place), yaw
        self._asked: float | None = None  # yaw of the last setpoint; None if the last one was refused [rad]
        self._timeout, self._max_tilt = scenario.failsafe.timeout, scenario.failsafe.max_tilt
        self._i, self._last = np.zeros(3), -np.inf

    def check_within(self, anchors: np.ndarray) -> None:
        """Raise InputError if the place lies outside the box around the anchors (n, 3) [m] by more than BEYOND.

        Below the anchors it may be by BELOW.
        """
        low, high = anchors.min(axis=0), anchors.max(axis=0)
        if np.any(self._place < low - [BEYOND, BEYOND, BELOW]) or np.any(self._place > high + BEYOND):
            place, a, b = (", ".join(f"{value:g}" for value in one) for one in (self._place, low, high))
            within = f"within {BEYOND:g} m of the anchors, ({a}) to ({b}), or {BELOW:g} m below"
            raise InputError(f"--hold: ({place}): must be {within}")

    @property
    def aim(self) -> str:
        """The place and yaw to hold, in words."""
        place = ", ".join(f"{value:g}" for value in self._place)
        yaw = "the yaw at their start" if self._yaw is None else f"yaw {self._yaw:.2f} rad"
        return f"({place}) m, {yaw}"

    def setpoint(self, stamped: StampedEstimate, now: float) -> Setpoint:
        """Return the setpoint for an estimate; now: time by the sensors' clock [s], for the estimate's age."""
        x, age = stamped.estimate, now - stamped.t
        old = f"the estimate is older than {self._timeout:g} s" if age > self._timeout else ""
        refused = old or FLOWN_BY.why_not(stamped)
        e = x[0:3] - self._place
        if not refused and not np.linalg.norm(e) <= (NEAR if self._asked is None else AWAY):
            refused = f"the position to hold is too far: setpoints begin within {NEAR:g} m and stop beyond {AWAY:g} m"
        if refused:
            self._i[:], self._asked = 0.0, None
            yaw = x[5]
        else:  # the servo's integral adds r - p in each of its ticks
            passed = 0.0 if self._asked is None else min(stamped.t - self._last, self._timeout)
            bound = WINDUP / self._h
            self._i = np.clip(self._i - e * passed / self._h, -bound, bound)
            self._last = stamped.t
            yaw = self._asked = self._turned(x[5], passed)
        f_W = wanted_force(self._L, self._mass, self._of_gain, e, x[6:9], self._i)
        rpy, thrust = attitude_along(f_W, yaw, self._max_tilt)
        return Setpoint(stamped.t, rpy, thrust, refused)

    def _turned(self, yaw: float, passed: float) -> float:
        """Return the yaw to command [rad], turned on from the last commanded yaw, else from the estimated one.

        Args:
            yaw: estimated yaw [rad].
            passed: time since the last setpoint [s].
        """
        self._yaw = yaw if self._yaw is None else self._yaw
        begin = yaw if self._asked is None else self._asked
        left = wrapped(self._yaw - begin)
        return float(begin + np.clip(left, -TURN * passed, TURN * passed))
