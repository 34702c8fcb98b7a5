"""The command `ortilo room show`: it draws a room from above."""

from pathlib import Path
from typing import Annotated

import typer

from ortilo_drake.commands.options import picture_option
from ortilo_drake.commands.terminal import out, say, say_lines, say_written

PngOption = Annotated[Path | None, picture_option("Draw the figure to this file")]


def show(
    what: Annotated[str, typer.Argument(metavar="SCENARIO_OR_ROOM", help="A scenario, or a room's .yaml file.")],
    png: PngOption = None,
) -> None:
    """Show a room from above: walls, stands, furniture, anchors, landmarks and the planned path."""
    from ortilo_drake.studies.rooms.room_scenario import OF_A_ROOM, scenario_of

    scenario = scenario_of(what)
    room = scenario.load_room()
    from ortilo_drake.studies.rooms.findings import findings_of
    from ortilo_drake.views.room_plan import save_plan
    from ortilo_drake.views.room_text import room_text

    looked = findings_of(scenario)
    if png is not None:
        save_plan(room, looked.path, png, None if scenario.name == OF_A_ROOM else scenario.name)
    else:
        say(room_text(room, looked.path, out.width))
    say_lines((*looked.facts, *(f"warning  {line}" for line in looked.warnings)))
    say_written(png)
