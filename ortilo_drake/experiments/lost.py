"""When and why a flight is lost."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ortilo_drake.model.room import Room, footprints
from ortilo_drake.model.vehicle import Vehicle

MAX_TILT = np.pi / 3  # beyond this the vehicle counts as tumbling
BODY_HALF_HEIGHT = 0.15  # of the airframe about the centre of mass [m]; ours, for the M100


@lru_cache(maxsize=8)
def _obstacles(room: Room) -> tuple[np.ndarray, np.ndarray, np.ndarray, tuple[str, ...]]:
    """Return the obstacles' lower and upper corners (n, 2), tops (n) and names."""
    found = footprints(room)
    low, high = np.array([f.low for f in found]), np.array([f.high for f in found])
    return low, high, np.array([f.top for f in found]), tuple(f.name for f in found)


@dataclass(frozen=True)
class Lost:
    """A lost flight: the tick and time at which it ended, and why."""

    tick: int
    time: float
    cause: str


def find_loss(states: np.ndarray, h: float, room: Room, vehicle: Vehicle) -> Lost | None:
    """Return the first loss in a series of true states, if any.

    A flight is lost when the state is no longer finite, the vehicle tilts by more than 60 degrees, its centre
    leaves the room, or its outline (a disc of vehicle.radius) touches a wall, stand, landmark or piece of
    furniture that reaches up to it.

    Args:
        states: x at every tick (n, 12).
        h: tick [s].
        room: the room.
        vehicle: the vehicle.
    """
    p, finite = states[:, 0:3], np.all(np.isfinite(states), axis=1)
    low, high, top, names = _obstacles(room)
    nearest = np.clip(p[:, np.newaxis, 0:2], low, high)
    touches = np.sum((p[:, np.newaxis, 0:2] - nearest) ** 2, axis=2) < vehicle.radius**2
    hits = touches & (p[:, 2:3] - BODY_HALF_HEIGHT < top)
    causes = {
        "diverged": ~finite,
        "tumbled": finite & (np.cos(states[:, 3]) * np.cos(states[:, 4]) < np.cos(MAX_TILT)),
        "left the room": finite & np.any((p < room.interior.min) | (p > room.interior.max), axis=1),
        "hit": np.any(hits, axis=1),
    }
    found = [(int(np.argmax(bad)), cause) for cause, bad in causes.items() if bad.any()]
    if not found:
        return None
    tick, cause = min(found, key=lambda loss: loss[0])
    if cause == "hit":
        cause = f"hit {names[int(np.argmax(hits[tick]))]}"
    return Lost(tick, tick * h, cause)
