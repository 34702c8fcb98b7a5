"""The sensors' clock, extrapolated by the wall clock between and after their messages.

The least delay of a message seen lately gives the offset of the two clocks, as in D. L. Mills, RFC 5905, clock filter.
A bridge that cannot keep up, or stands still, sees by it that its messages are old.
"""

from collections.abc import Callable
from typing import Final

import numpy as np

WINDOW: Final = 30.0  # the least delay of the last one to two windows counts, so that clocks may drift [s]


class SensorClock:
    """The sensors' clock.

    Args:
        wall: the wall clock [s]; it never goes back.
    """

    def __init__(self, wall: Callable[[], float]):
        self._wall = wall
        self._since, self._least, self._before = -np.inf, np.inf, np.inf

    def now(self, newest: float) -> float:
        """Return the sensors' time [s], at least `newest`, the stamp just received."""
        wall = self._wall()
        if wall - self._since > WINDOW:
            self._since, self._before, self._least = wall, self._least, np.inf
        self._least = min(self._least, wall - newest)
        return wall - min(self._least, self._before)
