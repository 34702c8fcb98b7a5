"""The corridor: the distance by which the vehicle may leave its planned path, and whether a tube stays inside.

A flight is lost when the vehicle's outline touches a wall or its centre leaves the room (flight/lost.py). The corridor
about r_k is therefore a horizontal disc. Its radius is the distance to the nearest wall less the vehicle's radius, or
the distance to the room's bounds if that is less. In height the corridor reaches from floor to ceiling.
"""

from typing import NamedTuple

import numpy as np

from ortilo_drake.model.footprints import footprints
from ortilo_drake.model.room import Room
from ortilo_drake.model.vehicle import Vehicle
from ortilo_drake.studies.tube.tube import Tube


class Corridor(NamedTuple):
    """Free distances about every point of a path, horizontal and vertical [m] (n).

    The radius is not above 0 where the vehicle touches a wall. Nearest is what bounds it: the wall's index in
    Room.walls, or -1, the room's bounds (n).
    """

    radius: np.ndarray
    height: np.ndarray
    nearest: np.ndarray


class Margin(NamedTuple):
    """By how much a tube stays inside its corridor where that is least, horizontal and vertical [m].

    It is negative where the tube reaches a wall. The tick and place, r [m] (3), are where the horizontal margin is
    least, nearest is what it is least to, as in Corridor.
    """

    horizontal: float
    vertical: float
    tick: int
    place: np.ndarray
    nearest: int

    @property
    def least(self) -> float:
        """The smaller of the two [m]."""
        return min(self.horizontal, self.vertical)


def corridor(room: Room, vehicle: Vehicle, path: np.ndarray) -> Corridor:
    """Return the corridor about a path p_W (n, 3). Walls that end below the path count as well: a tube has height."""
    walls = [f for f in footprints(room) if f.name == "wall"]
    low = np.array([f.low for f in walls]).reshape(-1, 2)
    high = np.array([f.high for f in walls]).reshape(-1, 2)
    radius = np.array([f.radius for f in walls])
    here = path[:, np.newaxis, :2]
    to_walls = np.linalg.norm(here - np.clip(here, low, high), axis=2) - radius - vehicle.radius
    inside = np.minimum(path - room.interior.min, room.interior.max - path)
    distances = np.column_stack([inside[:, :2].min(axis=1), to_walls])
    return Corridor(distances.min(axis=1), inside[:, 2], distances.argmin(axis=1) - 1)


def margin(tube: Tube, about: Corridor) -> Margin:
    """Return the margin of a tube in a corridor about the same path."""
    horizontal = about.radius - tube.radius
    k = int(np.argmin(horizontal))
    vertical = float(np.min(about.height - tube.height))
    return Margin(float(horizontal[k]), vertical, k, tube.r[k], int(about.nearest[k]))
