"""The command `ortilo rare`: the probability of rare losses."""

import os
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from ortilo_drake.commands.options import (
    CameraOption,
    FolderOption,
    JsonOption,
    ScenarioArgument,
    SetOption,
    WorkersOption,
    with_camera,
)
from ortilo_drake.commands.terminal import check_writable, flights_to_go, hand_over, say_if_compiling, say_warnings
from ortilo_drake.model.as_data import as_data
from ortilo_drake.scenario import load_scenario, with_seed


class Origin(StrEnum):
    """What the distance is measured from."""

    reference = "reference"
    path = "path"


def rare(
    scenario: ScenarioArgument = "nominal_imu_uwb",
    corridor: Annotated[
        float | None,
        typer.Option(
            min=0.001,
            max=1000.0,
            help="Distance that counts, in m, reached at any moment; a lost flight counts too (wall, tumble)."
            " Without it only a loss counts.",
        ),
    ] = None,
    origin: Annotated[
        Origin,
        typer.Option(
            "--from",
            help="What the distance is from: the moving point of the reference, so that a late vehicle is off too; or"
            " the nearest point of the planned path.",
        ),
    ] = Origin.reference,
    paths: Annotated[int, typer.Option(min=20, help="Flights of each level, a multiple of 10.")] = 1000,
    repetitions: Annotated[
        int, typer.Option(min=2, help="Independent estimates; their spread gives the interval.")
    ] = 10,
    count: Annotated[int, typer.Option(min=0, help="Flights to count as well, as a check.")] = 0,
    least: Annotated[
        float, typer.Option(min=1e-30, max=0.1, help="Smallest probability of interest; the search stops there.")
    ] = 1e-9,
    seed: Annotated[int, typer.Option(min=0, help="Seed of all noise.")] = 0,
    camera: CameraOption = None,
    settings: SetOption = None,
    workers: WorkersOption = None,
    out_folder: FolderOption = Path("out/rare"),
    json_file: JsonOption = None,
) -> None:
    """Estimate the probability that the vehicle is lost, or strays from its reference or path, where that is rare.

    By subset simulation over the noise of all sensors, links and the disturbance in every tick, and over what the
    scenario's truth draws at the start, in the compiled engine. It stops early where nothing is found, and then
    gives an upper bound. Repetitions already in the folder are not flown again, so a killed run can be resumed.
    """
    from ortilo_drake.flight.cautions import cautions
    from ortilo_drake.studies.rare.rare_flights import Event, rare_flights
    from ortilo_drake.studies.rare.rare_report import rare_text, verdict

    flown = with_seed(load_scenario(scenario, with_camera(settings, camera, None)), seed)
    check_writable(report := out_folder / "rare.md")
    say_warnings(cautions(flown, scenario, settings or ()))
    say_if_compiling()
    event = Event(corridor, origin is Origin.path)
    workers = workers or os.cpu_count() or 1
    with flights_to_go() as advance:
        found = rare_flights(flown, event, paths, repetitions, out_folder / "kept", workers, count, advance, least)
    text = rare_text(flown, found)
    hand_over(
        text,
        report,
        {"scenario": flown.name, "verdict": verdict(flown, found), "corridor": corridor} | as_data(found),
        json_file,
    )
