"""Flights of which only losses and the filter's errors are kept: a study flies hundreds, and a flight takes megabytes.

A flight's whole summary, with its Cramer-Rao floor, takes 50 times as long, a fifth of a quick flight.
"""

import json
import logging
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

import numpy as np
import xarray as xr
from pydantic import TypeAdapter

from ortilo_drake.flight.ensemble import flight_folder, simulator_of
from ortilo_drake.flight.files import write_text
from ortilo_drake.flight.metrics import estimation_mse, loss_of, position_nees
from ortilo_drake.flight.workers import run_all
from ortilo_drake.model.input_files import read_text
from ortilo_drake.scenario import Scenario

_LOG = logging.getLogger(__name__)
AT_ONCE: Final = 2  # flights in one job of a worker, so that none waits long for the other's last


@dataclass(frozen=True)
class Outcome:
    """What a study of mismatches keeps of a flight.

    Attributes:
        seed: of all noise.
        lost: whether it was lost.
        mse: mean squared error of the estimate per axis [m^2], see metrics.estimation_mse; up to a loss.
        nees: mean of metrics.position_nees, 3 if the filter is consistent; up to a loss.
    """

    seed: int
    lost: bool
    mse: dict[str, float]
    nees: float


_OUTCOME: Final = TypeAdapter(Outcome)


def outcome(flight: xr.Dataset) -> Outcome:
    """Return what is kept of a flight."""
    whole = np.isfinite(flight["truth"].values).all(axis=1) & np.isfinite(flight["estimate"].values).all(axis=1)
    if not whole.all():
        flight = flight.isel(tick=whole)  # all but the end of a flight that diverged
    nees = float(np.mean(position_nees(flight)))
    return Outcome(int(flight.attrs["seed"]), loss_of(flight) is not None, estimation_mse(flight), nees)


def outcomes_file(out: Path, scenario: Scenario) -> Path:
    """Return the file of a scenario's outcomes, one line of JSON each; named as its flights' folder would be."""
    folder = flight_folder(out, scenario)
    return folder.with_name(f"{folder.name}.jsonl")


def fly_outcomes_of(scenario_json: str, seeds: list[int], folder: str) -> list[Outcome]:
    """Fly some seeds and return their outcomes. Runs in a worker: the arguments are plain data."""
    simulator = simulator_of(scenario_json, folder)
    return [outcome(simulator.fly(seed)) for seed in seeds]


def fly_outcomes(
    wanted: Sequence[tuple[Scenario, Iterable[int]]],
    out: Path,
    workers: int = 1,
    progress: Callable[[int], None] | None = None,
) -> list[list[Outcome]]:
    """Fly scenarios, each once for each of its seeds, and return their outcomes in the order of the seeds.

    All flights go to the workers together. Flights whose outcomes are already there are not flown again, so an
    interrupted run goes on where it stopped.

    Args:
        wanted: scenarios with their seeds; a scenario's own seed is not used.
        out: folder for the outcomes.
        workers: worker processes; 1 flies in this process.
        progress: called with the number of flights that came in.

    Raises:
        InputError: if a flight cannot be flown or the outcomes cannot be written.
    """
    asked = [(scenario, list(seeds), outcomes_file(out, scenario)) for scenario, seeds in wanted]
    found = {file: _read(file) for _, _, file in asked}
    jobs: list[tuple[str, list[int], str]] = []
    files: list[Path] = []  # of each job
    for scenario, seeds, file in asked:
        missing = [seed for seed in seeds if seed not in found[file]]
        if progress and len(missing) < len(seeds):
            progress(len(seeds) - len(missing))
        text = scenario.model_dump_json()
        jobs += [(text, missing[k : k + AT_ONCE], file.name) for k in range(0, len(missing), AT_ONCE)]
        files += [file] * (len(jobs) - len(files))

    def take(number: int, outcomes: list[Outcome]) -> None:
        file = files[number]
        known = found[file]
        known.update({flown.seed: flown for flown in outcomes})
        write_text(file, "".join(json.dumps(asdict(known[seed])) + "\n" for seed in sorted(known)))
        if progress:
            progress(len(outcomes))

    run_all(fly_outcomes_of, jobs, workers, take)
    return [[found[file][seed] for seed in seeds] for _, seeds, file in asked]


def _read(file: Path) -> dict[int, Outcome]:
    """Return the outcomes of a file by seed; none, and a warning, if it is damaged."""
    if not file.exists():
        return {}
    try:
        outcomes = [_OUTCOME.validate_python(json.loads(line)) for line in read_text(file).splitlines()]
    except ValueError as error:  # InputError is one
        _LOG.warning("%s: flown again: %s", file, " ".join(str(error).split())[:200])
        return {}
    return {flown.seed: flown for flown in outcomes}
