"""The command `ortilo export`: the onboard half as object code."""

from pathlib import Path
from typing import Annotated

import typer

from ortilo_drake.commands.options import DEFAULT_SCENARIO, ScenarioArgument, SetOption
from ortilo_drake.commands.terminal import say_heading, say_written
from ortilo_drake.scenario import load_scenario


def export(
    scenario: ScenarioArgument = DEFAULT_SCENARIO,
    target: Annotated[str, typer.Option(help="Processor: cortex-m7, cortex-m4, aarch64 or x86-64.")] = "cortex-m7",
    out: Annotated[Path, typer.Option(help="Folder to write.")] = Path("out/export"),
    ticks: Annotated[
        int, typer.Option(min=1, max=100_000, help="Number of ticks in the test's recorded inputs and outputs.")
    ] = 300,
    precision: Annotated[str, typer.Option(help="double, or single if the processor has no doubles.")] = "double",
    settings: SetOption = None,
) -> None:
    """Write a scenario's onboard half for a vehicle: object code, a C header, and a test with recorded ticks."""
    chosen = load_scenario(scenario, tuple(settings or ()))
    from ortilo_drake.codegen.export import export as write_export

    manifest = write_export(chosen, target, out, ticks, precision)
    say_heading(chosen.name, f" for {target}: {manifest['object_bytes']} bytes of object code")
    say_written(out)
