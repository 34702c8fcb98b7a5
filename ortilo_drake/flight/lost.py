"""Losses of flights, when and why, and contacts with furniture."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ortilo_drake.model.footprints import footprints
from ortilo_drake.model.room import Room
from ortilo_drake.model.vehicle import Vehicle

MAX_TILT = np.pi / 3  # beyond this the vehicle counts as tumbling
BODY_HALF_HEIGHT = 0.15  # of the airframe about the centre of mass [m]; ours, for the M100


@dataclass(frozen=True)
class Lost:
    """A lost flight: the tick and time at which it ended, and why."""

    tick: int
    time: float
    cause: str


@lru_cache(maxsize=8)
def _obstacles(room: Room) -> dict[bool, tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]]:
    """Return low and high corners of cores (n, 2), radii, tops and names (n): of walls (True), of the rest (False)."""

    def arrays(walls: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        found = [f for f in footprints(room) if (f.name == "wall") == walls]
        low, high = np.array([f.low for f in found]), np.array([f.high for f in found])
        radius, top = np.array([f.radius for f in found]), np.array([f.top for f in found])
        return low.reshape(-1, 2), high.reshape(-1, 2), radius, top, np.array([f.name for f in found])

    return {walls: arrays(walls) for walls in (True, False)}


def touched(p_WB: np.ndarray, room: Room, vehicle: Vehicle, walls: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return which obstacles the vehicle's outline touches at each position (n, obstacles), and their names.

    The outline is a disc of vehicle.radius that reaches BODY_HALF_HEIGHT up and down. The obstacles are the walls, or
    all others.
    """
    low, high, radius, top, names = _obstacles(room)[walls]
    nearest = np.clip(p_WB[:, np.newaxis, 0:2], low, high)
    near = np.sum((p_WB[:, np.newaxis, 0:2] - nearest) ** 2, axis=2) < (vehicle.radius + radius) ** 2
    return near & (p_WB[:, 2:3] - BODY_HALF_HEIGHT < top), names


def find_loss(states: np.ndarray, h: float, room: Room, vehicle: Vehicle) -> Lost | None:
    """Return the first loss in a series of true states, if any.

    A flight is lost when its state is no longer finite, when the vehicle tilts by more than 60 degrees, when its
    centre leaves the room, or when its outline touches a wall. Touching furniture does not end it, see contacts.

    Args:
        states: x at every tick (n, 12).
        h: tick [s].
        room: the room.
        vehicle: the vehicle.
    """
    p_WB, finite = states[:, 0:3], np.all(np.isfinite(states), axis=1)
    at_wall, _ = touched(p_WB, room, vehicle, walls=True)
    causes = {
        "diverged": ~finite,
        "tumbled": finite & (np.cos(states[:, 3]) * np.cos(states[:, 4]) < np.cos(MAX_TILT)),
        "left the room": finite & np.any((p_WB < room.interior.min) | (p_WB > room.interior.max), axis=1),
        "hit a wall": np.any(at_wall, axis=1),
    }
    found = [(int(np.argmax(bad)), cause) for cause, bad in causes.items() if bad.any()]
    if not found:
        return None
    tick, cause = min(found, key=lambda loss: loss[0])
    return Lost(tick, tick * h, cause)


def contacts(states: np.ndarray, room: Room, vehicle: Vehicle) -> list[str]:
    """Return the names of the furniture, stands and landmarks that the vehicle's outline touched.

    Their extents are our estimates, the walls' are surveyed: so a contact is reported beside a flight's errors, but
    does not end it.
    """
    touches, names = touched(states[:, 0:3], room, vehicle, walls=False)
    return sorted(set(names[np.any(touches, axis=0)].tolist()))
