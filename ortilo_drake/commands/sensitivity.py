"""The command `ortilo sensitivity`: how well vehicle, room and sensors must be known."""

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
from ortilo_drake.scenario import Scenario, load_scenario
from ortilo_drake.views.pictures import figure_file


def sensitivity(
    scenario: ScenarioArgument = DEFAULT_SCENARIO,
    flights: Annotated[int, typer.Option(min=1, max=100_000, help="Flights at each value, seeds from 0.")] = 8,
    workers: WorkersOption = None,
    settings: SetOption = None,
    out_folder: FolderOption = Path("out/sensitivity"),
    json_file: JsonOption = None,
) -> None:
    """Fly a scenario in worlds that differ from what its filter believes, one mismatch at a time and all together.

    It shows errors and losses at given values, and the value at which 5 % of the flights are lost. A camera is
    projected. Flights already in the folder are kept, so an interrupted run continues where it stopped.
    """
    laid_over = tuple(settings or ())
    name = load_scenario(scenario, laid_over).name  # refuses wrong settings before anything is flown
    report, figure = out_folder / f"{name}.md", figure_file(out_folder, name)
    check_writable(report, figure)
    from ortilo_drake.flight.processes.workers import kept_workers
    from ortilo_drake.studies.sensitivity.mismatches import Settings
    from ortilo_drake.studies.sensitivity.sensitivity_flights import sensitivity as study
    from ortilo_drake.studies.sensitivity.sensitivity_report import sensitivity_figure, sensitivity_text

    say_if_compiling()

    def vary(under: Settings) -> Scenario:
        return load_scenario(scenario, (*laid_over, *under))

    count = workers or os.cpu_count() or 1
    with progress_bar() as progress, kept_workers():
        task = progress.add_task("flights", total=None)

        def say(part: str) -> None:
            progress.update(task, description=part)
            err.print(f"{part} ...", markup=False, highlight=False)

        found = study(vary, flights, out_folder / "flights", count, say, lambda n: progress.advance(task, n))
    text = sensitivity_text(found)
    sensitivity_figure(found, figure)
    hand_over(text, report, found, json_file, figure)
