"""The truth between its stamps, the ranges that the truth covers and predicts, and the part that calibrates."""

from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, Slerp

from ortilo_drake.interop.recorded.recording import Ranges, Truth

GAP = 5.0  # an interval of the truth longer than this many medians is a gap
FAR = 1e3  # places beyond this count from their middle [m]
LEAST = 50  # ranges that a calibration needs
WAITS = 5.0  # at an end where the truth is this much longer than the ranges, only the time with ranges counts [s]


class TruthPath(NamedTuple):
    """The truth between its stamps; queries beyond an end are answered at that end."""

    p: CubicSpline
    R: Slerp | None
    first: float
    last: float

    def at(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
        """Return positions (m, 3) and attitudes (m, 3, 3) at times t (m) by the truth's clock [s]."""
        t = np.clip(t, self.first, self.last)
        return self.p(t), None if self.R is None else self.R(t).as_matrix()


def interpolated(t: np.ndarray, stamps: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return the linear interpolation of `values` (m, k), with rising stamps (m), at times t (...): (..., k)."""
    return np.stack([np.interp(t, stamps, column) for column in values.T], axis=-1)


def far_away(p: np.ndarray) -> bool:
    """Return whether places (n, 3) are so far from 0 that they should count from their middle."""
    return bool(np.abs(p).max() > FAR)


def truth_path(truth: Truth) -> TruthPath:
    """Return the truth between its stamps: a cubic spline of positions, the shortest turn between attitudes."""
    R = None if truth.R is None else Slerp(truth.t, Rotation.from_matrix(truth.R))
    return TruthPath(CubicSpline(truth.t, truth.p), R, float(truth.t[0]), float(truth.t[-1]))


def covered_ranges(ranges: Ranges, offset: float, path: TruthPath, end: float = np.inf) -> np.ndarray:
    """Return the indices of ranges within the truth, up to `end` by the truth's clock [s], and not in its gaps."""
    then = ranges.t + offset
    stamps = path.p.x
    steps = np.diff(stamps)
    around = steps[np.clip(np.searchsorted(stamps, then) - 1, 0, len(steps) - 1)]
    near = around <= GAP * np.median(steps)  # in a longer interval the interpolated truth is a guess
    return np.flatnonzero((then >= path.first) & (then <= min(end, path.last)) & near)


def random_sample(chosen: np.ndarray, most: int) -> np.ndarray:
    """Return a random sample of at most `most` indices; every k-th range would be of some anchors only."""
    if len(chosen) <= most:
        return chosen
    drawn = np.random.Generator(np.random.Philox(0)).choice(chosen, most, replace=False)
    return np.asarray(np.sort(drawn))


def first_part(truth: Truth, ranges: Ranges, share: float, offset: float) -> tuple[float, float]:
    """Return the first and the last stamp of the part that calibrates, by the truth's clock [s].

    The part is the first `share` of the truth's time. At an end where the truth exceeds the ranges by more than 5 s,
    only the time with ranges counts.
    """
    first, last = float(truth.t[0]), float(truth.t[-1])
    heard_first, heard_last = float(ranges.t[0]) + offset, float(ranges.t[-1]) + offset
    if heard_first - first > WAITS:
        first = heard_first
    if last - heard_last > WAITS:
        last = heard_last
    return first, first + share * max(0.0, last - first)


def modelled(p: np.ndarray, anchors: np.ndarray, c: np.ndarray, ranges: Ranges) -> np.ndarray:
    """Return the modelled ranges |p - a_b| + c_b, less |p - a_a| + c_a for differences (n) [m].

    Args:
        p: the antenna's place at each range (n, 3).
        anchors: positions (m, 3).
        c: biases of the anchors (m) [m].
        ranges: the ranges, for their anchors (n).
    """
    found = np.linalg.norm(p - anchors[ranges.anchor], axis=1) + c[ranges.anchor]
    two = ranges.other >= 0
    if two.any():
        of = ranges.other[two]
        found[two] -= np.linalg.norm(p[two] - anchors[of], axis=1) + c[of]
    return found


def antennas(p: np.ndarray, R: np.ndarray | None, lever: np.ndarray, tags: np.ndarray, tag: np.ndarray) -> np.ndarray:
    """Return the tags' positions p + R (l + t) (n, 3); p if no attitude is known.

    Args:
        p: positions of the body's point (n, 3).
        R: attitudes (n, 3, 3), None if unknown.
        lever: l, from the body's point to the tags' origin, body axes (3).
        tags: t, from the tags' origin to each tag, body axes (m, 3).
        tag: index of the tag (n).
    """
    return p if R is None else p + R @ lever + np.einsum("kij,kj->ki", R, tags[tag])
