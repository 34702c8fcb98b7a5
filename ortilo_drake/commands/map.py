"""The command `ortilo map`: thousands of flights over a scenario's settings."""

import os
from pathlib import Path
from typing import Annotated

import typer

from ortilo_drake.commands import terminal
from ortilo_drake.commands.options import FolderOption, JsonOption, PlayerName, PlayerOption, WorkersOption
from ortilo_drake.flight.files import write_text
from ortilo_drake.views.pictures import figure_file


def map_(
    sweep_file: Annotated[
        Path, typer.Argument(metavar="SWEEP.yaml", help="Axes, design and flights of the map: docs/how_to/maps.md.")
    ],
    workers: WorkersOption = None,
    player: PlayerOption = PlayerName.fastest,
    out_folder: FolderOption = Path("out/map"),
    json_file: JsonOption = None,
) -> None:
    """Fly a map: a number of flights at each point of a design over any settings.

    Figures of each flight are kept as Parquet. Flights already in the folder are not flown again, so an interrupted or
    killed run resumes where it stopped.
    """
    from ortilo_drake.sensors.uwb_theory import believed_noise
    from ortilo_drake.studies.maps.sweep import load_sweep, points_of, scenario_at

    sweep = load_sweep(sweep_file)
    doubted: list[str] = []
    for point in points_of(sweep):  # reports wrong settings before any flight
        doubted = believed_noise(scenario_at(sweep, point, str(sweep_file))) or doubted
    terminal.say_warnings(doubted)
    report, table, figure = out_folder / "map.md", out_folder / "map.csv", figure_file(out_folder, "map")
    terminal.check_writable(report, table, figure)
    from ortilo_drake.studies.maps.map_figure import map_figure
    from ortilo_drake.studies.maps.map_flights import fly_map
    from ortilo_drake.studies.maps.map_report import map_csv, map_text, theory_of

    terminal.say_if_compiling()
    count = workers or os.cpu_count() or 1
    with terminal.bar("flights", sweep.count * sweep.most_flights) as update:
        kept = out_folder / "flights"
        found = fly_map(sweep, str(sweep_file), kept, count, lambda flown: update(advance=flown), player)
    theory = theory_of(found)
    write_text(table, map_csv(found))
    drawn = map_figure(found, figure, theory)
    terminal.hand_over(map_text(found, theory), report, found, json_file, table, drawn)
