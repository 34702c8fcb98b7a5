"""The command `ortilo diagram`: the block diagram as a picture."""

from pathlib import Path
from typing import Annotated

import typer

from ortilo_drake.commands.options import DEFAULT_SCENARIO, ScenarioArgument, SetOption
from ortilo_drake.commands.terminal import check_writable, out
from ortilo_drake.flight.files import write_text
from ortilo_drake.scenario import load_scenario


def diagram(
    scenario: ScenarioArgument = DEFAULT_SCENARIO,
    svg: Annotated[Path, typer.Option(help="The image file.")] = Path("diagram.svg"),
    settings: SetOption = None,
    depth: Annotated[int, typer.Option(min=0, max=4, help="How far to open nested diagrams.")] = 3,
) -> None:
    """Draw the closed loop's block diagram."""
    chosen = load_scenario(scenario, tuple(settings or ()))
    check_writable(svg)
    from ortilo_drake.views.block_diagram import diagram_svg

    write_text(svg, diagram_svg(chosen, depth))
    out.print(f"wrote {svg}", markup=False, soft_wrap=True)
