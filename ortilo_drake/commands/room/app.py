"""The commands `ortilo room`, one module each."""

import typer

from ortilo_drake.commands.room.check import check
from ortilo_drake.commands.room.coverage import coverage
from ortilo_drake.commands.room.new import new
from ortilo_drake.commands.room.place import place
from ortilo_drake.commands.room.show import show
from ortilo_drake.commands.room.survey import survey
from ortilo_drake.commands.room.trace import trace

room_app = typer.Typer(no_args_is_help=True, help="Design a room of your own: make, check, show and judge it.")
for command in (new, check, show, coverage, place, survey, trace):
    room_app.command()(command)
