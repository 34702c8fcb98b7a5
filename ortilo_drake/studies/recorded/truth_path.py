"""The truth between its stamps, the ranges that it covers and predicts, and the part of it that calibrates."""

from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, Slerp

from ortilo_drake.interop.recorded.recording import Ranges, Truth

GAP = 5.0  # an interval of the truth longer than this many medians is a gap
FAR = 1e3  # [m]
LEAST = 50  # ranges that a calibration needs
WAITS = 5.0  # a truth that is this much longer than the ranges at either end counts only while there are ranges [s]


class TruthPath(NamedTuple):
    """The truth between its stamps; queries beyond its ends are taken at the ends."""

    p: CubicSpline
    R: Slerp | None
    first: float
    last: float

    def at(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
        """Return positions (m, 3) and attitudes (m, 3, 3)."""
        t = np.clip(t, self.first, self.last)
        return self.p(t), None if self.R is None else self.R(t).as_matrix()


def far_away(p: np.ndarray) -> bool:
    """Return whether places (n, 3) are so far from 0 that they are better counted from their middle."""
    return bool(np.abs(p).max() > FAR)


def truth_path(truth: Truth) -> TruthPath:
    """Return the truth between its stamps: cubic in position, the shortest turn in attitude."""
    R = None if truth.R is None else Slerp(truth.t, Rotation.from_matrix(truth.R))
    return TruthPath(CubicSpline(truth.t, truth.p), R, float(truth.t[0]), float(truth.t[-1]))


def covered_ranges(ranges: Ranges, offset: float, path: TruthPath, end: float = np.inf) -> np.ndarray:
    """Return the indices of ranges between stamps of the truth, up to an end by its clock [s], not in its gaps."""
    then = ranges.t + offset
    stamps = path.p.x
    steps = np.diff(stamps)
    around = steps[np.clip(np.searchsorted(stamps, then) - 1, 0, len(steps) - 1)]
    near = around <= GAP * np.median(steps)  # between stamps farther apart the truth is a guess
    return np.flatnonzero((then >= path.first) & (then <= min(end, path.last)) & near)


def random_sample(chosen: np.ndarray, most: int) -> np.ndarray:
    """Return a random sample of at most so many; every k-th would be of some anchors only."""
    if len(chosen) <= most:
        return chosen
    drawn = np.random.Generator(np.random.Philox(0)).choice(chosen, most, replace=False)
    return np.asarray(np.sort(drawn))


def first_part(truth: Truth, ranges: Ranges, share: float, offset: float) -> tuple[float, float]:
    """Return the first and the last stamp of the part that calibrates, by the truth's clock [s].

    It is a share of the truth's time. Where the truth began, or ended, more than 5 s before, or after, the ranges, only
    the time of both counts.
    """
    first, last = float(truth.t[0]), float(truth.t[-1])
    heard_first, heard_last = float(ranges.t[0]) + offset, float(ranges.t[-1]) + offset
    if heard_first - first > WAITS:
        first = heard_first
    if last - heard_last > WAITS:
        last = heard_last
    return first, first + share * max(0.0, last - first)


def modelled(p: np.ndarray, anchors: np.ndarray, c: np.ndarray, ranges: Ranges) -> np.ndarray:
    """Return |p - a_b| + c_b, of a difference less |p - a_a| + c_a (n) [m].

    Args:
        p: the antenna's place at each of them (n, 3).
        anchors: positions (m, 3).
        c: constants of the anchors (m).
        ranges: which anchors they are of.
    """
    found = np.linalg.norm(p - anchors[ranges.anchor], axis=1) + c[ranges.anchor]
    two = ranges.other >= 0
    if two.any():
        of = ranges.other[two]
        found[two] -= np.linalg.norm(p[two] - anchors[of], axis=1) + c[of]
    return found


def antennas(p: np.ndarray, R: np.ndarray | None, lever: np.ndarray, tags: np.ndarray, tag: np.ndarray) -> np.ndarray:
    """Return the tags' positions p + R (l + t) (n, 3); p where no attitude is known.

    Args:
        p: of the body's point (n, 3).
        R: attitudes (n, 3, 3).
        lever: l, from there to the point that the tags count from, body axes (3).
        tags: t of each tag (m, 3).
        tag: which one (n).
    """
    return p if R is None else p + R @ lever + np.einsum("kij,kj->ki", R, tags[tag])
