"""The anchor that is not where the map has it, by constant-velocity filters of which each frees one anchor's place.

The filter that flies estimates a bias for each anchor, and that takes most of a wrong place up. These filters have the
biases too, and one of them in addition the place of one anchor: if that anchor is elsewhere, it predicts all ranges
better. They need no imu, so a wrong heading does not disturb them. What counts as better is as in replay's
moved_by_filter.py, where the places tried come from a fit.

State of each: p and v of the antenna, the biases c (n), the anchor's shift d (3):

    p' = v,   v' = white,   range to anchor i = |p - a_i - d (if i is free)| + c_i + white
"""

from typing import Final, NamedTuple

import numpy as np
from numba import njit

from ortilo_drake.interop.recorded.map_file import FilterSettings
from ortilo_drake.studies.recorded.filter_types import RANGE, Events
from ortilo_drake.studies.recorded.moved_by_filter import SHRINKS

SETTLED: Final = 30.0  # before that nothing is told: ranges whose errors last fit any place for a while [s]
GAINS: Final = (15.0, 3.0)  # of the log-likelihood, over the map's place and over the second anchor
FAR: Final = 0.2  # a shift that is told [m]
LASTS: Final = 3.0  # for so long [s]
PLACE: Final = 0.5  # standard deviation of a shift [m]
FIRST: Final = (0.5, 1.0)  # of position and velocity at the start [m], [m/s]
SILENT: Final = 1.5  # without ranges for longer, position and velocity begin anew [s]


class AnchorBank(NamedTuple):
    """The filters, the first without a free anchor: all of it changes.

    States (1 + n, 9 + n) and covariances; log-likelihoods and sums of squared innovations over their variances, none
    above the gate's (1 + n each); the stamp and the number of ranges (2).
    """

    x: np.ndarray
    C: np.ndarray
    score: np.ndarray
    squares: np.ndarray
    marks: np.ndarray


def anchor_bank(p: np.ndarray, t: float, n: int, bias: float) -> AnchorBank:
    """Return the filters of n anchors that begin with the antenna at p (3) at t [s]; biases have a deviation [m]."""
    N = 9 + n
    x, C = np.zeros((1 + n, N)), np.zeros((1 + n, N, N))
    x[:, :3] = p
    deviations = np.array([FIRST[0]] * 3 + [FIRST[1]] * 3 + [bias] * n + [PLACE] * 3)
    C[:] = np.diag(deviations**2)
    C[0, 6 + n :, 6 + n :] = 0.0
    return AnchorBank(x, C, np.zeros(1 + n), np.zeros(1 + n), np.array([t, 0.0]))


class MovedAnchor(NamedTuple):
    """An anchor's index, where the ranges have it (3) [m], and the share of the squared innovations that is left."""

    anchor: int
    place: np.ndarray
    left: float


@njit(cache=True)
def follow_ranges(
    bank: AnchorBank, events: Events, anchors: np.ndarray, acceleration: float, sd: float, gate: float
) -> None:
    """Take the ranges among events in, in order; differences are left out.

    Args:
        bank: the filters; changed.
        events: in order.
        anchors: as the map has them (n, 3).
        acceleration: white [m/s²/√Hz].
        sd: of a range [m].
        gate: innovations beyond so many deviations are not used.
    """
    n = len(anchors)
    N, at = 9 + n, 6 + n
    H, CH = np.zeros(N), np.empty(N)
    for k in range(len(events.t)):
        if events.kind[k] != RANGE or events.other[k] >= 0:
            continue
        h, i = events.t[k] - bank.marks[0], events.which[k]
        bank.marks[0] = events.t[k]
        bank.marks[1] += 1.0
        q = acceleration**2 * h
        for j in range(1 + n):
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
            free = j == i + 1
            d0, d1, d2 = x[0] - anchors[i, 0], x[1] - anchors[i, 1], x[2] - anchors[i, 2]
            if free:
                d0, d1, d2 = d0 - x[at], d1 - x[at + 1], d2 - x[at + 2]
            r = max(np.sqrt(d0 * d0 + d1 * d1 + d2 * d2), 1e-3)
            H[:] = 0.0
            H[0], H[1], H[2], H[6 + i] = d0 / r, d1 / r, d2 / r, 1.0
            if free:
                H[at], H[at + 1], H[at + 2] = -H[0], -H[1], -H[2]
            for a in range(N):
                CH[a] = C[a, 0] * H[0] + C[a, 1] * H[1] + C[a, 2] * H[2] + C[a, 6 + i]
                if free:
                    CH[a] += C[a, at] * H[at] + C[a, at + 1] * H[at + 1] + C[a, at + 2] * H[at + 2]
            own = CH[0] * H[0] + CH[1] * H[1] + CH[2] * H[2] + CH[6 + i]
            if free:
                own += CH[at] * H[at] + CH[at + 1] * H[at + 1] + CH[at + 2] * H[at + 2]
            S = own + sd**2
            e = events.r[k] - r - x[6 + i]
            squared = e * e / S
            bank.score[j] -= 0.5 * (np.log(S) + min(squared, gate**2))
            bank.squares[j] += min(squared, gate**2)
            if squared <= gate**2:
                for a in range(N):
                    g = CH[a] / S
                    x[a] += g * e
                    for b in range(N):
                        C[a, b] -= g * CH[b]


class AnchorWatch:
    """The filters of anchors (n, 3) by a map's settings, fed with the ranges of a live filter.

    Attributes:
        moved: the first anchor that was not where the map has it for LASTS, None if none was.
    """

    def __init__(self, anchors: np.ndarray, settings: FilterSettings):
        self._anchors, self._settings = anchors, settings
        self._bank: AnchorBank | None = None
        self._began, self._since, self._which = 0.0, np.inf, -1
        self.moved: MovedAnchor | None = None

    def advance(self, events: Events, antenna: np.ndarray, t: float, sd: float) -> None:
        """Take the ranges among events in; the antenna is at (3) behind them, at t [s], with a deviation [m].

        There the filters begin, and begin anew if no ranges came for SILENT, once that is known to FIRST.
        """
        s, bank = self._settings, self._bank
        if bank is None or ((events.kind == RANGE).any() and t - bank.marks[0] > SILENT):
            if sd > FIRST[0]:
                return
            if bank is None:
                self._bank, self._began = anchor_bank(antenna, t, len(self._anchors), s.bias_start), t
            else:
                _begin_anew(bank, antenna, t)
            return
        follow_ranges(bank, events, self._anchors, s.baseline_acceleration, s.baseline_range, s.baseline_gate)
        found = _judged(bank, self._anchors) if t - self._began > SETTLED else None
        which = -1 if found is None else found.anchor
        if which != self._which:
            self._which, self._since = which, t
        if self.moved is None and found is not None and t - self._since >= LASTS:
            self.moved = found


def _begin_anew(bank: AnchorBank, antenna: np.ndarray, t: float) -> None:
    """Put all filters to the antenna at (3), at t [s]; what they know of biases and places stays."""
    bank.x[:, :3], bank.x[:, 3:6], bank.marks[0] = antenna, 0.0, t
    bank.C[:, :6], bank.C[:, :, :6] = 0.0, 0.0
    bank.C[:, range(6), range(6)] = np.square([FIRST[0]] * 3 + [FIRST[1]] * 3)


def _judged(bank: AnchorBank, anchors: np.ndarray) -> MovedAnchor | None:
    gains = bank.score[1:] - bank.score[0]
    i, n = int(np.argmax(gains)), len(anchors)
    second = float(np.max(np.delete(gains, i)))
    left, shift = float(bank.squares[1 + i] / max(bank.squares[0], 1e-9)), bank.x[1 + i, 6 + n :]
    clear = gains[i] > GAINS[0] and gains[i] - second > GAINS[1] and left <= SHRINKS
    return MovedAnchor(i, anchors[i] + shift, left) if clear and np.linalg.norm(shift) > FAR else None
