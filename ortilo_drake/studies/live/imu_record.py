"""What a live filter has received of the imu: when it spoke last."""

from typing import Final

import numpy as np

from ortilo_drake.interop.recorded.recording import Imu

SILENT: Final = 0.5  # a filter that has propagated by the last sample for longer is not to be flown by [s]
LOST: Final = 5.0  # nobody knows how far the body turned in a silence that is longer [s]


class ImuRecord:
    """The stamps of the imu's rows up to the filter's."""

    def __init__(self) -> None:
        self._last, self._newest = np.inf, np.inf

    def resume(self, t: float) -> None:
        """Take its last row for received at a stamp [s]."""
        self._last = self._newest = t

    def add(self, imu: Imu) -> None:
        """Add rows, in order."""
        if len(imu.t):
            self._last = float(imu.t[-1])

    def heard_again(self, imu: Imu) -> float | None:
        """Return the stamp of the last of newly received rows that follows a silence of LOST [s]; None if none does."""
        if not len(imu.t):
            return None
        follows = np.diff(imu.t, prepend=min(self._newest, imu.t[0])) > LOST
        self._newest = float(imu.t[-1])
        return float(imu.t[follows][-1]) if follows.any() else None

    def is_silent(self, t: float) -> bool:
        """Return whether no row is younger than SILENT at a stamp [s]."""
        return t - self._last > SILENT
