"""A bank of constant-velocity filters that finds an anchor in another place than the map's, or two exchanged anchors.

The filter that flies estimates a bias for each anchor, and this bias absorbs most of a wrong place. The filters of the
bank have the biases too, but each uses another map: the user's map; the map with one anchor's place free; with two
anchors exchanged; the user's map with larger errors of the ranges. The right map predicts all ranges better. The bank
needs no imu, so a wrong heading does not disturb it.

Each filter's state is p and v of the antenna, the biases c (n), and the free anchor's shift d (3), 0 without one:

    p' = v,   v' = white,   range to anchor i = |p - a_i - d (if i is free)| + c_i + white

A difference is one such range less another.
"""

from itertools import combinations
from typing import Final, NamedTuple

import numpy as np

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.interop.recorded.map_file import FilterSettings
from ortilo_drake.onboard.estimator.kalman import correct, innovation
from ortilo_drake.studies.recorded.filter_types import RANGE, Events, Noise
from ortilo_drake.studies.recorded.moved_anchors import point_text

SETTLED: Final = (30.0, 5.0)  # time before a place, an exchange is told: lasting errors fit any place for a while [s]
GAINS: Final = (15.0, 100.0)  # least gain of log-likelihood over the map: of a place; of an exchange, which moves more
SHRINKS: Final = 0.92  # largest ratio of the mean e²/S to the map's: in real rooms a wrong place gains some 4 % of RMS
FAR: Final = 0.2  # least shift that is told [m]
LASTS: Final = (3.0, 1.0)  # a place, an exchange must be the best for so long [s]
PLACE: Final = 0.5  # standard deviation of a shift [m]
FIRST: Final = (0.5, 1.0)  # standard deviations of position and velocity at the start [m], [m/s]
SILENT: Final = 1.5  # after a longer time without ranges, position and velocity begin anew [s]
NEARLY: Final = (3.0, 0.1)  # maps fit equally well (mirror images) within this log-likelihood, or share of a pair's
LOUDER: Final = (2.0, 4.0, 8.0)  # factors tried for the map's deviation of a range, which may be too small
NOISY: Final = 2.0  # a deviation from so many times the map's is told
MOST_SCATTER: Final = 0.5  # a larger deviation is not range noise: something is wrong [m]
MEMORY: Final = 10.0  # time over which noise is judged: ranges of a vehicle at rest scatter less [s]
FITS: Final = 2.0  # largest mean e²/S of a map that is told
HOPELESS: Final = 200.0  # a filter whose log-likelihood is so far below the map's is left out for good


class AnchorBank(NamedTuple):
    """The filters of m maps: the user's, those with a free anchor, those with two exchanged, and the user's, louder.

    These change: states x (m, 9 + n), covariances C, log-likelihoods `score` and sums `squares` of e²/S, each bounded
    by the gate (m each), both again over the last MEMORY (m, 2), and marks (4): the stamp, the numbers of ranges and
    of differences, and of ranges over the last MEMORY. These do not: anchors (m, n, 3), index of the free anchor, -1
    for none (m), and the factor of the map's deviation of ranges (m).
    """

    x: np.ndarray
    C: np.ndarray
    score: np.ndarray
    squares: np.ndarray
    lately: np.ndarray
    marks: np.ndarray
    anchors: np.ndarray
    free: np.ndarray
    louder: np.ndarray


def anchor_bank(anchors: np.ndarray, p: np.ndarray, t: float, bias: float) -> AnchorBank:
    """Return the bank for anchors (n, 3), the antenna at p (3) at t [s]; bias: standard deviation of a bias [m]."""
    n = len(anchors)
    pairs = list(combinations(range(n), 2))
    m, N = 1 + n + len(pairs) + len(LOUDER), 9 + n
    places, free = np.tile(anchors, (m, 1, 1)), np.full(m, -1)
    free[1 : 1 + n] = range(n)
    for k, (i, j) in enumerate(pairs, 1 + n):
        places[k, [i, j]] = anchors[[j, i]]
    x, C = np.zeros((m, N)), np.zeros((m, N, N))
    x[:, :3] = p
    deviations = np.array([FIRST[0]] * 3 + [FIRST[1]] * 3 + [bias] * n + [PLACE] * 3)
    C[:] = np.diag(deviations**2)
    C[free < 0, 6 + n :, 6 + n :] = 0.0
    louder = np.append(np.ones(m - len(LOUDER)), LOUDER)
    scores, marks = (np.zeros(m), np.zeros(m), np.zeros((m, 2))), np.array([t, 0.0, 0.0, 0.0])
    return AnchorBank(x, C, *scores, marks, places, free, louder)


def stated_sd(noise: Noise) -> float:
    """Return the standard deviation of a range's white and lasting errors together [m]."""
    return float(np.hypot(noise.range_white, noise.range_correlated))


class WrongAnchors(NamedTuple):
    """Anchors whose entries are wrong: one, with its place by the ranges (3) [m], or pairs that changed places.

    If there are several pairs, each explains the ranges equally well. left: ratio of the summed e²/S to the map's;
    gain: of the log-likelihood.
    """

    anchors: list[tuple[int, ...]]
    place: np.ndarray | None
    left: float
    gain: float


def wrong_anchors_text(wrong: WrongAnchors, names: list[str]) -> str:
    """Return a sentence on the wrong anchors; names: of the map's anchors (n)."""
    better = f"the ranges better, by {1.0 - wrong.left:.0%} of the squares"
    if wrong.place is not None:
        place = point_text(np.round(wrong.place, 1) + 0.0)
        return f"anchor {names[wrong.anchors[0][0]]}: about {place} fits {better}: moved, or surveyed wrongly?"
    pairs = ", or ".join(f"{names[i]} and {names[j]}" for i, j in wrong.anchors)
    return f"anchors {pairs}: exchanged they fit {better}: do their places, or their topics, stand for each other?"


@cached_njit
def follow_ranges(bank: AnchorBank, events: Events, acceleration: float, sd: float, gate: float) -> None:
    """Take the ranges and differences among events in, in order.

    Args:
        bank: the filters; changed.
        events: in order of time.
        acceleration: white process noise [m/s²/√Hz].
        sd: standard deviation of a range [m].
        gate: innovations beyond so many deviations have less weight; if they were left out, a filter that began in a
            wrong place would stay there.
    """
    m, n = bank.anchors.shape[:2]
    N, at = 9 + n, 6 + n
    y, V, error, S, GT = np.empty(1), np.empty(1), np.zeros(N), np.empty((1, 1)), np.empty((1, N + 1))
    where, H = np.zeros((1, 8), np.int64), np.zeros((1, 8))  # a row's entries: of p, one or two biases, the shift
    where[0, :3], where[0, 5:] = np.arange(3), np.arange(at, N)
    for k in range(len(events.t)):
        if events.kind[k] != RANGE:
            continue
        h, other = events.t[k] - bank.marks[0], events.other[k]
        bank.marks[0] = events.t[k]
        bank.marks[1] += 1.0
        bank.marks[2] += other >= 0
        q, kept = acceleration**2 * h, np.exp(-h / MEMORY)
        bank.lately[:] *= kept
        bank.marks[3] = kept * bank.marks[3] + 1.0
        for j in range(m):
            if bank.score[j] < bank.score[0] - HOPELESS and bank.louder[j] == 1.0:
                bank.lately[j, 0] = -np.inf
                continue
            x, C = bank.x[j], bank.C[j]
            if h > 0.0:
                x[:3] += h * x[3:6]
                C[:3] += h * C[3:6]
                C[:, :3] += h * C[:, 3:6]
                for a in range(3):
                    C[a, a] += q * h * h / 3.0
                    C[a, 3 + a] += q * h / 2.0
                    C[3 + a, a] += q * h / 2.0
                    C[3 + a, 3 + a] += q
            H[:], y[0], V[0], error[:] = 0.0, events.r[k], 0.0, 0.0
            for entry, sign, i in ((3, 1.0, events.which[k]), (4, -1.0, other)):
                if i < 0:
                    continue
                d = x[:3] - bank.anchors[j, i]
                if i == bank.free[j]:
                    d -= x[at:]
                r = max(np.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]), 1e-3)
                y[0] -= sign * (r + x[6 + i])
                V[0] += (bank.louder[j] * sd) ** 2
                where[0, entry], H[0, entry] = 6 + i, sign
                for a in range(3):
                    H[0, a] += sign * d[a] / r
                    if i == bank.free[j]:
                        H[0, 5 + a] = -sign * d[a] / r
            innovation(error, C, y, V, 1, 0, where, H, S, GT)
            squared = y[0] ** 2 / S[0, 0]
            counted = min(squared, gate**2)
            loss = 0.5 * (np.log(S[0, 0]) + counted)
            bank.score[j] -= loss
            bank.squares[j] += counted
            bank.lately[j, 0] -= loss
            bank.lately[j, 1] += counted
            if squared > gate**2:
                S[0, 0] += V[0] * (np.sqrt(squared) / gate - 1.0)
            correct(error, C, 1, S, GT)
            x += error


class AnchorWatch:
    """The bank for anchors (n, 3) by a map's settings, fed with the ranges of a live filter.

    Attributes:
        stated: the standard deviation of a range that the live filter assumes [m].
        wrong: the first anchors whose entries were wrong for LASTS, None if there are none.
        suspected: whether another map explains the ranges better now, even if it is too early to tell, or did before.
        scatter: the deviation of a range that explains the ranges best, if the map's is much too small, else None [m].
    """

    def __init__(self, anchors: np.ndarray, settings: FilterSettings, stated: float):
        self._anchors, self._settings, self.stated = anchors, settings, stated
        self._bank: AnchorBank | None = None
        self._began, self._since, self._noisy_since = 0.0, np.inf, np.inf
        self._which: list[tuple[int, ...]] = []
        self.wrong: WrongAnchors | None = None
        self.suspected = False
        self.scatter: float | None = None

    def advance(self, events: Events, antenna: np.ndarray, t: float, sd: float) -> None:
        """Take the ranges among events in; after them, at t [s], the antenna's place (3) has a deviation sd [m].

        The filters begin at this place, once sd is at most FIRST, and begin anew there if no ranges came for SILENT.
        """
        s, bank = self._settings, self._bank
        if bank is None or ((events.kind == RANGE).any() and t - bank.marks[0] > SILENT):
            if sd > FIRST[0]:
                return
            if bank is None:
                self._bank, self._began = anchor_bank(self._anchors, antenna, t, s.bias_start), t
            else:
                _begin_anew(bank, antenna, t)
            return
        range_sd = max(s.baseline_range, float(np.hypot(s.range_white, s.range_correlated)))
        follow_ranges(bank, events, s.baseline_acceleration, range_sd, s.baseline_gate)
        found = judged(bank)
        self.suspected = found is not None or self.wrong is not None
        which = [] if found is None else found.anchors
        if which != self._which:
            self._which, self._since = which, t
        if self.wrong is None and found is not None:
            pairs = found.place is None
            if t - self._began > SETTLED[pairs] and t - self._since >= LASTS[pairs] and found.gain > GAINS[pairs]:
                self.wrong = found
        scatter = range_sd * noise_found(bank)
        noisy = scatter >= NOISY * range_sd and scatter <= MOST_SCATTER
        self._noisy_since = min(self._noisy_since, t) if noisy else np.inf
        self.scatter = scatter if t - max(self._noisy_since, self._began + SETTLED[1]) >= LASTS[1] else None

    @property
    def widened(self) -> float:
        """The ratio of the ranges' variance to the live filter's; 1 if the noise is not too small."""
        return 1.0 if self.scatter is None else (self.scatter / self.stated) ** 2

    @property
    def judges(self) -> bool:
        """Whether the filters have heard enough to tell an exchange or larger noise, if there were one."""
        return self._bank is not None and self._bank.marks[0] - self._began > SETTLED[1] + MEMORY


def _begin_anew(bank: AnchorBank, antenna: np.ndarray, t: float) -> None:
    """Set position and velocity of all filters anew, at the antenna's place (3), at t [s]; biases and shifts stay."""
    bank.x[:, :3], bank.x[:, 3:6], bank.marks[0] = antenna, 0.0, t
    bank.C[:, :6], bank.C[:, :, :6] = 0.0, 0.0
    bank.C[:, range(6), range(6)] = np.square([FIRST[0]] * 3 + [FIRST[1]] * 3)


def judged(bank: AnchorBank) -> WrongAnchors | None:
    """Return the wrong anchors by filters that have taken ranges in, if one map explains the ranges clearly best.

    Differences tell no place: their errors depend on the vehicle's place, as those of a wrong anchor do. The larger the
    best map's mean e²/S is, the more it must gain; beyond FITS it does not fit either. Larger errors of the ranges must
    not explain them as well.
    """
    n, best, loud = bank.anchors.shape[1], int(np.argmax(bank.score)), len(bank.score) - len(LOUDER)
    nis = float(bank.squares[best] / max(bank.marks[1], 1.0))
    if best >= loud or nis > FITS:
        return None
    gains = (bank.score - max(bank.score[0], *bank.score[loud:])) / max(1.0, nis)
    left = float(bank.squares[best] / max(bank.squares[0], 1e-9))
    lacks = max(NEARLY[0], NEARLY[1] * gains[best]) if best > n else NEARLY[0]
    near = np.flatnonzero(gains >= gains[best] - lacks)
    if gains[best] <= GAINS[0] or left > SHRINKS:
        return None
    if best > n and near[0] <= n:
        return None  # a wrong place explains the ranges as well as the exchange
    if best > n:
        pairs = list(combinations(range(n), 2))
        return WrongAnchors([pairs[k - 1 - n] for k in near if k > n], None, left, float(gains[best]))
    shift = bank.x[best, 6 + n :]
    if len(near) > 1 or np.linalg.norm(shift) < FAR or bank.marks[2]:
        return None
    return WrongAnchors([(best - 1,)], bank.anchors[0, best - 1] + shift, left, float(gains[best]))


def noise_found(bank: AnchorBank) -> float:
    """Return the ratio of the ranges' deviation to the map's, if a louder filter explains them clearly best; else 1.

    The ratio follows from the recent e²/S of the best louder filter, in which the position's share is small.
    """
    score, squares = bank.lately.T
    best = int(np.argmax(score))
    if bank.louder[best] == 1.0 or score[best] - score[0] <= GAINS[1]:
        return 1.0
    return float(bank.louder[best] * np.sqrt(squares[best] / bank.marks[3]))
