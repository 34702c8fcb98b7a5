"""Whether the ranges of the last seconds agree with the estimate."""

from typing import Final

import numpy as np

from ortilo_drake.studies.recorded.filter_types import Run

WINDOW: Final = 5.0  # duration that is judged [s]
FEWEST: Final = 30  # fewer ranges in the window tell nothing
REJECTED, CONSISTENT = 0.1, 3.0  # a larger share of rejected ranges, or mean NIS of the others, is told
MOSTLY: Final = 0.6  # an anchor alone is to blame if at least this share of the rejected ranges is its own
UNFIT: Final = (0.3, 0.15)  # nobody should fly from the first share of rejected ranges until below the second


class Agreement:
    """The agreement of the last seconds' ranges with the estimate, by their NIS (e²/S).

    A wrong heading, anchor or axis shows here in flight.
    """

    def __init__(self) -> None:
        self._t, self._nis, self._taken = np.zeros(0), np.zeros(0), np.zeros(0, dtype=bool)
        self._anchor = np.zeros(0, np.int64)

    def add(self, t: np.ndarray, anchor: np.ndarray, run: Run) -> None:
        """Add the ranges of a run, with stamps t (n) [s] and anchors (n).

        Ranges at rest on the floor, which the filter ignores, do not count.
        """
        used = run.taken | (run.innovation != 0.0)
        nis = run.innovation[used] ** 2 / run.variance[used]
        recent = self._t > t[-1] - WINDOW if len(t) else np.ones(len(self._t), dtype=bool)
        self._t = np.concatenate((self._t[recent], t[used]))
        self._nis = np.concatenate((self._nis[recent], nis))
        self._taken = np.concatenate((self._taken[recent], run.taken[used]))
        self._anchor = np.concatenate((self._anchor[recent], anchor[used]))

    def alone(self) -> int | None:
        """Return the anchor that alone is to blame, or None: other anchors' ranges are rejected no more than usual."""
        out, counts = self._anchor[~self._taken], np.bincount(self._anchor)
        if not len(out):
            return None
        worst = int(np.argmax(np.bincount(out)))
        of_it = float(np.mean(out == worst))
        others = (1.0 - of_it) * len(out) / max(1, len(self._anchor) - counts[worst])
        return worst if of_it >= MOSTLY and others <= REJECTED else None

    def is_unfit(self, before: bool, gate: float = 0.0) -> bool:
        """Return whether the gate rejects too many ranges to fly by the estimate; the limit is lower if so `before`.

        Ranges whose e²/S is at most `gate` do not count as rejected.
        """
        taken = self._taken | (self._nis <= gate)
        return len(taken) >= FEWEST and 1.0 - float(np.mean(taken)) > UNFIT[before]

    def doubt(self, gate: float = 0.0, widened: float = 1.0) -> str:
        """Return how ranges and estimate disagree, in words; empty if they agree or are too few to tell.

        Args:
            gate: as in `is_unfit`.
            widened: factor by which the variances of the innovations are too small.
        """
        taken = self._taken | (self._nis <= gate)
        n = len(taken)
        if n < FEWEST:
            return ""
        rejected = 1.0 - float(np.mean(taken))
        nis = float(np.mean(self._nis[taken])) / widened if taken.any() else np.inf
        if rejected <= REJECTED and nis <= CONSISTENT:
            return ""
        return f"the gate rejects {rejected:.0%} of the last {WINDOW:g} s, the others have NIS {nis:.1f} (1 is right)"
