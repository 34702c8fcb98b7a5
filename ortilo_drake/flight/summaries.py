"""Many flights of which only the summaries are kept: a study flies thousands, and a flight takes megabytes."""

import json
import logging
from collections.abc import Callable, Iterable
from dataclasses import asdict
from pathlib import Path

from ortilo_drake.flight.ensemble import flight_folder, simulator_of
from ortilo_drake.flight.files import write_text
from ortilo_drake.flight.metrics import summary
from ortilo_drake.flight.summary import Summary, read_summary
from ortilo_drake.flight.workers import run_all
from ortilo_drake.model.input_files import read_text
from ortilo_drake.scenario import Scenario

_LOG = logging.getLogger(__name__)
AT_ONCE = 10  # flights in one job of a worker


def summaries_file(out: Path, scenario: Scenario) -> Path:
    """Return the file of a scenario's summaries, one line of JSON each; named as its flights' folder would be."""
    folder = flight_folder(out, scenario)
    return folder.with_name(f"{folder.name}.jsonl")


def fly_summaries_of(scenario_json: str, seeds: list[int], folder: str) -> list[Summary]:
    """Fly some seeds and return their summaries. Runs in a worker: the arguments are plain data."""
    simulator = simulator_of(scenario_json, folder)
    return [summary(simulator.fly(seed)) for seed in seeds]


def fly_summaries(
    scenario: Scenario,
    seeds: Iterable[int],
    out: Path,
    workers: int = 1,
    progress: Callable[[int], None] | None = None,
) -> list[Summary]:
    """Fly a scenario once for each seed and return the summaries in the order of the seeds.

    Flights whose summaries are already there are not flown again, so an interrupted run goes on where it stopped.

    Args:
        scenario: the scenario; its own seed is not used.
        seeds: the seeds.
        out: folder for the summaries.
        workers: worker processes; 1 flies in this process.
        progress: called with the number of flights that came in.

    Raises:
        InputError: if a flight cannot be flown or the summaries cannot be written.
    """
    seeds, file = list(seeds), summaries_file(out, scenario)
    found = _read(file)
    missing = [seed for seed in seeds if seed not in found]
    if progress:
        progress(len(seeds) - len(missing))
    text = scenario.model_dump_json()
    jobs = [(text, missing[k : k + AT_ONCE], file.name) for k in range(0, len(missing), AT_ONCE)]

    def take(_: int, summaries: list[Summary]) -> None:
        found.update({s.seed: s for s in summaries})
        write_text(file, "".join(json.dumps(asdict(found[seed])) + "\n" for seed in sorted(found)))
        if progress:
            progress(len(summaries))

    run_all(fly_summaries_of, jobs, workers, take)
    return [found[seed] for seed in seeds]


def _read(file: Path) -> dict[int, Summary]:
    """Return the summaries of a file by seed; none, and a warning, if it is damaged."""
    if not file.exists():
        return {}
    try:
        summaries = [read_summary(line) for line in read_text(file).splitlines()]
    except ValueError as error:  # InputError is one
        _LOG.warning("%s: flown again: %s", file, " ".join(str(error).split())[:200])
        return {}
    return {s.seed: s for s in summaries}
