"""The command `ortilo rare`: the probability of rare losses."""

import os
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from ortilo_drake.commands import options
from ortilo_drake.commands.terminal import check_writable, flights_to_go, hand_over, say_if_compiling, say_warnings
from ortilo_drake.model.as_data import as_data
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario, load_scenario, with_seed


class Origin(StrEnum):
    """The point from which the distance is measured."""

    reference = "reference"
    path = "path"


def rare(
    scenario: options.ScenarioArgument = "nominal_imu_uwb",
    corridor: Annotated[
        float | None,
        typer.Option(
            min=0.001,
            max=1000.0,
            help="Count a flight whose distance reaches this value [m] at any moment; a lost flight always counts."
            " Without it only a loss counts.",
        ),
    ] = None,
    origin: Annotated[
        Origin,
        typer.Option(
            "--from",
            help="Measure the distance from the moving point of the reference, so that being late counts too, or from"
            " the nearest point of the planned path.",
        ),
    ] = Origin.reference,
    fault: Annotated[
        list[str] | None,
        typer.Option(
            "--fault",
            metavar="FAULT",
            help="Compare flights without and with this fault: '{kind: gust, start: 5.0, ...}' in YAML, a name that"
            " `ortilo faults --faults` takes, or `own` for the scenario's. May be repeated: a row for each.",
        ),
    ] = None,
    paths: Annotated[int, typer.Option(min=20, help="Flights of each level, a multiple of 10.")] = 1000,
    repetitions: Annotated[
        int, typer.Option(min=2, help="Independent estimates; their spread gives the interval.")
    ] = 10,
    count: Annotated[
        int, typer.Option(min=0, help="Additional flights, in which the event is counted; the answer combines both.")
    ] = 0,
    least: Annotated[
        float, typer.Option(min=1e-30, max=0.1, help="Smallest probability of interest; the search stops there.")
    ] = 1e-9,
    seed: Annotated[int, typer.Option(min=0, help="Seed of all noise.")] = 0,
    camera: options.CameraOption = None,
    settings: options.SetOption = None,
    workers: options.WorkersOption = None,
    player: options.PlayerOption = options.PlayerName.fastest,
    out_folder: Annotated[
        Path, typer.Option("--out", help="Folder of the report, and of the repetitions that are kept.")
    ] = Path("out/rare"),
    json_file: options.JsonOption = None,
) -> None:
    """Estimate the small probability that the vehicle is lost, or strays from its reference or path.

    It uses subset simulation over the noise of sensors, links and disturbance in every tick, and over what the
    scenario's truth draws at the start, in the compiled engine. If it finds nothing it stops early and
    gives an upper bound. Repetitions already in the folder are not flown again, so a killed run can be resumed.
    """
    from ortilo_drake.flight.processes.workers import kept_workers
    from ortilo_drake.studies.cautions.cautions import cautions
    from ortilo_drake.studies.rare.rare_flights import Event, Rare, doubted_corridor, rare_flights
    from ortilo_drake.studies.rare.rare_report import rare_text, verdict
    from ortilo_drake.studies.rare.under_faults import (
        check_in_flight,
        faults_of,
        faults_text,
        faults_verdict,
        times_as_often,
    )

    if player not in ("fastest", "engine"):
        raise InputError(f"--player: {player}: must be fastest or engine, the only player that takes given noise")
    laid_over = options.with_camera(settings, camera, None)
    own = with_seed(load_scenario(scenario, laid_over), seed)
    cases = faults_of(fault, own) if fault else {}

    def under_fault(name: str, faults: list[Any]) -> Scenario:
        try:
            its = with_seed(load_scenario(scenario, (*laid_over, ("faults", faults))), seed)
        except InputError as wrong:
            raise InputError(f"--fault {name}: {wrong}") from None
        check_in_flight(its, name)
        return its

    flown = (
        {name: under_fault(name, faults) for name, faults in {"no fault": [], **cases}.items()} if cases else {"": own}
    )
    check_writable(report := out_folder / "rare.md")
    event = Event(corridor, origin is Origin.path)
    say_warnings(cautions(own, scenario, settings or ()) + doubted_corridor(own, event))
    say_if_compiling()
    workers = workers or os.cpu_count() or 1
    found: dict[str, Rare] = {}
    kept = out_folder / "kept"
    with kept_workers():
        for name, its in flown.items():
            with flights_to_go(f"flights with {name}" if name else "flights") as advance:
                found[name] = rare_flights(its, event, paths, repetitions, kept, workers, count, advance, least)
    without, *_ = found.values()
    under = {name: found[name] for name in cases}
    line = faults_verdict(own, without, under) if cases else verdict(own, without)
    text = faults_text(own, without, under) if cases else rare_text(own, without)
    rows = [
        {"fault": name, "times_as_often": as_data(times_as_often(its, without))} | as_data(its)
        for name, its in under.items()
    ]
    data = {"scenario": own.name, "verdict": line, "corridor": corridor, "flown_by": "engine"} | as_data(without)
    hand_over(f"{text}\nFlown by engine.\n", report, data | ({"under_faults": rows} if cases else {}), json_file)
