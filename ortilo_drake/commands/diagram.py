"""The command `ortilo diagram`: the wiring of a scenario as text or as a picture."""

from pathlib import Path
from typing import Annotated

import typer

from ortilo_drake.commands.options import DEFAULT_SCENARIO, ScenarioArgument, SetOption
from ortilo_drake.commands.terminal import check_writable, say, say_heading, say_written
from ortilo_drake.flight.files import write_text
from ortilo_drake.scenario import load_scenario
from ortilo_drake.views.pictures import check_picture


def diagram(
    scenario: ScenarioArgument = DEFAULT_SCENARIO,
    depth: Annotated[
        int,
        typer.Option(
            min=1, max=3, help="Detail. 1: the paper's blocks; 2: boxes in the order of a tick; 3: their code and data."
        ),
    ] = 1,
    svg: Annotated[Path | None, typer.Option(help="Write an .svg image of this depth instead of text.")] = None,
    html: Annotated[Path | None, typer.Option(help="Write a page with all three depths, to zoom and pan.")] = None,
    drake: Annotated[Path | None, typer.Option(help="Write Drake's own diagram, with every System, as .svg.")] = None,
    settings: SetOption = None,
) -> None:
    """Print the wiring of a scenario: which block, or which box of the program, reads the output of which other."""
    chosen = load_scenario(scenario, tuple(settings or ()))
    for picture in (svg, drake):
        if picture:
            check_picture(picture, ("svg",))
    check_writable(svg, html, drake)
    from ortilo_drake.views.page.diagram_page import diagram_page
    from ortilo_drake.views.wiring_picture import drake_svg, wiring_picture
    from ortilo_drake.views.wiring_text import wiring_of, wiring_text

    if drake:
        write_text(drake, drake_svg(chosen))
    if svg or html or not drake:
        wiring = wiring_of(chosen)
        if svg:
            write_text(svg, wiring_picture(wiring, depth))
        if html:
            write_text(html, diagram_page(chosen.name, wiring))
        if not (svg or html or drake):
            say_heading(chosen.name, f": {len(wiring.boxes)} boxes, {1 / chosen.h:.6g} ticks a second")
            say(wiring_text(wiring, depth), end="")
    say_written(svg, html, drake)
