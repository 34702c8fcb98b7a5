"""Losses of flights, with time and cause, and contacts with furniture."""

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.model.footprints import footprints
from ortilo_drake.model.room import Room
from ortilo_drake.model.vehicle import MAX_TILT, Vehicle

LEAST_UPRIGHT = np.cos(MAX_TILT)  # least cosine of the tilt of a vehicle that has not tumbled
CAUSES = ("diverged", "tumbled", "left the room", "hit a wall")
NOT_LOST, DIVERGED, TUMBLED, LEFT_THE_ROOM, HIT_A_WALL = range(-1, len(CAUSES))
BODY_HALF_HEIGHT = 0.15  # half height of the airframe about the centre of mass [m]; our estimate for the M100


@dataclass(frozen=True)
class Lost:
    """The loss of a flight: the tick and time [s] at which the flight ended, and the cause."""

    tick: int
    time: float
    cause: str


@lru_cache(maxsize=8)
def _obstacles(room: Room) -> dict[bool, tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]]:
    """Return footprints of walls (True) and others (False): low, high corners of cores (n, 2), radii, tops, names."""

    def arrays(walls: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        found = [f for f in footprints(room) if (f.name == "wall") == walls]
        low, high = np.array([f.low for f in found]), np.array([f.high for f in found])
        radius, top = np.array([f.radius for f in found]), np.array([f.top for f in found])
        return low.reshape(-1, 2), high.reshape(-1, 2), radius, top, np.array([f.name for f in found])

    return {walls: arrays(walls) for walls in (True, False)}


def touched(p_WB: np.ndarray, room: Room, vehicle: Vehicle) -> tuple[np.ndarray, np.ndarray]:
    """Return a mask (n, obstacles) of the obstacles other than walls that the outline touches, and their names.

    The outline is a disc of radius vehicle.radius about p_WB (n, 3) that reaches BODY_HALF_HEIGHT up and down.
    """
    low, high, radius, top, names = _obstacles(room)[False]
    nearest = np.clip(p_WB[:, np.newaxis, 0:2], low, high)
    near = np.sum((p_WB[:, np.newaxis, 0:2] - nearest) ** 2, axis=2) < (vehicle.radius + radius) ** 2
    return near & (p_WB[:, 2:3] - BODY_HALF_HEIGHT < top), names


class Bounds(NamedTuple):
    """The bounds within which a flight is not lost, in a form for compiled functions."""

    low: np.ndarray
    """lower corner of the room's interior (3) [m]."""
    high: np.ndarray
    """upper corner of the room's interior (3) [m]."""
    walls: np.ndarray
    """each wall's low and high corner in plan (4), the radius of wall plus outline about them, and the wall's top plus
    the outline's half height (n, 6) [m]."""


@lru_cache(maxsize=8)
def bounds_of(room: Room, vehicle: Vehicle) -> Bounds:
    """Return the bounds of a room for a vehicle."""
    low, high, radius, top, _ = _obstacles(room)[True]
    walls = np.column_stack((low, high, vehicle.radius + radius, top + BODY_HALF_HEIGHT))
    return Bounds(np.array(room.interior.min, dtype=float), np.array(room.interior.max, dtype=float), walls)


@cached_njit(_nrt=False)
def cause_of_loss(x: np.ndarray, bounds: Bounds) -> int:
    """Return the cause, an index in CAUSES, that ends a flight at the state x (12); NOT_LOST if there is none."""
    low, high, walls = bounds
    for i in range(x.size):
        if not np.isfinite(x[i]):
            return DIVERGED
    if np.cos(x[3]) * np.cos(x[4]) < LEAST_UPRIGHT:
        return TUMBLED
    for i in range(3):
        if x[i] < low[i] or x[i] > high[i]:
            return LEFT_THE_ROOM
    for j in range(walls.shape[0]):
        aside = x[0] - min(max(x[0], walls[j, 0]), walls[j, 2])
        ahead = x[1] - min(max(x[1], walls[j, 1]), walls[j, 3])
        if aside**2 + ahead**2 < walls[j, 4] ** 2 and x[2] < walls[j, 5]:
            return HIT_A_WALL
    return NOT_LOST


@cached_njit
def first_loss(states: np.ndarray, bounds: Bounds) -> tuple[int, int]:
    """Return the first tick at which the states (n, 12) mean a loss, and its cause; n and NOT_LOST if there is none."""
    for k in range(states.shape[0]):
        cause = cause_of_loss(states[k], bounds)
        if cause != NOT_LOST:
            return k, cause
    return states.shape[0], NOT_LOST


def find_loss(states: np.ndarray, h: float, room: Room, vehicle: Vehicle, first: int = 0) -> Lost | None:
    """Return the first loss in a series of true states, if any.

    A flight is lost when its state is no longer finite, when the vehicle tilts by more than 60 degrees, when its centre
    leaves the room, or when its outline touches a wall. Touching furniture does not end a flight, see contacts. The
    states x (n, 12) are those of every tick from `first` on; h is the length of a tick [s].
    """
    k, cause = first_loss(np.ascontiguousarray(states), bounds_of(room, vehicle))
    return None if cause == NOT_LOST else Lost(first + k, (first + k) * h, CAUSES[cause])


def contacts(states: np.ndarray, room: Room, vehicle: Vehicle) -> list[str]:
    """Return the names of the furniture, stands and landmarks that the vehicle's outline touched.

    Their extents are our estimates, while walls are surveyed. So a contact is reported beside a flight's errors, but
    does not end the flight.
    """
    touches, names = touched(states[:, 0:3], room, vehicle)
    return sorted(set(names[np.any(touches, axis=0)].tolist()))
