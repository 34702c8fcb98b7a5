"""The corridor: the distance by which the vehicle may leave its planned path, and whether a tube stays inside it.

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
    """The free distances about every point of a path, horizontal and vertical [m] (n).

    The radius is 0 or less where the vehicle touches a wall. nearest: the index in Room.walls of the wall that bounds
    the radius, or -1 for the room's bounds (n).
    """

    radius: np.ndarray
    height: np.ndarray
    nearest: np.ndarray


class Margin(NamedTuple):
    """The least distances by which a tube stays inside its corridor, horizontal and vertical [m].

    A margin is negative if the tube reaches a wall. tick, place: tick and r [m] (3) at the least horizontal margin;
    nearest: the wall or bounds there, as in Corridor.
    """

    horizontal: float
    vertical: float
    tick: int
    place: np.ndarray
    nearest: int

    @property
    def least(self) -> float:
        """The smaller of the two margins [m]."""
        return min(self.horizontal, self.vertical)


def corridor(room: Room, vehicle: Vehicle, path: np.ndarray) -> Corridor:
    """Return the corridor about a path p_W (n, 3). Walls that end below the path count too: a tube has height."""
    to_walls = [item.away(path[:, :2]) - vehicle.radius for item in footprints(room) if item.name == "wall"]
    inside = np.minimum(path - room.interior.min, room.interior.max - path)
    distances = np.column_stack([inside[:, :2].min(axis=1), *to_walls])
    return Corridor(distances.min(axis=1), inside[:, 2], distances.argmin(axis=1) - 1)


def margin(tube: Tube, about: Corridor) -> Margin:
    """Return the margin of a tube in a corridor about the same path."""
    horizontal = about.radius - tube.radius
    k = int(np.argmin(horizontal))
    vertical = float(np.min(about.height - tube.height))
    return Margin(float(horizontal[k]), vertical, k, tube.r[k], int(about.nearest[k]))
