"""The free space at one flying height and convex cells in it.

Every obstacle is a rounded rectangle: all points within ``radius`` of an axis-aligned core. The core of a wall is the
wall, the core of a stand is a point. The vehicle's radius is added to ``radius``, so that the vehicle becomes a point.
The *room* at a point is the point's distance from the nearest inflated obstacle.

A cell is grown from a seed as in IRIS (Deits and Tedrake, 2015) with a disc for the ellipse: one half-plane for each
obstacle, the nearest first, perpendicular to the shortest line from the seed. The half-plane keeps ``clearance`` from
the obstacle if there is room for it, and less where the place is narrow.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ortilo_drake.model.footprints import footprints
from ortilo_drake.model.room import Room

BORDER = 1.0e-9  # a point on a cell's border counts as inside [m]
OUTSIDE = 10.0  # thickness of the outer walls as obstacles [m]
LAP = 8  # number of route steps that a cell shares with the cell before
APART = 0.05  # distance between a cell and a place that the cell must not contain [m]
ELBOW = 0.15  # space around its seed that a cell needs before it keeps the clearance [m]


@dataclass(frozen=True)
class FreeSpace:
    """The positions that the vehicle's centre may have at its flying height, given by the obstacles."""

    names: tuple[str, ...]
    """names of the obstacles in error messages (n)."""
    low: np.ndarray
    """lower corners of the obstacles' cores (n, 2) [m]."""
    high: np.ndarray
    """upper corners of the obstacles' cores (n, 2) [m]."""
    radius: np.ndarray
    """distance by which each obstacle extends beyond its core, including the vehicle's radius (n) [m]."""
    top: np.ndarray
    """flying height below which the obstacle is in the way (n) [m]."""
    clearance: float
    """room to keep to the obstacles if there is enough [m]."""
    bounds: np.ndarray
    """lower and upper corner of the room's interior (2, 3) [m]."""

    def room(self, p: np.ndarray) -> np.ndarray:
        """Return the distance of a point p (2) from each inflated obstacle (n) [m]."""
        return np.hypot(*(p - np.clip(p, self.low, self.high)).T) - self.radius

    def room_on_grid(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return the room [m] at each point (x_i, y_j) of a grid (n_x, n_y)."""
        least = np.full((x.size, y.size), np.inf)
        for low, high, radius in zip(self.low, self.high, self.radius, strict=True):
            dx, dy = x - np.clip(x, low[0], high[0]), y - np.clip(y, low[1], high[1])
            np.minimum(least, np.hypot(dx[:, None], dy[None, :]) - radius, out=least)
        return least


@dataclass(frozen=True)
class Cell:
    """The convex polygon {p : A p <= b}; the rows of A have unit length."""

    A: np.ndarray
    b: np.ndarray

    def contains(self, points: np.ndarray) -> np.ndarray:
        """Return whether each point (n, 2) lies in the cell (n)."""
        return np.all(points @ self.A.T <= self.b + BORDER, axis=1)


def free_space(
    room: Room, height: float, vehicle_radius: float, clearance: float, vertical_clearance: float
) -> FreeSpace:
    """Return the free space between walls, outer walls and all obstacles with a top above height - vertical_clearance.

    The vehicle flies over lower obstacles. vehicle_radius is the radius of the vehicle's outline; the vehicle keeps
    `clearance` to obstacles where there is room. All in [m].
    """
    names, low, high, radius, top = [], [], [], [], []
    for found in footprints(room):
        is_wall = found.name == "wall"
        if not is_wall and found.top <= height - vertical_clearance:
            continue
        names.append(found.name)
        low.append(np.array(found.low))
        high.append(np.array(found.high))
        radius.append(found.radius)
        top.append(np.inf if is_wall else found.top + vertical_clearance)
    bounds = np.array([room.interior.min, room.interior.max])
    for axis in range(2):
        for side in range(2):
            core = bounds[:, :2] + np.array([[-OUTSIDE], [OUTSIDE]])
            core[1 - side, axis] = bounds[side, axis]
            names.append("outer wall")
            low.append(core[0])
            high.append(core[1])
            radius.append(0.0)
            top.append(np.inf)
    inflated = np.array(radius) + vehicle_radius
    return FreeSpace(tuple(names), np.array(low), np.array(high), inflated, np.array(top), clearance, bounds)


def grow_cell(seed: np.ndarray, space: FreeSpace) -> Cell:
    """Return the cell around a seed (2) [m], which needs positive room.

    With c the point of the core nearest to the seed, n the direction from the seed to c, and kept the clearance kept,
    the half-plane is n . p <= n . c - radius - kept. An obstacle behind an earlier half-plane adds none.
    """
    towards = np.clip(seed, space.low, space.high) - seed
    distance = np.hypot(towards[:, 0], towards[:, 1])
    normals = towards / distance[:, None]
    room = distance - space.radius
    kept = np.minimum(space.clearance, np.maximum(room - ELBOW, room / 2))
    offsets = normals @ seed + room - kept
    center, half = (space.low + space.high) / 2, (space.high - space.low) / 2
    waiting = np.ones(distance.size, dtype=bool)
    chosen = []
    for i in np.argsort(room - kept, kind="stable"):
        if waiting[i]:
            chosen.append(i)
            # Smallest n . p over each inflated obstacle: is the whole obstacle beyond the new half-plane?
            least = center @ normals[i] - half @ np.abs(normals[i]) - space.radius - kept
            waiting &= least < offsets[i] - BORDER
            waiting[i] = False
    return Cell(normals[chosen], offsets[chosen])


def without_places(cell: Cell, seed: np.ndarray, places: np.ndarray) -> Cell:
    """Return the part of a cell around its seed (2) that contains none of the places (k, 2) [m].

    Each place, the nearest first, adds a half-plane perpendicular to the line from the seed, APART before the place.
    """
    left = places[cell.contains(places)]
    A, b = [cell.A], [cell.b]
    while len(left):
        to = left - seed
        distance = np.hypot(*to.T)
        i = int(np.argmin(distance))
        normal = to[i] / distance[i]
        offset = normal @ left[i] - min(APART, distance[i] / 2.0)
        A.append(normal[None])
        b.append(np.array([offset]))
        left = left[left @ normal <= offset]
    return Cell(np.concatenate(A), np.concatenate(b))


def within(cell: Cell, seed: np.ndarray, half: float) -> Cell:
    """Return the part of a cell in a square with centre at its seed (2) and half side `half` [m]."""
    square = np.vstack([np.eye(2), -np.eye(2)])
    return Cell(np.vstack([cell.A, square]), np.concatenate([cell.b, square @ seed + half]))


def cells_along(
    route: np.ndarray, space: FreeSpace, grow: Callable[[np.ndarray, FreeSpace], Cell] = grow_cell
) -> list[Cell]:
    """Return a few cells, in the order of the route, that contain every step of the route and so connect its ends.

    A cell is grown from each point of the route. The next chosen cell is the one that contains the longest part of the
    route from where the cell before ends. It also contains the LAP steps before, if any such cell goes on. The route's
    points (n, 2) [m] are close together and have positive room.
    """
    cells = [grow(p, space) for p in route]
    inside = np.array([cell.contains(route) for cell in cells])
    held = inside[:, :-1] & inside[:, 1:]
    chosen, step, steps = [], 0, len(route) - 1
    while step < steps:
        reach = first_false(held[:, step:])
        lapped = np.where(held[:, max(0, step - LAP) : step].all(axis=1), reach, 0)
        best = int(np.argmax(lapped if lapped.max() > 0 else reach))
        # In a very narrow place a cell may not even contain the steps next to its seed: leave the gap to GCS.
        step += max(1, int(reach[best]))
        chosen.append(cells[best])
    return chosen


def first_false(rows: np.ndarray) -> np.ndarray:
    """Return, for each row of a boolean matrix, the number of true entries before the first false one."""
    return np.where(rows.all(axis=1), rows.shape[1], np.argmin(rows, axis=1))
