"""Settings of the planner: the path to fly."""

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, NonNegativeFloat, model_validator

from ortilo_drake.model.input_files import read_text
from ortilo_drake.model.room import Vec3
from ortilo_drake.model.typed_yaml import LARGEST, FileName, Frozen, InputError, Positive

MAX_POINTS = 10_000  # most points of a path


class GcsPlanner(Frozen):
    """A smooth collision-free path at constant altitude through convex free cells."""

    kind: Literal["gcs"] = "gcs"
    start: tuple[float, float] = (0.0, 0.0)
    """start of the path, x and y in W [m]; the flight starts hovering there. If none is given, the room's start is
    used, if its file has one."""
    goal: tuple[float, float] = (21.0, -3.2)
    """goal of the path, x and y in W [m]. If none is given, the room's goal is used, if its file has one."""
    height: Positive = 1.5
    """flying height [m]."""
    speed: Positive = 0.35
    """path speed [m/s]."""
    acceleration: Positive = 0.2
    """largest acceleration [m/s^2]."""
    clearance: NonNegativeFloat = 1.6
    """horizontal distance between the vehicle's outline and every obstacle [m]; less in narrow places."""
    vertical_clearance: NonNegativeFloat = 0.6
    """distance below the flying height [m]; the path may pass over obstacles that end lower than this."""
    prefer: Literal["none", "seen"] = "none"
    """'seen' prefers places where the surveyed room gives fixes: a metre without a fix costs as much as six metres with
    one. 'none' takes the shortest path."""


class WaypointPlanner(Frozen):
    """A smooth path through given points, from the scenario or from a file."""

    kind: Literal["waypoints"]
    points: Annotated[tuple[Vec3, ...], Field(max_length=MAX_POINTS)] = ()
    """the points p_W [m], unless a file gives them."""
    file: FileName | None = None
    """a text file with one point 'x y z' [m] per line."""
    speed: Positive = 0.35
    """path speed [m/s]."""
    acceleration: Positive = 0.2
    """largest acceleration [m/s^2]."""

    @model_validator(mode="after")
    def _has_points(self) -> "WaypointPlanner":
        if self.file is not None and self.points:
            raise ValueError("give points or file, not both")
        if self.file is None and not self.points:
            raise ValueError("points: none given and no file either")
        return self


class HoverPlanner(Frozen):
    """Stay at one point."""

    kind: Literal["hover"]
    point: Vec3 = (0.0, 0.0, 1.5)
    """the point p_W [m]."""
    duration: Annotated[float, Field(ge=1e-3, le=36000.0)] = 10.0
    """duration of the hover [s]."""


Planner = Annotated[GcsPlanner | WaypointPlanner | HoverPlanner, Field(discriminator="kind")]


def read_waypoints(path: Path) -> np.ndarray:
    """Return the waypoints p_W (n x 3) [m] of a text file with one 'x y z' per line; '#' starts a comment.

    InputError names file and line.
    """
    points = []
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        words = line.partition("#")[0].replace(",", " ").split()
        if not words:
            continue
        try:
            point = [float(word) for word in words]
        except ValueError:
            raise InputError(f"{path}: line {number}: {line.strip()!r} is not three numbers") from None
        if len(point) != 3 or not np.all(np.abs(point) <= LARGEST):
            raise InputError(f"{path}: line {number}: {line.strip()!r} is not three finite numbers up to {LARGEST:g}")
        points.append(point)
    if len(points) > MAX_POINTS:
        raise InputError(f"{path}: {len(points)} points: must not be more than {MAX_POINTS}")
    return np.array(points).reshape(-1, 3)
