"""The commands `ortilo room`: rooms of your own, from a first file to a map of where they lose a vehicle."""

import typer

from ortilo_drake.commands.room.check import check
from ortilo_drake.commands.room.place import place
from ortilo_drake.commands.room.survey import survey

room_app = typer.Typer(no_args_is_help=True, help="Design a room of your own: make, check, show and judge it.")
for command in (check, place, survey):
    room_app.command()(command)


@room_app.callback()
def _group() -> None:
    """Keep the commands' names, also where there is only one."""
