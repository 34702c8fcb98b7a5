"""The places where the vehicle would have a position fix, predicted from the surveyed room alone.

A place is "seen" if the ranges that no wall blocks make a fix with sd up to FIX_SD, with the multilateration's noise
(range_equations.py), or if the camera sees two landmarks while the vehicle flies level at the heading that is held.
Walls count as stopping radio waves, whatever they really do. Losses and blackouts are not known before the flight.

The places form a grid. A place counts as seen only if its eight neighbours are seen too, so that a small deviation from
the path loses no fix.
"""

from dataclasses import dataclass

import numpy as np

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.model.equations import rotation_matrix
from ortilo_drake.model.geometry.line_of_sight import is_hidden, walls_crossed
from ortilo_drake.model.pinhole import Camera, extent_box
from ortilo_drake.model.room import Room
from ortilo_drake.onboard.ranging.range_equations import inverse, normal_equations
from ortilo_drake.scenario import Belief

FIX_SD = 0.5  # largest sqrt(tr C) of a fix that is worth a detour [m]
LANDMARKS = 2  # number of landmarks that a fix needs
LEAST_BOX = 8.0  # smallest width and height of a box that a detector finds [px]
BLOCK = 4  # number of points of the planner's grid along each side of a place


@dataclass(frozen=True)
class FixSources:
    """The sources from which the onboard half gets position fixes."""

    ranges: bool = True
    """whether the vehicle measures ranges to anchors."""
    boxes: bool = True
    """whether the camera detects landmarks."""
    noise: tuple[float, float] = (0.0, 0.0075)
    """s_0 [m] and s_1 [1] of a range's standard deviation s_0 + s_1 d in the multilateration."""
    yaw: float = 0.0
    """heading that is held [rad]."""
    width: int = 320
    """width of the camera's image [px]."""


ALL_SOURCES = FixSources()


def fix_sources(belief: Belief) -> FixSources:
    """Return the sources of position fixes of a vehicle with this belief."""
    sds = belief.multilateration.noise.sds
    return FixSources(belief.measures_ranges, belief.sees_landmarks, sds, belief.yaw, belief.image_width)


@cached_njit
def ranges_fix(p: np.ndarray, anchors: np.ndarray, boxes: np.ndarray, noise: np.ndarray) -> bool:
    """Return whether ranges from p (3) to anchors (n, 3) that no wall (m, 7) blocks make a fix with sd up to FIX_SD."""
    n = anchors.shape[0]
    d, there = np.empty(n), np.zeros(n)
    for i in range(n):
        d[i] = np.sqrt(np.sum((p - anchors[i]) ** 2))
        if walls_crossed(p, anchors[i], boxes) == 0:
            there[i] = 1.0
    if np.sum(there) < 3.0:
        return False
    _, N, _ = normal_equations(p, d, there, anchors, noise)
    definite, C = inverse(N)
    return definite and C[0] + C[3] + C[5] <= FIX_SD**2


@cached_njit
def landmarks_fix(
    p: np.ndarray,
    rpy: np.ndarray,
    positions: np.ndarray,
    outlines: np.ndarray,
    boxes: np.ndarray,
    cylinders: np.ndarray,
    camera: Camera,
) -> bool:
    """Return whether the camera of a body at p_WB (3), rpy (3) [rad] sees at least LANDMARKS whole landmarks.

    The landmarks are at `positions` p_WL (n, 3) with `outlines` (n, k, 3). Walls, `boxes` (m, 7), and stands,
    `cylinders` (l, 4), may hide them.
    """
    R_WB, box, count = rotation_matrix(rpy), np.empty(4), 0
    p_WC = p + R_WB @ camera.p_BC
    for i in range(positions.shape[0]):
        if not extent_box(positions[i], outlines[i], p, R_WB, camera, box):
            continue
        inside = box[0] >= 0.0 and box[1] >= 0.0 and box[2] <= camera.image[0] - 1 and box[3] <= camera.image[1] - 1
        large = min(box[2] - box[0], box[3] - box[1]) >= LEAST_BOX
        if inside and large and not is_hidden(p_WC, positions[i], boxes, cylinders):
            count += 1
    return count >= LANDMARKS


def seen_at(points: np.ndarray, room: Room, sources: FixSources) -> np.ndarray:
    """Return whether there is a fix at each point p_WB (n, 3) [m], as a mask (n)."""
    found = np.zeros(len(points), dtype=bool)
    if sources.ranges:
        noise = np.array(sources.noise)
        found |= [ranges_fix(p, room.anchor_positions, room.wall_boxes, noise) for p in points]
    if sources.boxes and room.landmarks:
        rpy, camera = np.array([0.0, 0.0, sources.yaw]), room.camera.scaled_to(sources.width).constants
        map_ = (room.landmark_positions, room.landmark_outlines, room.wall_boxes, room.stand_cylinders)
        found |= [landmarks_fix(p, rpy, *map_, camera) for p in points]
    return found


def seen_on_grid(
    x: np.ndarray, y: np.ndarray, height: float, room: Room, sources: FixSources
) -> tuple[np.ndarray, np.ndarray]:
    """Return a mask of the grid points (x_i, y_j) that are seen (n_x, n_y), and the places not seen (k, 2) [m].

    The grid's x (n_x) and y (n_y) are equally spaced [m]; `height` is the flying height [m].
    """
    centers = [np.array([part.mean() for part in np.split(c, range(BLOCK, len(c), BLOCK))]) for c in (x, y)]
    places = np.stack(np.meshgrid(*centers, indexing="ij"), axis=-1).reshape(-1, 2)
    points = np.column_stack([places, np.full(len(places), height)])
    seen = seen_at(points, room, sources).reshape(len(centers[0]), len(centers[1]))
    padded = np.pad(seen, 1, constant_values=True)
    shape = seen.shape
    for i in range(3):
        for j in range(3):
            seen = seen & padded[i : i + shape[0], j : j + shape[1]]
    fine = seen.repeat(BLOCK, axis=0)[: len(x)].repeat(BLOCK, axis=1)[:, : len(y)]
    return fine, places[~seen.ravel()]
