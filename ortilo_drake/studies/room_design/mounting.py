"""Mounting places: where in a room an anchor can be fixed.

They lie on a grid over the faces of the walls and the ceiling, STAND_OFF in front of them: an anchor in its wall would
be heard through that wall (model/geometry/line_of_sight.py).
"""

from itertools import product

import numpy as np

from ortilo_drake.model.footprints import footprints
from ortilo_drake.model.input_error import InputError
from ortilo_drake.model.room import Room

STAND_OFF = 0.05  # distance from a wall or the ceiling [m]
LOWEST = 0.3  # least height above the floor [m]
MAX_PLACES = 1500  # a search takes about 2 ms for each anchor and place
AWAY = 0.5  # distance from the vehicle's outline on its path [m]


def mounting_places(room: Room, spacing: float, path: np.ndarray, vehicle_radius: float) -> np.ndarray:
    """Return p_W of mounting places (n, 3) on a grid of a spacing [m], always in the same order.

    A place lies in the interior, outside walls and whatever stands there, and keeps AWAY from the vehicle's outline, of
    vehicle_radius [m], on its path p_WB (k, 3). InputError if there are more than MAX_PLACES.
    """
    length, width, height = np.subtract(room.interior.max, room.interior.min)
    about = (length * width + 2.0 * (length + width) * height) / spacing**2
    if about > 4 * MAX_PLACES:
        raise _too_many(spacing, round(about))
    found = _faces(room, spacing)
    found = found[_is_free(found, room)]
    near = np.array([np.linalg.norm(path - p, axis=1).min() for p in found]) < vehicle_radius + AWAY
    places = _apart(np.round(found[~near], 3), spacing / 3.0)
    if len(places) > MAX_PLACES:
        raise _too_many(spacing, len(places))
    return places


def _too_many(spacing: float, count: int) -> InputError:
    return InputError(
        f"--spacing {spacing:g}: makes about {count} mounting places, must not make more than {MAX_PLACES}"
    )


def _steps(low: float, high: float, spacing: float) -> np.ndarray:
    """Return points from low to high, both included, at most the spacing apart; the middle if there is no length."""
    if high <= low:
        return np.array([(low + high) / 2.0])
    return np.linspace(low, high, int(np.ceil((high - low) / spacing)) + 1)


def _box(room: Room) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners of the interior, less STAND_OFF at walls and ceiling and LOWEST at the floor."""
    low, high = np.array(room.interior.min), np.array(room.interior.max)
    return low + [STAND_OFF, STAND_OFF, min(LOWEST, (high[2] - low[2]) / 2.0)], high - STAND_OFF


def _faces(room: Room, spacing: float) -> np.ndarray:
    """Return places on the outer faces, below the ceiling, and in front of the four upright faces of every wall."""
    low, high = _box(room)
    x, y, z = (_steps(a, b, spacing) for a, b in zip(low, high, strict=True))
    found = [*product(x, (low[1], high[1]), z), *product((low[0], high[0]), y, z), *product(x, y, high[2:])]
    for x, y, z, yaw, a, b, c in room.wall_boxes:
        heights = _steps(low[2], min(high[2], z + c - STAND_OFF), spacing)
        along = [(u, s * (b + STAND_OFF)) for u in _steps(-a, a, spacing) for s in (-1.0, 1.0)]
        across = [(s * (a + STAND_OFF), v) for v in _steps(-b, b, spacing) for s in (-1.0, 1.0)]
        for (u, v), height in product(along + across, heights):
            found.append((x + np.cos(yaw) * u - np.sin(yaw) * v, y + np.sin(yaw) * u + np.cos(yaw) * v, height))
    return np.array(found)


def _is_free(places: np.ndarray, room: Room) -> np.ndarray:
    """Return a mask (n) of the inner places (n, 3) that are in no wall, stand, piece of furniture or landmark."""
    low, high = _box(room)
    free = np.all((places >= low - 1e-9) & (places <= high + 1e-9), axis=1)
    for x, y, z, yaw, a, b, c in room.wall_boxes:
        dx, dy = places[:, 0] - x, places[:, 1] - y
        u, v = np.cos(yaw) * dx + np.sin(yaw) * dy, np.cos(yaw) * dy - np.sin(yaw) * dx
        free &= (np.abs(u) > a) | (np.abs(v) > b) | (np.abs(places[:, 2] - z) > c)
    for item in footprints(room):
        if item.name != "wall":
            free &= (item.away(places[:, :2]) > 0.0) | (places[:, 2] > item.top)
    return free


def _apart(places: np.ndarray, least: float) -> np.ndarray:
    """Return the places (n, 3) without those nearer than `least` [m] to an earlier one."""
    kept: list[np.ndarray] = []
    for p in places:
        if not kept or np.linalg.norm(np.array(kept) - p, axis=1).min() >= least:
            kept.append(p)
    return np.array(kept).reshape(-1, 3)
