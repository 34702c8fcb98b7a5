"""The text of a new room file, with comments for whoever goes on with it."""

import math
import re

import numpy as np

from ortilo_drake.model.input_error import InputError
from ortilo_drake.model.inputs.numbers import decimal
from ortilo_drake.model.room import MAX_ANCHORS, load_room
from ortilo_drake.studies.rooms.room_layout import STAND, Placed, place_anchors, place_landmarks, way

SMALLEST = (3.0, 3.0, 2.0)  # [m]
LARGEST = (100.0, 100.0, 20.0)  # [m]: what the planner searches for a way
_OFF_WALL = 0.3  # of a landmark's middle from a wall within the room, at least [m]
_CLOCK = 0.4  # of the clock's middle below the ceiling, at most 2.2 m high [m]


def parse_size(text: str) -> tuple[float, float, float]:
    """Return length, width and height [m] of a text such as '8x6x3'.

    Raises:
        InputError: naming what is allowed.
    """
    allowed = "must read LENGTHxWIDTHxHEIGHT in metres, such as 8x6x3"
    words = re.split("[x×X]", text)
    try:
        x, y, z = (decimal(word) for word in words)
    except ValueError:
        raise InputError(f"--size: {text!r}: {allowed}") from None
    check_size(f"--size: {text!r}", (x, y, z))
    return x, y, z


def check_size(source: str, size: tuple[float, float, float]) -> None:
    """Refuse a room that is too small to fly in or too large to plan in; InputError, which begins with the source."""
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
    """Return the text of a new room file.

    Args:
        name: what figures call the room.
        size: length, width and height [m].
        anchors: how many.
        walls: within the room: x, y of the middle, length along x and along y [m] (n, 4).
        ends: start and goal (2 each) [m] from the lower left corner, as the walls; by default through the middle.
        corner: x, y of that corner [m] (2); by default (0, 0).

    Raises:
        InputError: if there are too few or too many anchors.
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
