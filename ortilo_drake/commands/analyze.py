"""The command `ortilo analyze`: the theory of a scenario, checked by flights."""

import os
from pathlib import Path
from typing import Annotated

import typer

from ortilo_drake.commands.options import (
    DEFAULT_SCENARIO,
    FolderOption,
    JsonOption,
    ScenarioArgument,
    SetOption,
    WorkersOption,
)
from ortilo_drake.commands.terminal import check_writable, err, hand_over, progress_bar, say_if_compiling
from ortilo_drake.scenario import load_scenario


def analyze(
    scenario: ScenarioArgument = DEFAULT_SCENARIO,
    flights: Annotated[
        int, typer.Option(min=0, max=10_000, help="Flights of the scenario, and of each pair of arrival rates.")
    ] = 20,
    workers: WorkersOption = None,
    settings: SetOption = None,
    out_folder: FolderOption = Path("out/analysis"),
    json_file: JsonOption = None,
) -> None:
    """Linearise a scenario and check its Riccati equations, margins, arrival rates, delays, tube and consistency.

    The camera is the projected one here: rendering hundreds of flights takes hours. Flights that are already in the
    folder are kept, so an interrupted run continues where it stopped; --flights 0 flies none.
    """
    chosen = load_scenario(scenario, tuple(settings or ()))
    report = out_folder / f"{chosen.name}.md"
    check_writable(report)
    from ortilo_drake.flight.processes.workers import kept_workers
    from ortilo_drake.studies.report.analysis_text import analysis_text
    from ortilo_drake.studies.report.analyze import analysis_data
    from ortilo_drake.studies.report.analyze import analyze as analyze_scenario

    say_if_compiling()
    if chosen.is_rendered:
        err.print("the camera is projected here, not rendered")
        chosen = chosen.projected()
    with progress_bar() as progress, kept_workers():
        task = progress.add_task("theory", total=None)
        begun: list[str] = []

        def step(what: str, done: int, total: int) -> None:
            if what not in begun:
                begun.append(what)
                err.print(f"{what} ...", highlight=False)
            progress.update(task, description=what, completed=done, total=total)

        analysis, figures = analyze_scenario(chosen, flights, out_folder, workers or os.cpu_count() or 1, step)
    text = analysis_text(analysis)
    hand_over(text, report, analysis_data(analysis), json_file, *figures)
