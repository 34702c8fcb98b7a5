"""Findings about a valid room: its properties, and likely mistakes, such as lengths that are hardly in metres."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from pydrake.trajectories import Trajectory

from ortilo_drake.model.footprints import footprints
from ortilo_drake.model.input_error import one_line
from ortilo_drake.model.input_files import read_text
from ortilo_drake.model.inputs.room_text import parse_room
from ortilo_drake.model.room import Room
from ortilo_drake.model.typed_yaml import InputError, all_problems
from ortilo_drake.onboard.planner.free_cells import free_space
from ortilo_drake.onboard.planner.planned import path_of
from ortilo_drake.scenario import GcsPlanner, Scenario
from ortilo_drake.studies.rooms.in_sight import Eyes, middles
from ortilo_drake.studies.rooms.room_scenario import room_scenario

LEAST_SPREAD = 0.3  # least RMS distance of the anchors from their best plane; from twice that on, they tell heights [m]
_LOOKS = 400  # places from which a landmark is looked for
_ROUNDING = 1e-6  # places nearer than this are the same [m]
_OUTER = 0.4  # outer walls stand at most so far outside the interior [m]
_FACE = 0.01  # a point less deep in a wall hangs on its face [m]


class Findings(NamedTuple):
    """The properties of a room and its likely mistakes, as lines; each warning begins with the field that it is about.

    path: the planned path from start to goal, None if there is none.
    """

    facts: list[str]
    warnings: list[str]
    path: Trajectory | None


def anchor_spread(anchors: np.ndarray) -> np.ndarray:
    """Return the RMS distances of anchors (n, 3) from their middle along their main axes, in falling order [m] (3).

    The last one is the distance from their best plane: if it is small, a position's side of the plane is uncertain.
    """
    scaled = (anchors - anchors.mean(axis=0)) / np.sqrt(len(anchors))
    return np.pad(np.linalg.svd(scaled, compute_uv=False), (0, 3))[:3]


def look_into(file: Path) -> Findings:
    """Return the findings on the room in a file; InputError if it does not load."""
    return findings_of(room_scenario(file))


def findings_of(scenario: Scenario) -> Findings:
    """Return the findings on the room of a scenario."""
    room = scenario.load_room()
    size = np.subtract(room.interior.max, room.interior.min)
    spread = anchor_spread(room.anchor_positions)
    extent = np.ptp(room.anchor_positions, axis=0)
    classes = ", ".join(f"{sum(one.label == label for one in room.landmarks)} {label}" for label in room.classes)
    obstacles = (
        (room.walls, "wall", "walls"),
        (room.stands, "stand", "stands"),
        (room.furniture, "piece of furniture", "pieces of furniture"),
    )
    facts = [
        f"room        {room.name}: {_sizes(size)} m, {size[0] * size[1]:.3g} m²",
        f"anchors     {len(room.anchors)}, spread over {_sizes(extent)} m, {spread[2]:.2f} m RMS off their best plane",
        f"landmarks   {len(room.landmarks)}{': ' if classes else ''}{classes}",
        "obstacles   "
        + ", ".join(f"{len(items)} {one if len(items) == 1 else many}" for items, one, many in obstacles),
    ]
    doubted, path = doubted_units(room), None
    if doubted and doubted[0].startswith("interior"):
        return Findings(facts, doubted, None)  # all other findings would follow from this mistake
    warnings = [*doubted, *_anchors(room, spread[2]), *([] if doubted else _places(room))]
    try:
        path = path_of(scenario)
        at = path.vector_values(np.linspace(0.0, path.end_time(), 500)).T
        length = np.linalg.norm(np.diff(at, axis=0), axis=1).sum()
        facts.append(f"way         {length:.1f} m in {path.end_time():.1f} s, {at[0, 2]:g} m high{_ends(scenario)}")
    except InputError as error:
        missing = [name for name in ("start", "goal") if getattr(room, name) is None]
        if missing:
            warnings.append(f"{', '.join(missing)}: not given; a scenario must have planner.{missing[0]} of its own")
        else:
            warnings.append(str(error).removeprefix("planner."))
    return Findings(facts, warnings + _unseen(scenario), path)


def _ends(scenario: Scenario) -> str:
    planner = scenario.planner
    if not isinstance(planner, GcsPlanner):
        return ""
    return f": from {_point(planner.start)} to {_point(planner.goal)}"


def _anchors(room: Room, off_plane: float) -> list[str]:
    found = []
    if len(room.anchors) < 4:
        found.append("anchors: 3 given: a position and its mirror image have the same ranges; 4 tell them apart")
    elif off_plane < LEAST_SPREAD:
        found.append(
            f"anchors: {off_plane:.2f} m RMS off one plane, should be at least {LEAST_SPREAD:g} m: they hardly tell "
            "on which side of the plane the vehicle is; mount some low and some high"
        )
    for i, p in enumerate(room.anchors):
        for j in range(i):
            if np.linalg.norm(np.subtract(p, room.anchors[j])) < _ROUNDING:
                found.append(f"anchors.{i}: {_point(p)}: the same place as anchors.{j}")
    return found


def _places(room: Room) -> list[str]:
    """Return lines on things outside the room or in a wall, and on walls whose yaw is hardly in radians."""
    low, high = np.array(room.interior.min), np.array(room.interior.max)
    landmarks = [landmark.position for landmark in room.landmarks]
    given = {"anchors": room.anchors, "landmarks": landmarks, "stands": room.stands}
    found = []
    for field, points in given.items():
        for i, p in enumerate(points):
            n = len(p)
            if np.any(np.array(p) < low[:n] - _ROUNDING) or np.any(np.array(p) > high[:n] + _ROUNDING):
                found.append(f"{field}.{i}: {_outside(np.array(p), low[:n], high[:n])}")
    for i, item in enumerate(footprints(room)[: len(room.walls)]):
        if np.any(np.array(item.high) < low[:2] - _OUTER) or np.any(np.array(item.low) > high[:2] + _OUTER):
            found.append(f"walls.{i}: {_outside(np.array(room.walls[i][:2]), low[:2], high[:2])}")
        if abs(room.walls[i][2]) > 2.0 * np.pi:
            found.append(
                f"walls.{i}: yaw {room.walls[i][2]:g}: is in radians, {np.radians(room.walls[i][2]):.4g} if in °"
            )
    found += [f"anchors.{i}: {_point(p)}: in a wall" for i, p in enumerate(room.anchors) if _in_wall(room, p)]
    return found + [
        f"landmarks.{i}: {landmark.label} at {_point(landmark.position)}: its middle is in a wall"
        for i, landmark in enumerate(room.landmarks)
        if _in_wall(room, landmark.position)
    ]


def _in_wall(room: Room, p: Sequence[float]) -> bool:
    """Return whether a point p_W (3) [m] is within a wall, and not only on its face."""
    x, y, z = (np.asarray(p) - room.wall_boxes[:, :3]).T
    c, s = np.cos(room.wall_boxes[:, 3]), np.sin(room.wall_boxes[:, 3])
    away = np.abs(np.column_stack([c * x + s * y, c * y - s * x, z]))
    return bool(np.any(np.all(away < room.wall_boxes[:, 4:] - _FACE, axis=1)))


def _unseen(scenario: Scenario) -> list[str]:
    """Return lines on the landmarks that no vehicle in the free space can see, even if it heads towards them."""
    room, planner = scenario.load_room(), scenario.planner
    if not room.landmarks:
        return ["landmarks: none: the camera measures nothing"]
    height = getattr(planner, "height", 1.5)
    space = free_space(room, height, scenario.vehicle.radius, 0.0, getattr(planner, "vertical_clearance", 0.0))
    low, high = space.bounds[:, :2]
    n = np.maximum(np.round(np.sqrt(_LOOKS * (high - low) / (high - low)[::-1])), 1).astype(int)
    x, y = middles(low, high, n)
    free = np.argwhere(space.room_on_grid(x, y) > 0.0)
    eyes, left = Eyes(scenario), set(range(len(room.landmarks)))
    for i in sorted(left):
        away = room.landmark_positions[i, :2] - np.column_stack([x[free[:, 0]], y[free[:, 1]]])
        nearness = np.abs(np.linalg.norm(away, axis=1) - 3.0)  # three metres is a good distance to look from
        for k in np.argsort(nearness):
            if i not in left:
                break
            place = np.array([x[free[k, 0]], y[free[k, 1]], height])
            left -= set(eyes.in_view(place, float(np.arctan2(*away[k, ::-1]))).tolist())
    return [
        f"landmarks.{i}: {room.landmarks[i].label} at {_point(room.landmarks[i].position)}: the camera sees it from "
        f"nowhere at {height:g} m height"
        for i in sorted(left)
    ]


def _sizes(sides: np.ndarray, digits: int = 3) -> str:
    return " x ".join(f"{float(f'{side:.{digits}g}'):g}" for side in sides)


def _point(p: object) -> str:
    return "(" + ", ".join(f"{value:.4g}" for value in np.asarray(p, dtype=float)) + ")"


# Valid values of the fields that every room needs, used to check the rest of a file in which these fields are wrong.
_ANY_ROOM = {
    "interior": {"min": [0.0, 0.0, 0.0], "max": [1.0, 1.0, 1.0]},
    "anchors": [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
}


def room_problems(path: Path) -> list[str]:
    """Return a line for each error in a room file: file, field, value and what is allowed.

    InputError if the file cannot be read or is not YAML.
    """
    data = parse_room(read_text(path), str(path))
    return [one_line(f"{path}: {line}") for line in all_problems(Room, data, _ANY_ROOM)]


UNITS: Final = {"feet": 0.3048, "inches": 0.0254, "centimetres": 0.01, "millimetres": 0.001, "kilometres": 1000.0}
SIDES, HEIGHTS = (1.5, 300.0), (1.5, 30.0)  # sides and heights of a plausible room [m]
_WITHIN, _AS_HIGH = (2.0, 100.0), (2.0, 6.0)  # sides and heights that a room must have in another unit [m]
_IN_FEET = (7.0, 11.0)  # heights of a hall in metres, and of a usual room in feet
_NO_SLIP = 0.05  # share of the room's side; nearer to its origin in another unit, a place may be a slip as well
_STANDS = 0.3  # a thing whose underside is lower stands on the floor [m]


def doubted_units(room: Room) -> list[str]:
    """Return a line for each group of lengths that are hardly in metres, beginning with the field."""
    low, high = np.array(room.interior.min), np.array(room.interior.max)
    size = high - low
    unit = _unit_of(room, size)
    if unit is None:
        return _anchors_alone(room, low, high)
    factor, places = UNITS[unit], _coordinates(room)
    also = [name for name, values in places.items() if _is_scaled(values, np.abs([low, high]).max(), factor)]
    fields = f"interior, {', '.join(also)} by {factor:g}" if also else f"it by {factor:g}"
    return [
        f"interior: {_sizes(size, 4)} m: in {unit} it would be {_sizes(size * factor, 4)} m; lengths are in metres: "
        f"multiply {fields}"
    ]


def _unit_of(room: Room, size: np.ndarray) -> str | None:
    sides, height = size[:2], size[2]
    if not (SIDES[0] <= sides.min() and sides.max() <= SIDES[1] and HEIGHTS[0] <= height <= HEIGHTS[1]):
        fits = [unit for unit, factor in UNITS.items() if _is_room(size * factor)]
        return fits[0] if fits else None
    standing = [p[2] - half for p, half in zip(room.landmark_positions, room.landmark_sizes[:, 2] / 2, strict=True)]
    is_high = _IN_FEET[0] <= height <= _IN_FEET[1] and _is_room(size * UNITS["feet"])
    return "feet" if is_high and min(standing, default=np.inf) > room.interior.min[2] + _STANDS else None


def _is_room(size: np.ndarray) -> bool:
    within = _WITHIN[0] <= size[:2].min() and size[:2].max() <= _WITHIN[1]
    return bool(within and _AS_HIGH[0] <= size[2] <= _AS_HIGH[1])


def _coordinates(room: Room) -> dict[str, np.ndarray]:
    """Return the coordinates of all things placed in a room, by field (n, 2 or 3)."""
    ends = [*(room.start or ()), *(room.goal or ())]
    found = {
        "anchors": room.anchor_positions,
        "landmarks": room.landmark_positions,
        "walls": room.wall_boxes[:, :2],
        "stands": np.array(room.stands),
        "furniture": np.array([item[1:4] for item in room.furniture]),
        "start and goal": np.array(ends),
    }
    return {name: values for name, values in found.items() if values.size}


def _outside(p: np.ndarray, low: np.ndarray, high: np.ndarray) -> str:
    """Return the words that a place is outside the interior, and a question for a unit in which it would be inside."""
    asked = ""
    for unit in ("centimetres", "millimetres"):
        there = p * UNITS[unit]
        if np.all((there >= low) & (there <= high)) and np.abs(there).max() > _NO_SLIP * np.max(high - low):
            asked = f"; is it in {unit}?"
            break
    return f"{_point(p)}: outside the interior, {_point(low)} to {_point(high)}{asked}"


def _is_scaled(values: np.ndarray, farthest: float, factor: float) -> bool:
    """Return whether places have the interior's own unit, instead of metres already, by how far they reach."""
    reach = float(np.abs(values).max())
    return reach > farthest * np.sqrt(factor) if factor < 1.0 else reach < farthest * np.sqrt(factor)


def _anchors_alone(room: Room, low: np.ndarray, high: np.ndarray) -> list[str]:
    """Return a line if most anchors are outside the interior, and in another unit all would be inside."""
    anchors = room.anchor_positions

    def within(p: np.ndarray) -> np.ndarray:
        return np.all((p >= low - 0.5) & (p <= high + 0.5), axis=1)

    if np.count_nonzero(~within(anchors)) * 2 <= len(anchors):
        return []
    for unit, factor in UNITS.items():
        if within(anchors * factor).all() and np.ptp(anchors * factor, axis=0)[:2].max() > 0.2 * (high - low)[:2].max():
            return [
                f"anchors: {np.count_nonzero(~within(anchors))} of {len(anchors)} lie outside the interior; in {unit} "
                f"all would be within: lengths are in metres: multiply them by {factor:g}"
            ]
    return []
