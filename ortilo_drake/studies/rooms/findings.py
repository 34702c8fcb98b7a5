"""Findings about a room that loads: its properties, and likely mistakes."""

from pathlib import Path
from typing import NamedTuple

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
from ortilo_drake.studies.rooms.in_sight import Eyes
from ortilo_drake.studies.rooms.room_scenario import room_scenario
from ortilo_drake.studies.rooms.units import doubted_units

LEAST_SPREAD = 0.3  # of the anchors about their best plane, root mean square; twice that, and heights tell [m]
_LOOKS = 400  # places that a landmark is looked for from
_ROUNDING = 1e-6  # [m]


class Findings(NamedTuple):
    """The properties of a room, and its likely mistakes.

    Attributes:
        facts: lines.
        warnings: lines, each beginning with the field that it is about.
        path: the planned way from start to goal, if there is one.
    """

    facts: list[str]
    warnings: list[str]
    path: Trajectory | None


def anchor_spread(anchors: np.ndarray) -> np.ndarray:
    """Return the root mean square distances of anchors (n, 3) from their middle along their main axes, falling [m] (3).

    The last is their distance from their best plane: if it is small, a position's side of the plane is uncertain.
    """
    scaled = (anchors - anchors.mean(axis=0)) / np.sqrt(len(anchors))
    return np.pad(np.linalg.svd(scaled, compute_uv=False), (0, 3))[:3]


def look_into(file: Path) -> Findings:
    """Return the findings on the room in a file; InputError if it does not load."""
    scenario = room_scenario(file)
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
        return Findings(facts, doubted, None)  # what else there is to say follows from it
    warnings = [*doubted, *_anchors(room, spread[2]), *([] if doubted else _places(room))]
    try:
        path = path_of(scenario)
        at = path.vector_values(np.linspace(0.0, path.end_time(), 500)).T
        length = np.linalg.norm(np.diff(at, axis=0), axis=1).sum()
        facts.append(f"way         {length:.1f} m in {path.end_time():.1f} s, {at[0, 2]:g} m high: {_ends(scenario)}")
    except InputError as error:
        missing = [name for name in ("start", "goal") if getattr(room, name) is None]
        if missing:
            warnings.append(f"{', '.join(missing)}: not given; a scenario must have planner.{missing[0]} of its own")
        else:
            warnings.append(str(error).removeprefix("planner."))
    return Findings(facts, warnings + _unseen(scenario), path)


def _ends(scenario: Scenario) -> str:
    planner = scenario.planner
    assert isinstance(planner, GcsPlanner)
    return f"from {_point(planner.start)} to {_point(planner.goal)}"


def _anchors(room: Room, off_plane: float) -> list[str]:
    found = []
    if len(room.anchors) < 4:
        found.append("anchors: 3 given: a position and its mirror image have the same ranges; 4 tell them apart")
    elif off_plane < LEAST_SPREAD:
        found.append(
            f"anchors: {off_plane:.2f} m RMS off one plane, should be at least {LEAST_SPREAD:g} m: they tell badly on "
            "which side of it the vehicle is; mount some low and some high"
        )
    for i, p in enumerate(room.anchors):
        for j in range(i):
            if np.linalg.norm(np.subtract(p, room.anchors[j])) < _ROUNDING:
                found.append(f"anchors.{i}: {_point(p)}: the same place as anchors.{j}")
    return found


def _places(room: Room) -> list[str]:
    """Return the names of things outside the room."""
    low, high = np.array(room.interior.min), np.array(room.interior.max)
    landmarks = [landmark.position for landmark in room.landmarks]
    given = {"anchors": room.anchors, "landmarks": landmarks, "stands": room.stands}
    found = []
    for field, points in given.items():
        for i, p in enumerate(points):
            n = len(p)
            if np.any(np.array(p) < low[:n] - _ROUNDING) or np.any(np.array(p) > high[:n] + _ROUNDING):
                found.append(f"{field}.{i}: {_point(p)}: outside the interior, {_point(low[:n])} to {_point(high[:n])}")
    walls = [item for item in footprints(room) if item.name == "wall"]
    for i, landmark in enumerate(room.landmarks):
        x, y, z = landmark.position
        for wall in walls:
            if wall.low[0] < x < wall.high[0] and wall.low[1] < y < wall.high[1] and z < wall.top:
                found.append(f"landmarks.{i}: {landmark.label} at {_point(landmark.position)}: its middle is in a wall")
                break
    return found


def _unseen(scenario: Scenario) -> list[str]:
    """Return the landmarks that no vehicle in the free space can see, even if it looks their way."""
    room = scenario.load_room()
    if not room.landmarks:
        return ["landmarks: none: the camera tells nothing"]
    planner = scenario.planner
    height = getattr(planner, "height", 1.5)
    space = free_space(room, height, scenario.vehicle.radius, 0.0, getattr(planner, "vertical_clearance", 0.0))
    low, high = space.bounds[:, :2]
    n = np.maximum(np.round(np.sqrt(_LOOKS * (high - low) / (high - low)[::-1])), 1).astype(int)
    x, y = (a + (b - a) * (np.arange(k) + 0.5) / k for a, b, k in zip(low, high, n, strict=True))
    free = np.argwhere(space.room_on_grid(x, y) > 0.0)
    eyes, left = Eyes(scenario), set(range(len(room.landmarks)))
    for i in sorted(left):
        away = room.landmark_positions[i, :2] - np.column_stack([x[free[:, 0]], y[free[:, 1]]])
        for k in np.argsort(
            np.abs(np.linalg.norm(away, axis=1) - 3.0)
        ):  # three metres off is a good place to look from
            if i not in left:
                break
            place = np.array([x[free[k, 0]], y[free[k, 1]], height])
            left -= set(eyes.in_view(place, float(np.arctan2(*away[k, ::-1]))).tolist())
    return [
        f"landmarks.{i}: {room.landmarks[i].label} at {_point(room.landmarks[i].position)}: the camera sees it from "
        f"nowhere at {height:g} m height"
        for i in sorted(left)
    ]


def _sizes(sides: np.ndarray) -> str:
    return " x ".join(f"{float(f'{side:.3g}'):g}" for side in sides)


def _point(p: object) -> str:
    return "(" + ", ".join(f"{value:.4g}" for value in np.asarray(p, dtype=float)) + ")"


# Right values of what every room needs, for looking at the rest of a file where these are wrong.
_ANY_ROOM = {
    "interior": {"min": [0.0, 0.0, 0.0], "max": [1.0, 1.0, 1.0]},
    "anchors": [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
}


def room_problems(path: Path) -> list[str]:
    """Return a line for each thing that is wrong with a room file: file, field, value and what is allowed.

    Raises:
        InputError: if the file cannot be read or is no YAML.
    """
    data = parse_room(read_text(path), str(path))
    return [one_line(f"{path}: {line}") for line in all_problems(Room, data, _ANY_ROOM)]
