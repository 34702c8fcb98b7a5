"""The command `ortilo diagram`: the block diagram as a picture."""

from pathlib import Path
from typing import Annotated

import typer

from ortilo_drake.commands.options import DEFAULT_SCENARIO, ScenarioArgument, SetOption
from ortilo_drake.commands.terminal import check_writable, say_written
from ortilo_drake.flight.files import write_text
from ortilo_drake.scenario import load_scenario


def diagram(
    scenario: ScenarioArgument = DEFAULT_SCENARIO,
    svg: Annotated[Path | None, typer.Option(help="The image file; by default out/diagram.svg.")] = None,
    html: Annotated[Path | None, typer.Option(help="One page with three depths, to zoom and move.")] = None,
    settings: SetOption = None,
    depth: Annotated[int, typer.Option(min=0, max=4, help="How far the image opens nested diagrams.")] = 3,
) -> None:
    """Draw the closed loop's block diagram."""
    chosen = load_scenario(scenario, tuple(settings or ()))
    if svg is None and html is None:
        svg = Path("out/diagram.svg")
    check_writable(svg, html)
    from ortilo_drake.views.block_diagram import diagram_svg
    from ortilo_drake.views.page.diagram_page import diagram_page

    if svg:
        write_text(svg, diagram_svg(chosen, depth))
    if html:
        write_text(html, diagram_page(chosen))
    say_written(svg, html)
