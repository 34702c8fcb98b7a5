"""The imu's stamps that a live filter has received: whether the imu is silent."""

from typing import Final

import numpy as np

from ortilo_drake.interop.recorded.recording import Imu

SILENT: Final = 0.5  # if the last sample is older, nobody should fly by the filter [s]
LOST: Final = 5.0  # after a longer silence the attitude is unknown [s]


class ImuRecord:
    """The stamps of the imu's rows: the last one that the filter has taken, and the newest received."""

    def __init__(self) -> None:
        self._last, self._newest = np.inf, np.inf

    def resume(self, t: float) -> None:
        """Continue as if the imu's last row had the stamp t [s]."""
        self._last = self._newest = t

    def add(self, imu: Imu) -> None:
        """Add rows that the filter has taken, in order."""
        if len(imu.t):
            self._last = float(imu.t[-1])

    def heard_again(self, imu: Imu) -> float | None:
        """Return the stamp of the last new row that follows a silence longer than LOST [s]; None if there is none."""
        if not len(imu.t):
            return None
        follows = np.diff(imu.t, prepend=min(self._newest, imu.t[0])) > LOST
        self._newest = float(imu.t[-1])
        return float(imu.t[follows][-1]) if follows.any() else None

    def is_silent(self, t: float) -> bool:
        """Return whether the last row is older than SILENT at the stamp t [s]."""
        return t - self._last > SILENT
