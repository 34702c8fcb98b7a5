"""The text of a new room file, with comments for its editor, and the layout of the new room.

Anchors are around the walls, landmarks beside the way through the room and beyond the way's end. The floor is [0, x]
times [0, y]. The camera looks along W's x axis (servo.yaw), so the way leads from low to high x.
"""

import math
import re
from typing import NamedTuple

import numpy as np

from ortilo_drake.model.input_error import InputError
from ortilo_drake.model.inputs.numbers import decimal
from ortilo_drake.model.room import MAX_ANCHORS, load_room

MARGIN = 0.2  # distance of an anchor from walls, floor and ceiling [m]
STAND = 0.86  # height of a stand [m]
ASIDE = 2.3  # distance of a landmark from the way if there is room [m]
LEAST_ASIDE = 0.95  # least distance of a landmark from the way [m]
STEP = 3.0  # largest distance between landmarks along the way [m]
_APART = 0.8  # least distance between landmarks [m]
_AT_WALL = 0.4  # distance of a landmark's centre from a wall [m]

# Class of the shipped detector, and whether it stands on a stand; successive classes look different.
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
    """A planned landmark: its class, its centre's x and y [m], and the height of its underside [m].

    bottom is None for a landmark that hangs on a wall.
    """

    label: str
    x: float
    y: float
    bottom: float | None


def way(x: float, y: float) -> tuple[np.ndarray, np.ndarray]:
    """Return start and goal (2 each) [m] of a way through a room with sides x and y [m]."""
    first, last = min(1.2, x / 4.0), x - max(1.2, min(2.5, 0.35 * x))
    aside = max(0.0, min(y / 6.0, y / 2.0 - 1.6, (last - first) / 4.0))
    return np.array([first, y / 2.0 - aside]), np.array([last, y / 2.0 + aside])


def place_anchors(size: tuple[float, float, float], count: int) -> np.ndarray:
    """Return p_W (count, 3) [m] of anchors around the walls of a room, high and low by turns.

    The first four are in the corners; each further anchor is in the middle of the longest gap along the walls.
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
    """Return landmarks of a room: on both sides of the way by turns, and in a row at the wall beyond the way's end.

    size: length, width and height of the room [m]; start, goal: of the way (2 each) [m].
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
    for placed in reversed(found):  # landmarks beyond the way's end first
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


SMALLEST = (3.0, 3.0, 2.0)  # least length, width and height [m]
LARGEST = (100.0, 100.0, 20.0)  # largest ones, in which the planner searches for a way [m]
_OFF_WALL = 0.3  # least distance of a landmark's middle from a wall within the room [m]
_CLOCK = 0.4  # distance of the clock's middle from the ceiling; the clock is at most 2.2 m high [m]


def parse_size(text: str) -> tuple[float, float, float]:
    """Return length, width and height [m] from a text such as '8x6x3'; InputError names what is allowed."""
    allowed = "must read LENGTHxWIDTHxHEIGHT in metres, such as 8x6x3"
    words = re.split("[x×X]", text)
    try:
        x, y, z = (decimal(word) for word in words)
    except ValueError:
        raise InputError(f"--size: {text!r}: {allowed}") from None
    check_size(f"--size: {text!r}", (x, y, z))
    return x, y, z


def check_size(source: str, size: tuple[float, float, float]) -> None:
    """Raise InputError, beginning with `source`, for a room too small to fly in or too large to plan in."""
    for name, side, low, high in zip(("length", "width", "height"), size, SMALLEST, LARGEST, strict=True):
        if not (math.isfinite(side) and low <= side <= high):
            raise InputError(f"{source}: its {name}, {side:g} m, must be {low:g} to {high:g} m")


def new_room(
    name: str,
    size: tuple[float, float, float],
    anchors: int,
    walls: np.ndarray | None = None,
    ends: tuple[np.ndarray, np.ndarray] | None = None,
    corner: np.ndarray | None = None,
) -> str:
    """Return the text of a new room file; size: length, width and height of the room [m]; anchors: their number.

    walls: inner walls, x, y of the middle, length along x and along y [m] (n, 4); ends: start and goal (2 each) [m], by
    default through the middle; both count from the lower left corner; corner: this corner's x, y [m] (2), by default
    (0, 0). InputError if there are too few or too many anchors.
    """
    if not 3 <= anchors <= MAX_ANCHORS:
        raise InputError(f"--anchors: {anchors}: must be 3 to {MAX_ANCHORS}")
    x, y, z = size
    start, goal = way(x, y) if ends is None else ends
    walls = np.empty((0, 4)) if walls is None else walls
    x_0, y_0 = (0.0, 0.0) if corner is None else (float(corner[0]), float(corner[1]))
    found = [placed for placed in place_landmarks(size, start, goal) if not _in_wall(placed, walls)]
    heights = {label: extent[2] for label, extent in load_room().landmark_size.items()}
    landmarks = []
    for placed in found:
        height = min(2.2, z - _CLOCK) if placed.bottom is None else placed.bottom + heights[placed.label] / 2.0
        place = _numbers(x_0 + placed.x, y_0 + placed.y, height)
        landmarks.append(f"  - {{label: {placed.label}, position: {place}, yaw: 3.14}}")
    stands = [f"  - {_numbers(x_0 + p.x, y_0 + p.y)}" for p in found if p.bottom]
    return _TEXT.format(
        name=name,
        size=" x ".join(f"{side:g}" for side in size),
        low=_numbers(x_0, y_0, 0.0),
        corner=_numbers(x_0 + x, y_0 + y, z),
        start=_numbers(*(start + [x_0, y_0])),
        goal=_numbers(*(goal + [x_0, y_0])),
        anchors="\n".join(f"  - {_numbers(*(row + [x_0, y_0, 0.0]))}" for row in place_anchors(size, anchors)),
        landmarks="\n" + "\n".join(landmarks) if landmarks else " []",
        stand=f"{STAND:g}",
        stands="\n" + "\n".join(stands) if stands else " []",
        walls="\n".join(f"  - {_numbers(x_0 + cx, y_0 + cy, 0.0, dx, dy, z)}" for cx, cy, dx, dy in walls) or _NO_WALL,
        head="" if len(walls) else " []",
    )


def _in_wall(placed: Placed, walls: np.ndarray) -> bool:
    """Return whether a landmark would stand in a wall or touch it."""
    away = np.abs(walls[:, :2] - [placed.x, placed.y]) - walls[:, 2:] / 2
    return bool(np.any(np.all(away < _OFF_WALL, axis=1)))


def _numbers(*values: float) -> str:
    return "[" + ", ".join(f"{round(float(value), 3):.6g}" for value in values) + "]"


_NO_WALL = """\
#  - [4.0, 2.0, 1.5708, 3.0, 0.15, 2.5]
#  - [2.0, 3.0, 0.0, 0.4, 0.4, 2.5] # a pillar"""
_TEXT = """\
# A room of {size} m, made by ortilo: measure yours and change what differs. SI units; x east, y north,
# z up from the corner {low}. What is left out is as in the authors' room, ortilo_drake/model/ortilo_room.yaml.
name: {name}

# Two opposite corners of the free space: inner faces of the walls, floor and ceiling [m].
interior: {{min: {low}, max: {corner}}}

# Where a flight begins and ends, x and y [m], if its scenario does not say: the camera looks along x.
start: {start}
goal: {goal}

# UWB anchors: position of each antenna [m]. Low and high ones by turns tell the height; all in one plane do not.
anchors:
{anchors}

# What the camera looks for: class (person, fire hydrant, dog, potted plant, chair, bicycle, bird, cat, clock),
# centre [m], yaw [rad], and `size: [x, y, z]` [m] where it differs from that of its class.
landmarks:{landmarks}

# Round stands on the floor that carry landmarks: x and y [m].
stand_radius: 0.25
stand_height: {stand}
stands:{stands}

# Walls and pillars within the room, boxes on the floor: [x, y, yaw, length, thickness, height], x and y of the middle.
walls:{head}
{walls}

# Other things to fly around: [kind, x, y, z, roll, pitch, yaw], z of the underside, and the size of each kind along
# x, y and z.
furniture: []
furniture_size: {{}}
"""
