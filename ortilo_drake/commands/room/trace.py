"""The command `ortilo room trace`: it makes a room from a picture of its floor plan."""

from pathlib import Path
from typing import Annotated

import typer

from ortilo_drake.commands.options import finite
from ortilo_drake.commands.room.new import AnchorsOption, ForceOption, check_new, room_name, say_next
from ortilo_drake.commands.terminal import say
from ortilo_drake.model.input_error import InputError


def trace(
    plan: Annotated[
        Path,
        typer.Argument(metavar="PLAN", help="A picture, dark walls on light paper; or the .yaml of a map_server grid."),
    ],
    file: Annotated[Path, typer.Option("--out", metavar="ROOM", help="The .yaml file to write.")],
    scale: Annotated[float | None, typer.Option(min=1.0, callback=finite, help="Pixels per metre.")] = None,
    height: Annotated[float, typer.Option(min=2.0, max=20.0, callback=finite, help="Height of the room [m].")] = 2.5,
    dark: Annotated[int, typer.Option(min=1, max=255, help="Pixels darker than this are walls.")] = 128,
    anchors: AnchorsOption = 5,
    force: ForceOption = False,
) -> None:
    """Trace the walls of a floor plan, and write a room with them, anchors, landmarks, a start and a goal.

    A grid has its own scale and origin: the room is in its frame. The command finds walls along the
    picture's sides, as rectangles, but none at an angle.
    """
    check_new(file, force)
    import numpy as np

    from ortilo_drake.flight.files import write_text
    from ortilo_drake.studies.rooms.new_room import LARGEST, check_size, new_room
    from ortilo_drake.studies.rooms.trace_plan import read_plan, trace_plan

    read = read_plan(plan, scale, dark)
    source = f"{plan}: at --scale {read.scale:g}"
    length, width = (min(side / read.scale, LARGEST[0]) for side in reversed(read.wall.shape))  # with the margins
    check_size(source, (length, width, height))
    try:
        traced = trace_plan(read)
    except InputError as error:
        raise InputError(f"{plan}: {error}") from None
    size = (float(traced.size[0]), float(traced.size[1]), height)
    check_size(source, size)
    ends = traced.start, traced.goal
    if np.array_equal(*ends):
        raise InputError(f"{plan}: all of it is wall: must have free space to fly in")
    corner = traced.corner if plan.suffix in (".yaml", ".yml") else np.zeros(2)
    write_text(file, new_room(room_name(file), size, anchors, traced.walls, ends, corner))
    sides = f"{size[0]:.2f} x {size[1]:.2f} m within"
    covered = f"they cover {traced.covered:.1%} of the dark and thick pixels"
    say(f"{len(traced.walls)} walls, {sides}; {covered}")
    say_next(file)
