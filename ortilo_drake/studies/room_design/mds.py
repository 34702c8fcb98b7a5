"""Positions from distances between all of them: classical multidimensional scaling.

With D the matrix of squared distances and C = I - 1 1^T / n, B = -C D C / 2 holds the inner products about the
centroid; its three largest eigenvalues and their eigenvectors give the positions up to a motion and a reflection
(Torgerson, "Multidimensional scaling: I. Theory and method", Psychometrika 17, 1952). Three known points then give
both mirror images (Kabsch, Acta Crystallographica A32, 1976). A distance that was not measured is taken along the
shortest way over those that were (Tenenbaum, de Silva and Langford, Science 290, 2000).
"""

from collections.abc import Sequence

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import shortest_path
from scipy.spatial.transform import Rotation


def all_distances(pairs: np.ndarray, distance: np.ndarray, n: int) -> np.ndarray:
    """Return the distances between n points (n, n) [m], inf where no way of pairs leads.

    Between two points, pairs (l, 2), there are distances (l) [m]; a pair may come more than once, and is averaged.
    """
    low, high = np.sort(pairs.reshape(-1, 2), axis=1).T
    key, which = np.unique(low * n + high, return_inverse=True)
    mean = np.bincount(which, distance) / np.bincount(which)
    graph = coo_array((mean, (key // n, key % n)), shape=(n, n)).tocsr()
    return np.asarray(shortest_path(graph, directed=False))


def scaled(distances: np.ndarray) -> np.ndarray:
    """Return points (n, 3) about their centroid that have these distances (n, n), as well as three axes can."""
    n = len(distances)
    C = np.eye(n) - 1.0 / n
    values, vectors = np.linalg.eigh(-0.5 * C @ distances**2 @ C)
    return np.asarray(vectors[:, :-4:-1] * np.sqrt(np.maximum(values[:-4:-1], 0.0)))


def aligned(points: np.ndarray, known: np.ndarray, sign: float) -> np.ndarray:
    """Return points (n, 3) moved so that the first of them lie best on the known ones (m, 3), mirrored for sign -1."""
    moved = points * [1.0, 1.0, sign]
    at, to = moved[: len(known)].mean(axis=0), known.mean(axis=0)
    turn, _ = Rotation.align_vectors(known - to, moved[: len(known)] - at)
    return np.asarray(turn.apply(moved - at) + to)


def mirror_images(
    pairs: np.ndarray, distance: np.ndarray, believed: np.ndarray, known: Sequence[int]
) -> list[np.ndarray]:
    """Return both mirror images of the points (n, 3), the known ones at their place; none where pairs do not connect.

    Between two points, pairs (l, 2), there are distances (l) [m]; the known points, by number, are taken of those
    believed (n, 3) [m].
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
