"""Anchors that a fit has placed on the wrong side of the vehicle's places.

Where the vehicle flew at one height, the places tell an anchor from its mirror image in their plane by little, and a
descent does not cross from one to the other. So each anchor alone is fitted again from its image, the rest staying.
"""

import numpy as np
from scipy.optimize import least_squares

from ortilo_drake.studies.room_design.network import Network

FLAT = 0.3  # places as near as this to a plane, RMS, hardly tell its sides [m]
GAIN = 1e-6  # by which the cost must fall, relative


def plane_of(places: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Return the RMS distance of points (n, 3) to their best plane, their mean (3) and the plane's normal (3)."""
    center = places.mean(axis=0)
    _, size, axes = np.linalg.svd(places - center, full_matrices=False)
    return float(size[-1] / np.sqrt(len(places))), center, axes[-1]


def better_sides(network: Network, x: np.ndarray, sd: np.ndarray, loss: str) -> tuple[np.ndarray, bool]:
    """Return the unknowns with every anchor on the side where it fits better, and whether any changed.

    Args:
        network: the ranges.
        x: the unknowns, as fitted.
        sd: standard deviations of the ranges (m + l) [m].
        loss: of scipy.optimize.least_squares.
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
        its_sd = sd[rows]

        def residuals(
            a: np.ndarray, q: np.ndarray = ends, r: np.ndarray = measured, s: np.ndarray = its_sd
        ) -> np.ndarray:
            return np.asarray((np.linalg.norm(a - q, axis=1) - r) / s)

        image = anchors[i] - 2.0 * ((anchors[i] - center) @ normal) * normal
        here, there = (least_squares(residuals, start, loss=loss) for start in (anchors[i], image))
        if there.cost < here.cost * (1.0 - GAIN):
            anchors[i], changed = there.x, True
    return np.concatenate([anchors[network.free].ravel(), places.ravel()]), changed
