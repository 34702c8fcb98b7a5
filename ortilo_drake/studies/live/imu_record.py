"""What a live filter has received of the imu: when it spoke last, and whether its rates are in the map's unit."""

from typing import Any, Final

import numpy as np

from ortilo_drake.interop.recorded.map_file import Map
from ortilo_drake.interop.recorded.recording import Imu
from ortilo_drake.studies.recorded.imu_doubts import rate_doubts

SILENT: Final = 0.5  # a filter that has propagated by the last sample for longer is not to be flown by [s]
LOST: Final = 5.0  # nobody knows how far the body turned in a silence that is longer [s]
LOOKS: Final = 5.0  # the rates are compared with the force over so long [s]


class ImuRecord:
    """The imu's rows up to the filter's stamp, by a map.

    Attributes:
        doubt: what is odd of the body rates' unit; empty if nothing is.
    """

    def __init__(self, map_: Map):
        self._map, self._last, self._newest = map_, np.inf, np.inf
        self._parts: list[Imu] = []
        self.doubt = ""

    def add(self, imu: Imu) -> None:
        """Add rows, in order."""
        if not len(imu.t):
            return
        self._last = float(imu.t[-1])
        if self.doubt or imu.accelerometer is not None:  # of its own stamps
            return
        self._parts.append(imu)
        if self._last - self._parts[0].t[0] >= LOOKS:
            self.doubt = next(iter(rate_doubts(self._joined(), self._map)), "")
            self._parts = []

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

    def _joined(self) -> Imu:
        parts = self._parts
        columns: dict[str, Any] = {
            name: np.concatenate([getattr(part, name) for part in parts]) for name in ("t", "rates", "force")
        }
        return parts[0]._replace(**columns)
