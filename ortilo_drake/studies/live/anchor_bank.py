"""The anchor that is not where the map has it, or the two that changed places, by constant-velocity filters.

The filter that flies estimates a bias for each anchor, and that takes most of a wrong place up. These filters have the
biases too, and each goes by another map: the user's; with one anchor's place free; with two anchors exchanged; the
user's with larger errors of the ranges. If such a map is the right one, it predicts all ranges better. They need no
imu, so a wrong heading does not disturb them.

State of each: p and v of the antenna, the biases c (n), the free anchor's shift d (3), which stays 0 without one:

    p' = v,   v' = white,   range to anchor i = |p - a_i - d (if i is free)| + c_i + white

and a difference is one such range less another.
"""

from itertools import combinations
from typing import Final, NamedTuple

import numpy as np

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.interop.recorded.map_file import FilterSettings
from ortilo_drake.studies.recorded.filter_types import RANGE, Events, Noise
from ortilo_drake.studies.recorded.moved_anchors import point_text

SETTLED: Final = (30.0, 5.0)  # before that no place, no exchange is told: errors that last fit any place a while [s]
GAINS: Final = (15.0, 100.0)  # of the log-likelihood over the map's: of a place, of an exchange, which moves more
SHRINKS: Final = 0.92  # to this share, in the squares: in real rooms errors that depend on the place give 4 % less
FAR: Final = 0.2  # a shift that is told [m]
LASTS: Final = (3.0, 1.0)  # for so long: a place, an exchange [s]
PLACE: Final = 0.5  # standard deviation of a shift [m]
FIRST: Final = (0.5, 1.0)  # of position and velocity at the start [m], [m/s]
SILENT: Final = 1.5  # without ranges for longer, position and velocity begin anew [s]
NEARLY: Final = (3.0, 0.1)  # what maps may lack, or of an exchange's gain the share, and fit as well: mirror images
LOUDER: Final = (2.0, 4.0, 8.0)  # times the map's deviation of a range, which may be too small
NOISY: Final = 2.0  # times the map's deviation from which it is told
MOST_SCATTER: Final = 0.5  # a larger deviation is none of ranges, but something wrong [m]
MEMORY: Final = 10.0  # over which noise is judged, as ranges of a vehicle at rest scatter less [s]
FITS: Final = 2.0  # mean squared innovation over its variance, at most, of a map that is told
HOPELESS: Final = 200.0  # log-likelihood below the map's from which a filter is left out for good


class AnchorBank(NamedTuple):
    """The filters of m maps: the user's, those with a free anchor, those with two exchanged, and the user's, louder.

    States (m, 9 + n) and covariances, log-likelihoods and sums of squared innovations over their variances, none above
    the gate's (m each), both again of the last MEMORY (m, 2), and the stamp, the numbers of ranges and of differences,
    and of ranges of the last MEMORY (4) change; anchors (m, n, 3), the
    free anchor, -1 for none (m), and how many times as large as the map's the ranges' deviation is (m), do not.
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
    """Return the filters of anchors (n, 3) that begin with the antenna at p (3) at t [s]; biases have a deviation."""
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
    """Return the deviation of a range, white and lasting [m]."""
    return float(np.hypot(noise.range_white, noise.range_correlated))


class WrongAnchors(NamedTuple):
    """Anchors whose entries are wrong: one, with its place by the ranges (3) [m], or pairs that changed places.

    Of several pairs each explains the ranges as well. `left` is the share of the squared innovations that is left,
    `gain` that of the log-likelihood.
    """

    anchors: list[tuple[int, ...]]
    place: np.ndarray | None
    left: float
    gain: float


def wrong_anchors_text(wrong: WrongAnchors, names: list[str]) -> str:
    """Return what is wrong of the anchors, which a map calls so, as a sentence."""
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
        events: in order.
        acceleration: white [m/s²/√Hz].
        sd: of a range [m].
        gate: innovations beyond so many deviations count less; were they left out, a filter that began elsewhere would
            stay there.
    """
    m, n = bank.anchors.shape[:2]
    N, at = 9 + n, 6 + n
    H, CH = np.empty(N), np.empty(N)
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
            H[:], e, variance = 0.0, events.r[k], 0.0
            for sign, i in ((1.0, events.which[k]), (-1.0, other)):
                if i < 0:
                    continue
                d = x[:3] - bank.anchors[j, i]
                if i == bank.free[j]:
                    d -= x[at:]
                r = max(np.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]), 1e-3)
                e -= sign * (r + x[6 + i])
                variance += (bank.louder[j] * sd) ** 2
                H[6 + i] = sign
                for a in range(3):
                    H[a] += sign * d[a] / r
                    if i == bank.free[j]:
                        H[at + a] = -sign * d[a] / r
            used = N if bank.free[j] >= 0 else at
            S = variance
            for a in range(used):
                CH[a] = 0.0
                for b in range(used):
                    CH[a] += C[a, b] * H[b]
                S += H[a] * CH[a]
            squared = e * e / S
            counted = min(squared, gate**2)
            loss = 0.5 * (np.log(S) + counted)
            bank.score[j] -= loss
            bank.squares[j] += counted
            bank.lately[j, 0] -= loss
            bank.lately[j, 1] += counted
            if squared > gate**2:
                S += variance * (np.sqrt(squared) / gate - 1.0)
            for a in range(used):
                g = CH[a] / S
                x[a] += g * e
                for b in range(used):
                    C[a, b] -= g * CH[b]


class AnchorWatch:
    """The filters of anchors (n, 3) by a map's settings, fed with the ranges of a live filter.

    Attributes:
        stated: the deviation of a range that the live filter goes by [m].
        wrong: the first anchors whose entries were wrong for LASTS, None if none were.
        suspected: whether another map explains the ranges better now, be it too early to say so, or did once.
        scatter: the deviation of a range that explains them best where the map's is much too small, else None [m].
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
        """Take the ranges among events in; the antenna is at (3) behind them, at t [s], with a deviation [m].

        There the filters begin, and begin anew if no ranges came for SILENT, once that is known to FIRST.
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
        """How many times as large as the live filter's the ranges' variance is; 1 where nothing says so."""
        return 1.0 if self.scatter is None else (self.scatter / self.stated) ** 2

    @property
    def judges(self) -> bool:
        """Whether the filters have heard enough to name an exchange or larger noise, if that were it."""
        return self._bank is not None and self._bank.marks[0] - self._began > SETTLED[1] + MEMORY


def _begin_anew(bank: AnchorBank, antenna: np.ndarray, t: float) -> None:
    """Put all filters to the antenna at (3), at t [s]; what they know of biases and places stays."""
    bank.x[:, :3], bank.x[:, 3:6], bank.marks[0] = antenna, 0.0, t
    bank.C[:, :6], bank.C[:, :, :6] = 0.0, 0.0
    bank.C[:, range(6), range(6)] = np.square([FIRST[0]] * 3 + [FIRST[1]] * 3)


def judged(bank: AnchorBank) -> WrongAnchors | None:
    """Return which anchors are wrong by filters that have taken ranges in, if one map explains them clearly best.

    Of differences no place is told: their errors depend on where the vehicle is, as a wrong place's would. The larger
    the best one's innovations are beside their variances, the more must be gained; beyond FITS it does not fit, either,
    and larger errors must not explain the ranges as well.
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
        return None  # a place explains them as well
    if best > n:
        pairs = list(combinations(range(n), 2))
        return WrongAnchors([pairs[k - 1 - n] for k in near if k > n], None, left, float(gains[best]))
    shift = bank.x[best, 6 + n :]
    if len(near) > 1 or np.linalg.norm(shift) < FAR or bank.marks[2]:
        return None
    return WrongAnchors([(best - 1,)], bank.anchors[0, best - 1] + shift, left, float(gains[best]))


def noise_found(bank: AnchorBank) -> float:
    """Return how many times as large as the map's the ranges' deviation is, if that explains them clearly best; else 1.

    It follows from the last squared innovations of the best of the louder filters, in which the position's share is
    small.
    """
    score, squares = bank.lately.T
    best = int(np.argmax(score))
    if bank.louder[best] == 1.0 or score[best] - score[0] <= GAINS[1]:
        return 1.0
    return float(bank.louder[best] * np.sqrt(squares[best] / bank.marks[3]))
