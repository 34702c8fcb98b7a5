"""The layout of a new room: anchors around its walls, landmarks beside the way through it and at its end.

The floor is [0, x] times [0, y]. The camera looks along W's x axis (servo.yaw), so the way leads from low to high x,
and there are landmarks beyond its end.
"""

from typing import NamedTuple

import numpy as np

MARGIN = 0.2  # of an anchor from walls, floor and ceiling [m]
STAND = 0.86  # height of a stand [m]
ASIDE = 2.3  # of a landmark from the way where there is room [m]
LEAST_ASIDE = 0.95  # no landmark stands nearer [m]
STEP = 3.0  # at most, between landmarks along the way [m]
_APART = 0.8  # landmarks, at least [m]
_AT_WALL = 0.4  # of a landmark's centre from a wall [m]

# Class, and whether it is put on a stand; the classes of the detector that is shipped, those in turn that differ.
_BESIDE = (
    ("fire hydrant", False),
    ("person", False),
    ("potted plant", True),
    ("chair", False),
    ("bird", True),
    ("dog", False),
    ("cat", True),
)
_BEYOND = (("potted plant", True), ("person", False), ("clock", False), ("chair", False), ("cat", True))


class Placed(NamedTuple):
    """A landmark to be.

    Attributes:
        label: its class.
        x: of its centre [m].
        y: of its centre [m].
        bottom: height of what it stands on; None where it hangs on a wall [m].
    """

    label: str
    x: float
    y: float
    bottom: float | None


def way(x: float, y: float) -> tuple[np.ndarray, np.ndarray]:
    """Return start and goal (2 each) [m] of a way through a room of x by y [m]."""
    first, last = min(1.2, x / 4.0), x - max(1.2, min(2.5, 0.35 * x))
    aside = max(0.0, min(y / 6.0, y / 2.0 - 1.6, (last - first) / 4.0))
    return np.array([first, y / 2.0 - aside]), np.array([last, y / 2.0 + aside])


def place_anchors(size: tuple[float, float, float], count: int) -> np.ndarray:
    """Return p_W (count, 3) [m] of anchors around the walls of a room, low and high by turns.

    The first four stand in the corners; each further one goes to the middle of the longest gap along the walls.
    """
    x, y, z = (side - 2.0 * MARGIN for side in size)
    corners = [0.0, x, x + y, 2.0 * x + y]
    stations = corners[: min(count, 4)]
    while len(stations) < count:
        gaps = np.diff([*stations, 2.0 * (x + y)])
        i = int(np.argmax(gaps))
        stations.insert(i + 1, stations[i] + 0.5 * float(gaps[i]))
    rows = []
    for i, along in enumerate(stations):
        side = int(np.searchsorted(corners, along, side="right")) - 1
        left = along - corners[side]
        where = [(left, 0.0), (x, left), (x - left, y), (0.0, y - left)][side]
        rows.append([*where, z if i % 2 == 0 else 0.0])
    return np.array(rows) + MARGIN


def place_landmarks(size: tuple[float, float, float], start: np.ndarray, goal: np.ndarray) -> list[Placed]:
    """Return landmarks of a room: on both sides of the way by turns, and in a row at the wall beyond its end.

    Args:
        size: length, width and height of the room [m].
        start: of the way, x and y [m].
        goal: of the way, x and y [m].
    """
    x, y, _ = size
    found = []
    direction = (goal - start) / np.linalg.norm(goal - start)
    step = max(min(x / 5.0, STEP), 1.5)
    left = np.array([-direction[1], direction[0]])
    for i, along in enumerate(np.arange(start[0] + step, goal[0], step)):
        label, stands = _BESIDE[i % len(_BESIDE)]
        p = start + direction * (along - start[0]) + (1.0 if i % 2 == 0 else -1.0) * ASIDE * left
        p = np.clip(p, _AT_WALL, np.array([x, y]) - _AT_WALL)
        found.append(Placed(label, p[0], p[1], STAND if stands else 0.0))
    count = int(np.clip((y - 2.0 * _AT_WALL) / 1.2 + 1, 2, len(_BEYOND)))
    width = min(y - 2.0 * _AT_WALL, 1.4 * (count - 1))
    middle = min(max(goal[1], _AT_WALL + width / 2.0), y - _AT_WALL - width / 2.0)
    for (label, stands), across in zip(_BEYOND, np.linspace(-width / 2.0, width / 2.0, count), strict=False):
        hangs = label == "clock"
        bottom = None if hangs else STAND if stands else 0.0
        found.append(Placed(label, x - (0.06 if hangs else _AT_WALL), middle + across, bottom))
    kept: list[Placed] = []
    for placed in reversed(found):  # those beyond the way's end first
        p = np.array([placed.x, placed.y])
        alone = all(np.hypot(placed.x - other.x, placed.y - other.y) >= _APART for other in kept)
        if alone and np.linalg.norm(_to_way(p, start, goal)) >= LEAST_ASIDE:
            kept.append(placed)
    return kept[::-1]


def _to_way(p: np.ndarray, start: np.ndarray, goal: np.ndarray) -> np.ndarray:
    """Return the shortest vector (2) from the straight line between start and goal to a point (2)."""
    d = goal - start
    t = np.clip((p - start) @ d / (d @ d), 0.0, 1.0)
    return np.asarray(p - start - t * d)
