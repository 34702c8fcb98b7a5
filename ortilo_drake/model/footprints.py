"""The footprints of the room's obstacles, seen from above."""

import math
from dataclasses import dataclass

import numpy as np

from ortilo_drake.model.room import Room


@dataclass(frozen=True)
class Footprint:
    """An obstacle seen from above, as a rounded rectangle: all points within ``radius`` of an axis-aligned core.

    The core of a wall is the wall, the core of a stand is a point.
    """

    name: str
    """name of the obstacle in messages."""
    low: tuple[float, float]
    """lower corner of the core [m]."""
    high: tuple[float, float]
    """upper corner of the core [m]."""
    radius: float
    """distance by which the obstacle extends beyond its core [m]."""
    top: float
    """height of the obstacle's top [m]."""

    def away(self, points: np.ndarray) -> np.ndarray:
        """Return the distances of points (..., 2) from the obstacle (...) [m], below 0 inside of a rounded one."""
        beyond = points - np.clip(points, self.low, self.high)
        return np.asarray(np.hypot(beyond[..., 0], beyond[..., 1]) - self.radius)


def footprints(room: Room) -> list[Footprint]:
    """Return the footprints of all walls, stands, pieces of furniture and landmarks of the room."""

    def around(name: str, x: float, y: float, half_x: float, half_y: float, top: float) -> Footprint:
        radius = 0.0 if name == "wall" else min(half_x, half_y)  # only walls have sharp corners
        a, b = half_x - radius, half_y - radius
        return Footprint(name, (x - a, y - b), (x + a, y + b), radius, top)

    found = []
    for x, y, _, yaw, half_x, half_y, half_z in room.wall_boxes:
        c, s = abs(math.cos(yaw)), abs(math.sin(yaw))
        found.append(around("wall", x, y, c * half_x + s * half_y, s * half_x + c * half_y, 2 * half_z))
    found += [around("stand", x, y, r, r, height) for x, y, r, height in room.stand_cylinders]
    for kind, x, y, z, *_ in room.furniture:
        size_x, size_y, height = room.furniture_size[kind]
        found.append(around(kind, x, y, size_x / 2, size_y / 2, z + height))
    for landmark, size in zip(room.landmarks, room.landmark_sizes, strict=True):
        x, y, z = landmark.position
        found.append(around(landmark.label, x, y, size[0] / 2, size[1] / 2, z + size[2] / 2))
    return found
