"""The command `ortilo room show`: a room from above."""

from pathlib import Path
from typing import Annotated

from ortilo_drake.commands.options import picture_option
from ortilo_drake.commands.room.check import RoomArgument
from ortilo_drake.commands.terminal import out, say_written

PngOption = Annotated[Path | None, picture_option("Draw it to this file")]


def show(room: RoomArgument, png: PngOption = None) -> None:
    """Show a room from above: walls, stands, furniture, anchors, landmarks and the planned path."""
    from ortilo_drake.model.room import load_room

    found = load_room(room)
    from ortilo_drake.studies.rooms.findings import look_into
    from ortilo_drake.views.room_plan import save_plan
    from ortilo_drake.views.room_text import room_text

    looked = look_into(room)
    if png is not None:
        save_plan(found, looked.path, png)
    else:
        out.print(room_text(found, looked.path, out.width), markup=False, soft_wrap=True)
    for line in (*looked.facts, *(f"warning  {line}" for line in looked.warnings)):
        out.print(f"  {line}", markup=False, soft_wrap=True)
    say_written(png)
