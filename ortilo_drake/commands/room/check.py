"""The command `ortilo room check`: it lists the errors of a room file."""

from pathlib import Path
from typing import Annotated

import typer

from ortilo_drake.commands.terminal import DOUBTFUL, say, say_error
from ortilo_drake.model.input_error import one_line

RoomArgument = Annotated[Path, typer.Argument(metavar="ROOM", help="A room's .yaml file.")]


def check(room: RoomArgument) -> None:
    """List all errors of a room file, a line each, with exit code 2; or, if there are none, its contents.

    A room that loads may still be a bad one: lines that begin with `warning` say what looks like a mistake, and the
    exit code is 3.
    """
    from ortilo_drake.studies.rooms.findings import room_problems

    problems = room_problems(room)
    for line in problems:
        say_error(f"ortilo: {line}")
    if problems:
        raise typer.Exit(2)
    from ortilo_drake.studies.rooms.findings import look_into

    found = look_into(room)
    for line in found.facts:
        say(f"OK       {one_line(line)}")
    for line in found.warnings:
        say(f"warning  {one_line(line)}")
    if found.warnings:
        raise typer.Exit(DOUBTFUL)
