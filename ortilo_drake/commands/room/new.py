"""The command `ortilo room new`: it writes a first file for a room of your own."""

import re
from pathlib import Path
from typing import Annotated

import typer

from ortilo_drake.commands.terminal import check_writable, say, say_written
from ortilo_drake.model.input_files import exists
from ortilo_drake.model.typed_yaml import InputError

ForceOption = Annotated[bool, typer.Option("--force", help="Overwrite an existing file.")]
AnchorsOption = Annotated[int, typer.Option(help="Number of UWB anchors.")]


def new(
    file: Annotated[Path, typer.Argument(metavar="ROOM", help="The .yaml file to write.")],
    size: Annotated[str, typer.Option(metavar="LxWxH", help="Length, width and height [m].")] = "8x6x3",
    anchors: AnchorsOption = 5,
    force: ForceOption = False,
) -> None:
    """Write the file of a new room, with anchors, landmarks, a start and a goal, for you to edit."""
    check_new(file, force)
    from ortilo_drake.flight.files import write_text
    from ortilo_drake.studies.rooms.new_room import new_room, parse_size

    write_text(file, new_room(room_name(file), parse_size(size), anchors))
    say_next(file)


def check_new(file: Path, force: bool) -> None:
    """Raise InputError, naming the file, if it cannot be written, or exists and `force` is false."""
    if exists(file) and not force:
        raise InputError(f"{file}: exists; --force overwrites it")
    check_writable(file)


def room_name(file: Path) -> str:
    """Return the name of a room from the name of its file."""
    return re.sub(r"[^\w .+-]", "_", file.stem)[:64].lstrip(" .+-") or "room"


def say_next(file: Path) -> None:
    """Print that a room was written, and the next commands to use."""
    say_written(file)
    say("  next: edit it, then")
    show = f"room show {file} --png out/room.png"
    for words in (f"room check {file}", show, f"fly imu_uwb --set room={file} {OPEN}"):
        say(f"    ortilo {words}")


OPEN = "--set uwb.link.blackouts=[]"  # the ready-made scenarios have the authors' UWB blackouts
