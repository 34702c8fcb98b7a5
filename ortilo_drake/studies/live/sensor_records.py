"""What a live filter has received: figures by anchor, and the stamps of the imu.

The biases of the ranges are states of the filter, so an anchor in a wrong place hardly shows in these figures: over a
minute, an error of 0.5 m left the mean innovation within 3 mm and NIS unchanged. anchor_bank.py finds such anchors.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from ortilo_drake.interop.recorded.recording import Imu
from ortilo_drake.onboard.estimator.tight.layout import ADDITIVE, GYRO
from ortilo_drake.studies.recorded.filter_types import BIASES, Run, State

SILENT: Final = 0.5  # if the imu's last sample is older, nobody should fly by the filter [s]
LOST: Final = 5.0  # after a longer silence the attitude is unknown [s]


@dataclass(frozen=True)
class AnchorFigures:
    """The figures of one anchor.

    Attributes:
        ranges: number of ranges received.
        rejected: share of these that were not taken.
        nis: mean e²/S of the ranges taken.
        mean: mean innovation of the ranges taken [m].
        mean_sd: standard deviation that this mean should have [m].
        bias: the present estimate of the ranges' bias [m].
        bias_sd: standard deviation of this estimate [m].
    """

    ranges: int
    rejected: float
    nis: float
    mean: float
    mean_sd: float
    bias: float
    bias_sd: float

    def text(self) -> str:
        """Return the figures in words."""
        innovations = f"innovations {self.mean:+.3f} m (sd {self.mean_sd:.3f})"
        bias = f"bias {self.bias:+.2f} m (sd {self.bias_sd:.2f})"
        return f"{self.ranges} ranges, {self.rejected:.1%} rejected, NIS {self.nis:.2f}, {innovations}, {bias}"


class AnchorRecord:
    """The record of n anchors' ranges so far."""

    def __init__(self, n: int):
        self._heard, self._taken = np.zeros(n, np.int64), np.zeros(n, np.int64)
        self._squares, self._sums, self._variances = np.zeros(n), np.zeros(n), np.zeros(n)
        self._biases, self._C = np.zeros(n), np.eye(n)

    def add(self, anchor: np.ndarray, run: Run, state: State) -> None:
        """Add the ranges of a run, with their anchors (k), and the state after the run.

        Ranges at rest on the floor, which the filter ignores, do not count.
        """
        used, n = run.taken | (run.innovation != 0.0), len(self._heard)
        self._heard += np.bincount(anchor[used], minlength=n)
        at, e, S = anchor[run.taken], run.innovation[run.taken], run.variance[run.taken]
        self._taken += np.bincount(at, minlength=n)
        self._squares += np.bincount(at, e**2 / S, minlength=n)
        self._sums += np.bincount(at, e, minlength=n)
        self._variances += np.bincount(at, S, minlength=n)
        self._biases = state.x[ADDITIVE + BIASES - GYRO :][:n].copy()
        self._C = state.C[BIASES : BIASES + n, BIASES : BIASES + n].copy()

    @property
    def nis(self) -> float | None:
        """The mean NIS of all ranges taken; None before the first."""
        return float(self._squares.sum() / self._taken.sum()) if self._taken.any() else None

    def figures(self) -> list[AnchorFigures | None]:
        """Return the figures of each anchor (n); None for an anchor without a range taken."""
        sd = np.sqrt(np.diag(self._C))
        return [
            AnchorFigures(
                int(self._heard[i]),
                1.0 - float(k / self._heard[i]),
                float(self._squares[i] / k),
                float(self._sums[i] / k),
                float(np.sqrt(self._variances[i]) / k),
                float(self._biases[i]),
                float(sd[i]),
            )
            if k
            else None
            for i, k in enumerate(self._taken)
        ]


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
