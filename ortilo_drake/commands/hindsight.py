"""The command `ortilo hindsight`: the best estimate of a flight or a log that all its measurements allow."""

import os
from pathlib import Path
from typing import Annotated

import typer

from ortilo_drake.commands import options, terminal
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import load_scenario

_FLIGHTS = 4


def hindsight(
    flown: Annotated[
        str,
        typer.Argument(
            metavar="[SCENARIO|LOG]",
            help="A ready-made scenario's name, a .yaml file, or the log of a flight.",
            autocompletion=options.scenarios_from,
        ),
    ] = "tight_imu_uwb",
    flights: Annotated[
        int | None,
        typer.Option(min=1, max=100_000, help=f"Flights of the scenario, seeds from 0; by default {_FLIGHTS}."),
    ] = None,
    camera: options.CameraOption = None,
    workers: options.WorkersOption = None,
    settings: options.SetOption = None,
    json_file: options.JsonOption = None,
) -> None:
    """Estimate flights again from all their measurements, before and after each moment.

    It compares the filter that flew, the smoother of a linear filter, the batch factor graph of ranges, boxes and imu
    (needs the extra `smoother`), and the Cramer-Rao floor of a filter.
    """
    log, laid_over = Path(flown), options.with_camera(settings, camera, None)
    is_log = log.is_dir() or log.suffix == ".mcap"
    if is_log and (laid_over or flights is not None or workers is not None):
        raise InputError(f"{log}: is a log: --flights, --camera, --workers and --set are for scenarios")
    scenario = None if is_log else load_scenario(flown, laid_over)  # reports wrong settings before any flight
    from ortilo_drake.studies.hindsight.hindsight import fly_in_hindsight, hindsight_text, in_hindsight, study_of
    from ortilo_drake.studies.hindsight.recorded_flight import read_recorded

    terminal.say_if_compiling()
    if scenario is None:
        recorded = read_recorded(log)
        found = study_of(recorded.scenario, [in_hindsight(recorded)])
    else:
        count = flights or _FLIGHTS
        with terminal.bar("flights", count) as update:
            its = workers or os.cpu_count() or 1
            found = fly_in_hindsight(scenario, range(count), its, lambda n: update(advance=n))
    terminal.write_json(json_file, found)
    terminal.show_markdown(hindsight_text(found))
    terminal.say_written(json_file)
