"""Measurements possible at a place: anchors in sight, the dilution of their ranges, landmarks in view.

With unit vectors u_i from the place to the n anchors in sight as the rows of G (n x 3), ranges with independent errors
of the same sigma give a position of covariance sigma^2 (G^T G)^-1. The position dilution of precision is the root of
this covariance's trace over sigma,

    PDOP = sqrt(trace((G^T G)^-1)),

at best 3 / sqrt(n), if the anchors are spread evenly over all directions (Kaplan and Hegarty, "Understanding GPS",
2017, section 11.2, without the clock: a range here is two-way).
"""

import numpy as np

from ortilo_drake.model.geometry.line_of_sight import walls_crossed
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import N_X
from ortilo_drake.scenario import Scenario
from ortilo_drake.sensors.information_camera import camera_tables
from ortilo_drake.world.sensors.camera_tables import Tables, look_up
from ortilo_drake.world.sensors.landmark_view import DISTANCE, INSIDE, LANDMARK, VISIBLE, landmark_views, surroundings

SEEN = 0.5  # a landmark is in view if the detector finds it in at least this share of pictures [1]
_FLAT = 1e-9  # smaller eigenvalues of G^T G count as rounding; their mean is n / 3


def anchors_in_sight(points: np.ndarray, room: Room, max_distance: float, walls_block: bool) -> np.ndarray:
    """Return a mask of the anchors in sight of each point p_W (n, 3) [m] (n, anchors): within max_distance [m].

    Walls may block the sight, except the wall that holds the anchor.
    """
    seen = np.linalg.norm(points[:, np.newaxis] - room.anchor_positions, axis=2) <= max_distance
    if walls_block and len(room.wall_boxes):
        for k, i in np.argwhere(seen):
            seen[k, i] = walls_crossed(points[k], room.anchor_positions[i], room.wall_boxes) == 0
    return seen


def dilution(points: np.ndarray, anchors: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Return the position dilution of precision (n) at points p_W (n, 3) [m]; infinite if ranges give no position.

    anchors: p_W (m, 3) [m]; seen: the mask of anchors in sight (n, m).
    """
    away = anchors - points[:, np.newaxis]
    distance = np.linalg.norm(away, axis=2, keepdims=True)
    G = np.where(seen[..., np.newaxis] & (distance > 0.0), away / np.maximum(distance, 1e-300), 0.0)
    values = np.linalg.eigvalsh(np.einsum("nmi,nmj->nij", G, G))
    with np.errstate(divide="ignore"):
        return np.where(values[:, 0] > _FLAT, np.sqrt(np.sum(1.0 / np.maximum(values, 1e-300), axis=1)), np.inf)


def middles(low: np.ndarray, high: np.ndarray, counts: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return the middles of equal cells between low and high along each axis, `counts` cells on each."""
    return tuple(a + (b - a) * (np.arange(n) + 0.5) / n for a, b, n in zip(low, high, counts, strict=True))


class Eyes:
    """The camera of a scenario in its room: the landmarks that its detector finds from a pose."""

    def __init__(self, scenario: Scenario) -> None:
        self.room = scenario.load_room()
        self._camera = self.room.camera.scaled_to(scenario.image_width).constants
        self._around = surroundings(self.room)
        self._tables: Tables | None = camera_tables(scenario, self.room)

    def in_view(self, point: np.ndarray, yaw: float) -> np.ndarray:
        """Return the indices of the landmarks in view (k) of a level vehicle at p_WB (3) [m] with heading yaw [rad].

        If the detector's errors have not been measured, these are the landmarks at least half inside the image and
        half visible.
        """
        x = np.zeros(N_X)
        x[:3], x[5] = point, yaw
        limits = np.array([40.0, 6.0, 0.0]) if self._tables is None else self._tables.limits
        found = []
        for view in landmark_views(x, self._around, self._camera, limits):
            i = int(view[LANDMARK])
            if self._tables is None:
                share = min(view[INSIDE], view[VISIBLE])
            elif view[VISIBLE] < limits[2]:
                share = 0.0
            else:
                share = look_up(self._tables.found, 1 + int(self.room.landmark_labels[i]), view[DISTANCE])
                share *= look_up(self._tables.inside, 1, view[INSIDE]) * look_up(self._tables.visible, 1, view[VISIBLE])
            if share >= SEEN:
                found.append(i)
        return np.array(found, dtype=int)
