"""The command `ortilo tables`: the paper's tables next to ours."""

import os
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from ortilo_drake.commands import options
from ortilo_drake.commands.terminal import check_writable, hand_over, progress_bar, say_if_compiling
from ortilo_drake.views.pictures import figure_file


class Preset(StrEnum):
    """The filter of the flights, and the velocities that the servo gets."""

    tuned = "tuned"
    nominal = "nominal"
    paper = "paper"
    printed = "printed"


def tables(
    flights: Annotated[int, typer.Option(min=1, max=100_000, help="Flights of each scenario, seeds from 0.")] = 20,
    workers: options.WorkersOption = None,
    preset: Annotated[
        Preset,
        typer.Option(
            metavar="PRESET",
            help="tuned: our filter; nominal: the paper's, tuned by us; paper: as in its code; printed: in its text.",
        ),
    ] = Preset.tuned,
    settings: options.SetOption = None,
    camera: options.CameraOption = None,
    detector: options.DetectorOption = None,
    onnx: options.OnnxOption = None,
    player: options.PlayerOption = options.PlayerName.fastest,
    beside: Annotated[
        list[str] | None,
        typer.Option(
            metavar="SCENARIO",
            help="A further scenario for the same tables; may be repeated.",
            autocompletion=options.scenarios_from,
        ),
    ] = None,
    only: Annotated[
        str | None, typer.Option(metavar="SCENARIO", help="Fly only one of the paper's: imu_uwb or imu_uwb_yolo.")
    ] = None,
    out_folder: options.FolderOption = Path("out/tables"),
    json_file: options.JsonOption = None,
) -> None:
    """Fly the paper's two scenarios, or one, many times, and compare its tables I and II with ours.

    --beside adds further scenarios, such as altimeter and flow, to the tables. Flights already in the folder
    are kept, so an interrupted run continues where it stopped.
    """
    from ortilo_drake.studies.paper_tables.flown_tables import fly_tables, scenarios_of_tables
    from ortilo_drake.studies.paper_tables.report import table_text
    from ortilo_drake.studies.paper_tables.tables import make_tables

    of_cameras = options.with_camera(None, camera, detector, onnx)  # kept apart: flights without a camera stay the same
    chosen = scenarios_of_tables(preset.value, settings or (), of_cameras, beside or (), only)
    check_writable(out_folder / f"tables_{preset.value}.md")
    say_if_compiling()
    from ortilo_drake.diagrams.closed_loop import make_closed_loop
    from ortilo_drake.flight.ensemble import flight_file
    from ortilo_drake.flight.players import choose
    from ortilo_drake.flight.saved_flight import load_flight
    from ortilo_drake.studies.paper_tables.error_figure import error_figure
    from ortilo_drake.views.figures import DRAWN, arrival_figure, trajectory_figure

    for flown in chosen.values():
        choose(flown, player)
        make_closed_loop(flown)  # reports a wrong detector or a missing renderer before any flight
    count = workers or os.cpu_count() or 1
    with progress_bar() as progress:
        tasks = {name: progress.add_task(flown.name, total=flights) for name, flown in chosen.items()}
        summaries = fly_tables(
            chosen, flights, out_folder / "flights", count, lambda name: progress.advance(tasks[name]), player
        )
    result = make_tables(preset.value, summaries)
    text = table_text(result)
    first = {
        name: [load_flight(flight_file(out_folder / "flights", flown, seed))[DRAWN] for seed in range(min(flights, 20))]
        for name, flown in chosen.items()
    }
    written = [
        trajectory_figure(first, figure_file(out_folder, f"trajectories_{preset.value}")),
        error_figure(summaries, figure_file(out_folder, f"errors_{preset.value}")),
        arrival_figure({n: rows[0] for n, rows in first.items()}, figure_file(out_folder, f"arrivals_{preset.value}")),
    ]
    hand_over(text, out_folder / f"tables_{preset.value}.md", result, json_file, *written)
