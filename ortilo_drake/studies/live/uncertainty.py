"""The limits of uncertainty beyond which an estimate is not sent to an autopilot.

MAVLink's ODOMETRY could say so by its `quality`, but EKF2 ignores that unless EKF2_EV_QMIN is set. An estimate that
does not come is what every autopilot handles: it goes on by its own sensors, and then does what it is set to do.
"""

import math
from typing import Final, NamedTuple

from ortilo_drake.studies.live.stamped_estimate import StampedEstimate

MOST_YAW: Final = 0.5  # of a heading that is sent [rad]
AGAIN: Final = 0.8  # of a limit: an estimate is sent again below that, so that noise does not switch it


class Limits(NamedTuple):
    """The largest standard deviations: of the position, all three axes together [m], and of the heading [rad]."""

    deviation: float
    yaw: float

    def why_not(self, stamped: StampedEstimate, share: float = 1.0) -> str:
        """Return which of the limits, times a share, an estimate is above; empty if none. NaN is above all."""
        if not stamped.deviation <= share * self.deviation:
            return f"its standard deviation is above {self.deviation:g} m"
        if not stamped.yaw_deviation <= share * self.yaw:
            return f"the standard deviation of its heading is above {self.yaw:g} rad"
        return ""


ALL: Final = Limits(math.inf, math.inf)  # every estimate that is a number
