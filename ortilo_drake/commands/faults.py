"""The command `ortilo faults`: faults in flight, and how each estimator copes with them."""

import os
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from ortilo_drake.commands import options
from ortilo_drake.commands.terminal import bar, check_writable, hand_over, say_if_compiling
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario, load_scenario
from ortilo_drake.scenario.load import PROJECTED
from ortilo_drake.views.pictures import figure_file

DEFAULT_SCENARIOS = ("nominal_imu_uwb_yolo", "imu_uwb_yolo", "robust_imu_uwb_yolo", "tight_imu_uwb_yolo")


def faults(
    scenarios: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[SCENARIO]...",
            help=f"Ready-made scenarios' names or .yaml files; {', '.join(DEFAULT_SCENARIOS)}.",
            autocompletion=options.scenarios_from,
        ),
    ] = None,
    flights: Annotated[int, typer.Option(min=1, max=100_000, help="Flights with each fault, seeds from 0.")] = 6,
    names: Annotated[
        str | None, typer.Option("--faults", metavar="NAME,...", help="Faults of the catalogue; by default all.")
    ] = None,
    start: Annotated[
        float, typer.Option(min=0.5, max=3600.0, callback=options.finite, help="When the faults begin [s].")
    ] = 22.0,
    length: Annotated[
        float, typer.Option(min=0.5, max=3600.0, callback=options.finite, help="Duration of the faults that end [s].")
    ] = 5.0,
    workers: options.WorkersOption = None,
    player: options.PlayerOption = options.PlayerName.fastest,
    settings: options.SetOption = None,
    out_folder: options.FolderOption = Path("out/faults"),
    json_file: options.JsonOption = None,
) -> None:
    """Fly scenarios with one fault at a time, and the same seeds without any fault.

    It shows the estimate's error during and after each fault, flights lost, the time to recover and whether the filter
    stays consistent. Cameras are projected. Faults of the scenarios themselves are left out. Flights already in the
    folder are kept, so an interrupted run continues where it stopped.
    """
    from ortilo_drake.studies.faults.catalogue import chosen_names

    chosen = chosen_names(names)
    laid_over = (*(settings or ()), PROJECTED)

    def varied(scenario: str, under: tuple[tuple[str, Any], ...]) -> Scenario:
        return load_scenario(scenario, (*laid_over, *under))

    vary = [partial(varied, scenario) for scenario in scenarios or DEFAULT_SCENARIOS]
    flown = [make((("faults", []),)).name for make in vary]  # reports wrong settings before any flight
    if len(set(flown)) != len(flown):
        raise InputError(f"SCENARIO: {', '.join(flown)}: must differ by name")
    report, figure = out_folder / "faults.md", figure_file(out_folder, "faults")
    check_writable(report, figure)
    from ortilo_drake.flight.processes.workers import kept_workers
    from ortilo_drake.studies.faults.fault_flights import fault_study
    from ortilo_drake.studies.faults.fault_report import fault_figure, fault_text

    say_if_compiling()
    count = workers or os.cpu_count() or 1
    with bar("flights") as update, kept_workers():
        found = fault_study(
            vary, chosen, flights, out_folder / "flights", start, length, count, lambda n: update(advance=n), player
        )
    fault_figure(found, figure)
    hand_over(fault_text(found), report, found, json_file, figure)
