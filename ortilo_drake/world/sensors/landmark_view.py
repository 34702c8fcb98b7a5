"""Views of the landmarks: distance, box, the share inside the image and the visible share.

Both the measurement of a detector's rates and errors (training/calibration/calibrate.py) and the drawing from them
(projected_camera.py) use these numbers, so they hold no chance.
"""

from typing import NamedTuple

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.model.equations import rotation_matrix
from ortilo_drake.model.geometry.line_of_sight import crosses_box, crosses_cylinder
from ortilo_drake.model.pinhole import NEAR, Camera, extent_box, in_body_frame
from ortilo_drake.model.room import Room

# Columns of a view. The box is the landmark's whole box, not cut at the image's border [px].
LANDMARK, DISTANCE, BOX, INSIDE, VISIBLE = 0, 1, slice(2, 6), 6, 7
VIEW_SIZE = 8

# Sample points of an extent, as shares of its half sizes: its centre and points towards its corners.
_SAMPLES = np.array([[0.0, 0.0, 0.0], *[[x, y, z] for x in (-0.7, 0.7) for y in (-0.7, 0.7) for z in (-0.7, 0.7)]])


class Surroundings(NamedTuple):
    """Landmarks and what may hide them, as compiled functions take them."""

    positions: np.ndarray
    """p_W of the landmarks [m] (n, 3)."""
    outlines: np.ndarray
    """outlines of the landmarks, see pinhole.py (n, m, 3)."""
    sizes: np.ndarray
    """extents of the landmarks along W's axes [m] (n, 3)."""
    boxes: np.ndarray
    """hiding obstacles as turned boxes, see line_of_sight.py, and their radius in plan [m] (k, 8)."""
    cylinders: np.ndarray
    """hiding obstacles as cylinders on the floor (l, 4)."""


def surroundings(room: Room) -> Surroundings:
    """Return a room's landmarks, walls and stands.

    Furniture is left out: its known boxes hide more than the furniture itself does.
    """
    return Surroundings(
        room.landmark_positions,
        room.landmark_outlines,
        room.landmark_sizes,
        np.column_stack([room.wall_boxes, np.hypot(room.wall_boxes[:, 4], room.wall_boxes[:, 5])]),
        room.stand_cylinders,
    )


@register_jitable(_nrt=False)
def hide(
    points: np.ndarray,
    p_WC: np.ndarray,
    p_WL: np.ndarray,
    size: np.ndarray,
    boxes: np.ndarray,
    cylinders: np.ndarray,
    hidden: np.ndarray,
) -> int:
    """Return how many points (n, 3) of a landmark at p_WL with extent size (3) the camera at p_WC does not see.

    It marks them in hidden (n). It is a separate function because views of an obstacle cost no counted references here.
    """
    n_hidden = 0
    # Only the few obstacles near the line of sight, in plan, are tested closely.
    aside = 0.5 * np.sqrt(size[0] ** 2 + size[1] ** 2)
    dx, dy = p_WL[0] - p_WC[0], p_WL[1] - p_WC[1]
    length = max(np.sqrt(dx**2 + dy**2), 1e-9)
    dx, dy = dx / length, dy / length
    for j in range(boxes.shape[0]):
        ox, oy, reach = boxes[j, 0] - p_WC[0], boxes[j, 1] - p_WC[1], boxes[j, 7] + aside
        if abs(ox * dy - oy * dx) <= reach and -reach <= ox * dx + oy * dy <= length + reach:
            for k in range(points.shape[0]):
                if not hidden[k] and crosses_box(p_WC, points[k], boxes[j]):
                    hidden[k] = True
                    n_hidden += 1
    lowest = min(p_WC[2], p_WL[2] - 0.5 * size[2])
    for j in range(cylinders.shape[0]):
        if cylinders[j, 3] <= lowest:  # the cylinder ends below every line of sight
            continue
        ox, oy, reach = cylinders[j, 0] - p_WC[0], cylinders[j, 1] - p_WC[1], cylinders[j, 2] + aside
        if abs(ox * dy - oy * dx) <= reach and -reach <= ox * dx + oy * dy <= length + reach:
            for k in range(points.shape[0]):
                if not hidden[k] and crosses_cylinder(p_WC, points[k], cylinders[j]):
                    hidden[k] = True
                    n_hidden += 1
    return n_hidden


@cached_njit
def visible_share(p_WC: np.ndarray, i: int, room: Surroundings) -> float:
    """Return the share of landmark i's sample points that the camera at p_WC (3, in W) sees."""
    p_WL, size, boxes, cylinders = room.positions[i], room.sizes[i], room.boxes, room.cylinders
    points, hidden = np.empty_like(_SAMPLES), np.zeros(len(_SAMPLES), dtype=np.bool_)
    for k in range(len(_SAMPLES)):
        for axis in range(3):
            points[k, axis] = p_WL[axis] + 0.5 * size[axis] * _SAMPLES[k, axis]
    return 1.0 - hide(points, p_WC, p_WL, size, boxes, cylinders, hidden) / points.shape[0]


@register_jitable
def cut(value: float, size: float) -> float:
    """Return a pixel coordinate cut at the border of an image of that size."""
    return min(max(value, -0.5), size - 0.5)


@register_jitable(error_model="numpy", _nrt=False)
def view_box(
    i: int, p_WB: np.ndarray, R_WB: np.ndarray, room: Surroundings, camera: Camera, limits: np.ndarray, box: np.ndarray
) -> tuple[float, float]:
    """Write landmark i's whole box to box (4); return its distance [m] and its share inside the image.

    The camera is on the body at p_WB and R_WB. If no part of the landmark is in its image, the share is 0 and the box
    is not written. The limits are the largest distance [m] and the least width and height of that part [px], above 0.
    """
    p_BL = in_body_frame(room.positions[i, 0], room.positions[i, 1], room.positions[i, 2], p_WB, R_WB)
    q_x, q_y, q_z = p_BL[0] - camera.p_BC[0], p_BL[1] - camera.p_BC[1], p_BL[2] - camera.p_BC[2]
    distance = np.sqrt(q_x**2 + q_y**2 + q_z**2)
    if q_x < NEAR or distance > limits[0]:
        return distance, 0.0
    # A cheap test first: in plan, the ball around the landmark's extent lies outside the image.
    radius = 0.5 * np.sqrt(room.sizes[i, 0] ** 2 + room.sizes[i, 1] ** 2 + room.sizes[i, 2] ** 2)
    f, aside = camera.f, 0.5 * camera.image[0] + 2.0
    if camera.lens.bend.size > 0:
        f, aside = 1.0, camera.lens.reach[0]
    if f * (abs(q_y) - radius) > aside * (q_x + radius):
        return distance, 0.0
    if not extent_box(room.positions[i], room.outlines[i], p_WB, R_WB, camera, box):
        return distance, 0.0
    width = cut(box[2], camera.image[0]) - cut(box[0], camera.image[0])
    height = cut(box[3], camera.image[1]) - cut(box[1], camera.image[1])
    if min(width, height) < limits[1]:
        return distance, 0.0
    return distance, width * height / ((box[2] - box[0]) * (box[3] - box[1]))


@cached_njit
def landmark_views(x: np.ndarray, room: Surroundings, camera: Camera, limits: np.ndarray) -> np.ndarray:
    """Return a row for each landmark that is in the image, in the map's order (k, VIEW_SIZE).

    Position and attitude come first in the state x; the limits are those of view_box.
    """
    p_WB, R_WB = x[0:3], rotation_matrix(x[3:6])
    p_WC = p_WB + R_WB @ camera.p_BC
    n, k = room.positions.shape[0], 0
    views, box = np.empty((n, VIEW_SIZE)), np.empty(4)
    for i in range(n):
        distance, inside = view_box(i, p_WB, R_WB, room, camera, limits, box)
        if inside > 0.0:
            views[k, 0], views[k, 1], views[k, 6], views[k, 7] = i, distance, inside, visible_share(p_WC, i, room)
            views[k, 2:6] = box
            k += 1
    return views[:k]
