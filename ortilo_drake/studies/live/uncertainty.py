"""The limits of uncertainty beyond which an estimate is not sent to an autopilot.

MAVLink's ODOMETRY has a `quality` for this, but EKF2 ignores it unless EKF2_EV_QMIN is set. Every autopilot handles a
missing estimate: it goes on by its own sensors, and then does what it is set to do.
"""

import math
from typing import Final, NamedTuple

from ortilo_drake.studies.live.stamped_estimate import StampedEstimate

MOST_YAW: Final = 0.5  # largest standard deviation of a heading that is sent [rad]
AGAIN: Final = 0.8  # estimates are sent again below this share of a limit, so that noise does not switch them


class Limits(NamedTuple):
    """The largest standard deviations: of the position, the three axes together [m], and of the heading [rad]."""

    deviation: float
    yaw: float

    def why_not(self, stamped: StampedEstimate, share: float = 1.0) -> str:
        """Return which limit times `share` an estimate exceeds, in words; empty if none. NaN exceeds all limits."""
        if not stamped.deviation <= share * self.deviation:
            return f"its standard deviation is above {self.deviation:g} m"
        if not stamped.yaw_deviation <= share * self.yaw:
            return f"the standard deviation of its heading is above {self.yaw:g} rad"
        return ""


ALL: Final = Limits(math.inf, math.inf)  # lets every estimate through that is not NaN
