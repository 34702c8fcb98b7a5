"""A network of ranges: its weighted residuals, their Jacobian, and the covariance of its anchors."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array, csr_array

from ortilo_drake.model.input_error import InputError

_LEAST_INFORMATION = 1e-4  # of an anchor in any direction [1/m^2]: it is lost by a hundred metres
_DAMPING = 1e-9  # of a place whose ranges leave a direction open, relative


class Ranges(NamedTuple):
    """Measured ranges from places to anchors, and between anchors.

    Attributes:
        place: number of the vehicle's place of each range (m).
        anchor: number of its anchor (m).
        distance: the range (m) [m].
        between: numbers of two anchors (l, 2).
        between_distance: the range between them (l) [m].
        p: where the vehicle was believed to be, NaN where nothing is known (k, 3) [m].
        p_sd: standard deviation of that per axis, inf where it only starts the search (k) [m].
    """

    place: np.ndarray
    anchor: np.ndarray
    distance: np.ndarray
    between: np.ndarray
    between_distance: np.ndarray
    p: np.ndarray
    p_sd: np.ndarray


class Network:
    """The unknowns x = [free anchors; places], row by row, of ranges with standard deviations.

    Args:
        ranges: what was measured.
        anchors: p_W, of which those that are not free stay (n, 3) [m].
        free: numbers of those that are sought.
    """

    def __init__(self, ranges: Ranges, anchors: np.ndarray, free: Sequence[int]):
        self.ranges, self.free = ranges, list(free)
        self._anchors, self._first = anchors, 3 * len(self.free)
        self._column = np.full(len(anchors), -1)
        self._column[self.free] = 3 * np.arange(len(self.free))
        self._trusted = np.flatnonzero(np.isfinite(ranges.p_sd))

    def unpacked(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return anchors (n, 3) and places (k, 3)."""
        anchors = self._anchors.copy()
        anchors[self.free] = x[: self._first].reshape(-1, 3)
        return anchors, x[self._first :].reshape(-1, 3)

    def lines(self, x: np.ndarray) -> np.ndarray:
        """Return the vectors that the ranges are the lengths of, those between anchors last (m + l, 3)."""
        anchors, places = self.unpacked(x)
        i, j = self.ranges.between.T
        return np.concatenate([places[self.ranges.place] - anchors[self.ranges.anchor], anchors[i] - anchors[j]])

    def residuals(self, x: np.ndarray, sd: np.ndarray) -> np.ndarray:
        """Return the weighted residuals, the ranges' (m + l), of standard deviations sd, then the trusted places'."""
        trusted = self._trusted
        measured = np.concatenate([self.ranges.distance, self.ranges.between_distance])
        moved = (self.unpacked(x)[1][trusted] - self.ranges.p[trusted]) / self.ranges.p_sd[trusted, None]
        return np.concatenate([(np.linalg.norm(self.lines(x), axis=1) - measured) / sd, moved.ravel()])

    def jacobian(self, x: np.ndarray, sd: np.ndarray) -> csr_array:
        """Return the derivatives of the residuals by x."""
        ranges, lines = self.ranges, self.lines(x)
        g = lines / np.maximum(np.linalg.norm(lines, axis=1), 1e-9)[:, None] / sd[:, None]
        total = len(lines)
        i, j = ranges.between.T
        ends = np.concatenate([self._first + 3 * ranges.place, self._column[i]])
        starts = np.concatenate([self._column[ranges.anchor], self._column[j]])
        row = np.concatenate([np.arange(total), np.arange(total)])
        column, value = np.concatenate([ends, starts]), np.concatenate([g, -g])
        there = column >= 0
        own = self._first + (3 * self._trusted[:, None] + np.arange(3)).ravel()
        rows = np.concatenate([np.repeat(row[there], 3), total + np.arange(len(own))])
        columns = np.concatenate([(column[there, None] + np.arange(3)).ravel(), own])
        values = np.concatenate([value[there].ravel(), np.repeat(1.0 / ranges.p_sd[self._trusted], 3)])
        shape = (total + len(own), self._first + 3 * len(ranges.p))
        return coo_array((values, (rows, columns)), shape=shape).tocsr()

    def covariance(self, x: np.ndarray, sd: np.ndarray) -> np.ndarray:
        """Return (N_aa - N_ap N_pp^-1 N_pa)^-1 of the free anchors, row by row.

        Raises:
            InputError: if the ranges leave an anchor open in some direction.
        """
        J, a = self.jacobian(x, sd), self._first
        N = (J.T @ J).tocsr()
        S = N[:a, :a].toarray()
        if len(self.ranges.p):
            blocks = np.array([N[k : k + 3, k : k + 3].toarray() for k in range(a, N.shape[0], 3)])
            blocks += _DAMPING * np.trace(blocks, axis1=1, axis2=2)[:, None, None] * np.eye(3)
            N_pa = N[a:, :a].toarray().reshape(-1, 3, a)
            S -= np.einsum("kia,kib->ab", N_pa, np.linalg.solve(blocks, N_pa))
        values, vectors = np.linalg.eigh(S)
        if values[0] < _LEAST_INFORMATION:
            worst = self.free[int(np.argmax(np.abs(vectors[:, 0]))) // 3]
            raise InputError(f"anchor {worst}: the ranges to it leave its place open: it needs more, from elsewhere")
        return np.asarray((vectors / values) @ vectors.T)
