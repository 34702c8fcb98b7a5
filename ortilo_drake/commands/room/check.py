"""The command `ortilo room check`: is a room file right?"""

from pathlib import Path
from typing import Annotated

import typer

from ortilo_drake.commands.terminal import out, say_error

RoomArgument = Annotated[Path, typer.Argument(metavar="ROOM", help="A room's .yaml file.")]


def check(room: RoomArgument) -> None:
    """Say all that is wrong with a room file at once, a line each, with exit code 2; or what is in it."""
    from ortilo_drake.model.room import load_room
    from ortilo_drake.studies.rooms.room_file import room_problems

    problems = room_problems(room)
    for line in problems:
        say_error(f"ortilo: {line}")
    if problems:
        raise typer.Exit(2)
    found = load_room(room)
    size = [high - low for low, high in zip(found.interior.min, found.interior.max, strict=True)]
    out.print(f"OK  {found.name}: " + " x ".join(f"{side:g}" for side in size) + f" m, {len(found.anchors)} anchors")
