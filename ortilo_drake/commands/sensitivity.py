"""The command `ortilo sensitivity`: how well vehicle, room and sensors must be known."""

import os
from pathlib import Path
from typing import Annotated

import typer

from ortilo_drake.commands import options
from ortilo_drake.commands.terminal import bar, check_writable, hand_over, say_error, say_if_compiling
from ortilo_drake.scenario import Scenario, load_scenario
from ortilo_drake.views.pictures import figure_file


def sensitivity(
    scenario: options.ScenarioArgument = options.DEFAULT_SCENARIO,
    flights: Annotated[int, typer.Option(min=1, max=100_000, help="Flights at each value, seeds from 0.")] = 8,
    workers: options.WorkersOption = None,
    player: options.PlayerOption = options.PlayerName.fastest,
    settings: options.SetOption = None,
    out_folder: options.FolderOption = Path("out/sensitivity"),
    json_file: options.JsonOption = None,
) -> None:
    """Fly a scenario in worlds that differ from what its filter believes, by one mismatch at a time, then all.

    It shows errors and losses at given values, and the value at which 5 % of the flights are lost. A camera is
    projected. Flights already in the folder are kept, so an interrupted run continues where it stopped.
    """
    laid_over = tuple(settings or ())
    name = load_scenario(scenario, laid_over).name  # reports wrong settings before any flight
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
    with bar("flights") as update, kept_workers():

        def say(part: str) -> None:
            update(description=part)
            say_error(f"{part} ...")

        found = study(vary, flights, out_folder / "flights", count, say, lambda n: update(advance=n), player)
    sensitivity_figure(found, figure)
    hand_over(sensitivity_text(found), report, found, json_file, figure)
