"""A network of ranges: weighted residuals, their Jacobian, the anchors' covariance, and mirror images of anchors.

Distances between all anchors give their first positions, by classical multidimensional scaling. With D the matrix of
squared distances and C = I - 1 1^T / n, B = -C D C / 2 holds the inner products about the centroid; its three largest
eigenvalues and their eigenvectors give the positions up to a motion and a reflection (Torgerson, "Multidimensional
scaling: I. Theory and method", Psychometrika 17, 1952). Three known points then give both mirror images (Kabsch, Acta
Crystallographica A32, 1976). A distance that was not measured is taken along the shortest way over those that were
(Tenenbaum, de Silva and Langford, Science 290, 2000).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import shortest_path
from scipy.spatial.transform import Rotation

from ortilo_drake.model.input_error import InputError


def all_distances(pairs: np.ndarray, distance: np.ndarray, n: int) -> np.ndarray:
    """Return the distances between n points (n, n) [m], inf if no chain of pairs connects them.

    distance (l) [m] belongs to the pairs (l, 2) of points; the distances of a repeated pair are averaged.
    """
    low, high = np.sort(pairs.reshape(-1, 2), axis=1).T
    key, which = np.unique(low * n + high, return_inverse=True)
    mean = np.bincount(which, distance) / np.bincount(which)
    graph = coo_array((mean, (key // n, key % n)), shape=(n, n)).tocsr()
    return np.asarray(shortest_path(graph, directed=False))


def scaled(distances: np.ndarray) -> np.ndarray:
    """Return points (n, 3) about their centroid whose distances fit these (n, n) as well as three axes allow."""
    n = len(distances)
    C = np.eye(n) - 1.0 / n
    values, vectors = np.linalg.eigh(-0.5 * C @ distances**2 @ C)
    return np.asarray(vectors[:, :-4:-1] * np.sqrt(np.maximum(values[:-4:-1], 0.0)))


def aligned(points: np.ndarray, known: np.ndarray, sign: float) -> np.ndarray:
    """Return points (n, 3), mirrored for sign -1, moved so that the first m lie best on the known ones (m, 3)."""
    moved = points * [1.0, 1.0, sign]
    at, to = moved[: len(known)].mean(axis=0), known.mean(axis=0)
    turn, _ = Rotation.align_vectors(known - to, moved[: len(known)] - at)
    return np.asarray(turn.apply(moved - at) + to)


def mirror_images(
    pairs: np.ndarray, distance: np.ndarray, believed: np.ndarray, known: Sequence[int]
) -> list[np.ndarray]:
    """Return both mirror images of the points (n, 3), with the known ones in place; none if pairs do not connect them.

    distance (l) [m] belongs to the pairs (l, 2) of points; `known` are the indices of the points that are where
    `believed` (n, 3) [m] has them.
    """
    n = len(believed)
    if not len(pairs):
        return []
    D = all_distances(pairs, distance, n)
    for i in known:
        D[i, known] = np.linalg.norm(believed[i] - believed[list(known)], axis=1)
    if not np.isfinite(D).all():
        return []
    order = [*known, *(i for i in range(n) if i not in known)]
    found = scaled(D[np.ix_(order, order)])
    images = []
    for sign in (1.0, -1.0):
        image = np.empty_like(believed)
        image[order] = aligned(found, believed[list(known)], sign)
        image[list(known)] = believed[list(known)]
        images.append(image)
    return images


_LEAST_INFORMATION = 1e-4  # least information on an anchor in any direction [1/m^2]: an sd of a hundred metres
_DAMPING = 1e-9  # relative damping for a place whose ranges leave a direction open


class Ranges(NamedTuple):
    """Measured ranges from places to anchors, and between anchors.

    Each range (m) has the indices of the vehicle's place and of the anchor, and a distance [m]. between (l, 2) are
    pairs of anchors, between_distance (l) [m] their distances. p (k, 3) [m] are the assumed places, NaN if unknown;
    p_sd (k) [m] is their standard deviation per axis, inf if p only starts the search.
    """

    place: np.ndarray
    anchor: np.ndarray
    distance: np.ndarray
    between: np.ndarray
    between_distance: np.ndarray
    p: np.ndarray
    p_sd: np.ndarray


class Network:
    """The least-squares problem of ranges with the unknowns x = [free anchors; places], row by row.

    `free` are the indices of the free anchors; the others stay at p_W (n, 3) [m].
    """

    def __init__(self, ranges: Ranges, anchors: np.ndarray, free: Sequence[int]):
        self.ranges, self.free = ranges, list(free)
        self._anchors, self._first = anchors, 3 * len(self.free)
        self._column = np.full(len(anchors), -1)
        self._column[self.free] = 3 * np.arange(len(self.free))
        self._trusted = np.flatnonzero(np.isfinite(ranges.p_sd))

    def unpacked(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return anchors (n, 3) and places (k, 3) of x [m]."""
        anchors = self._anchors.copy()
        anchors[self.free] = x[: self._first].reshape(-1, 3)
        return anchors, x[self._first :].reshape(-1, 3)

    def lines(self, x: np.ndarray) -> np.ndarray:
        """Return the vectors along the ranges, those between anchors last (m + l, 3) [m]."""
        anchors, places = self.unpacked(x)
        i, j = self.ranges.between.T
        return np.concatenate([places[self.ranges.place] - anchors[self.ranges.anchor], anchors[i] - anchors[j]])

    def residuals(self, x: np.ndarray, sd: np.ndarray) -> np.ndarray:
        """Return the weighted residuals: of the ranges (m + l) with deviations sd, then of the trusted places."""
        trusted = self._trusted
        measured = np.concatenate([self.ranges.distance, self.ranges.between_distance])
        moved = (self.unpacked(x)[1][trusted] - self.ranges.p[trusted]) / self.ranges.p_sd[trusted, None]
        return np.concatenate([(np.linalg.norm(self.lines(x), axis=1) - measured) / sd, moved.ravel()])

    def jacobian(self, x: np.ndarray, sd: np.ndarray) -> csr_array:
        """Return the derivatives of the residuals by x (rows, x)."""
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

        InputError if the ranges leave an anchor open in some direction.
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


FLAT = 0.3  # places this near to a plane (RMS) hardly tell its two sides apart [m]
GAIN = 1e-6  # least relative fall of the cost that counts


def plane_of(places: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Return the RMS distance of points (n, 3) to their best plane, their mean (3) and the plane's normal (3)."""
    center = places.mean(axis=0)
    _, size, axes = np.linalg.svd(places - center, full_matrices=False)
    return float(size[-1] / np.sqrt(len(places))), center, axes[-1]


def _misses(a: np.ndarray, ends: np.ndarray, measured: np.ndarray, sd: np.ndarray) -> np.ndarray:
    return np.asarray((np.linalg.norm(a - ends, axis=1) - measured) / sd)


def better_sides(network: Network, x: np.ndarray, sd: np.ndarray, loss: str) -> tuple[np.ndarray, bool]:
    """Return the unknowns x, as fitted, with every anchor on the side where it fits better, and whether any changed.

    If the vehicle flew at one height, the places hardly tell an anchor from its mirror image in their plane, and a
    descent does not cross from one to the other. So each anchor is fitted again alone from its image, with the rest
    fixed. sd (m + l) [m] are the ranges' standard deviations; loss is as in scipy.optimize.least_squares.
    """
    anchors, places = network.unpacked(x)
    if len(places) < 3:
        return x, False
    flat, center, normal = plane_of(places)
    if flat > FLAT:
        return x, False
    ranges, changed = network.ranges, False
    m = len(ranges.distance)
    for i in network.free:
        first, second = ranges.between.T
        rows = np.concatenate([ranges.anchor == i, (first == i) | (second == i)])
        other = np.where(first == i, second, first)[rows[m:]]
        ends = np.concatenate([places[ranges.place[rows[:m]]], anchors[other]])
        measured = np.concatenate([ranges.distance, ranges.between_distance])[rows]
        image = anchors[i] - 2.0 * ((anchors[i] - center) @ normal) * normal
        known = (ends, measured, sd[rows])
        here, there = (least_squares(_misses, start, loss=loss, args=known) for start in (anchors[i], image))
        if there.cost < here.cost * (1.0 - GAIN):
            anchors[i], changed = there.x, True
    return np.concatenate([anchors[network.free].ravel(), places.ravel()]), changed
