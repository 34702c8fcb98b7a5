"""The command `ortilo analyze`: the theory of a scenario, checked against flights."""

import os
from pathlib import Path
from typing import Annotated

import typer

from ortilo_drake.commands import options
from ortilo_drake.commands.terminal import bar, check_writable, err, hand_over, say_if_compiling
from ortilo_drake.scenario import load_scenario


def analyze(
    scenario: options.ScenarioArgument = options.DEFAULT_SCENARIO,
    flights: Annotated[
        int, typer.Option(min=0, max=10_000, help="Flights of the scenario, and of each pair of arrival rates.")
    ] = 20,
    workers: options.WorkersOption = None,
    player: options.PlayerOption = options.PlayerName.fastest,
    settings: options.SetOption = None,
    out_folder: options.FolderOption = Path("out/analysis"),
    json_file: options.JsonOption = None,
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
    with bar("theory") as update, kept_workers():
        begun: list[str] = []

        def step(what: str, done: int, total: int) -> None:
            if what not in begun:
                begun.append(what)
                err.print(f"{what} ...", highlight=False)
            update(description=what, completed=done, total=total)

        count = workers or os.cpu_count() or 1
        analysis, figures = analyze_scenario(chosen, flights, out_folder, count, step, player)
    hand_over(analysis_text(analysis), report, analysis_data(analysis), json_file, *figures)
