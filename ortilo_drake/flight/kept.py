"""A few figures of each flight, kept in a file for each scenario; resumable.

A flight takes megabytes and its whole summary, with its Cramer-Rao floor, 50 times as long as what a study looks at.
"""

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from types import GenericAlias
from typing import Any, Final, TypeVar

from ortilo_drake.diagrams.wiring.whole import why_not
from ortilo_drake.flight.ensemble import flight_folder
from ortilo_drake.flight.processes.workers import run_all
from ortilo_drake.flight.store import keep_json, kept_json
from ortilo_drake.scenario import Scenario

AT_ONCE: Final = 2  # flights in one job of a worker, so that none waits long for the other's last
T = TypeVar("T")


def kept_file(out: Path, scenario: Scenario) -> Path:
    """Return the file that keeps the figures of a scenario's flights; it is named like their folder."""
    folder = flight_folder(out, scenario)
    return folder.with_name(f"{folder.name}.kept")


def fly_kept(
    kind: type[T],
    fly: Callable[[str, list[int], str], list[T]],
    wanted: Sequence[tuple[Scenario, Iterable[int]]],
    out: Path,
    workers: int = 1,
    progress: Callable[[int], None] | None = None,
    at_once: int = AT_ONCE,
) -> list[list[T]]:
    """Fly scenarios, each once for each of its seeds, and return the figures of each in the order of the seeds.

    All flights go to the workers together. Flights of which it is already there are not flown again, so an interrupted
    run goes on where it stopped. What is kept of a flight is a dataclass with its seed, `kind`. `fly` is importable and
    returns, of a scenario's JSON, seeds and a folder's name, what is kept of these flights. The scenarios are wanted
    with their seeds; a scenario's own is not used. One worker flies in this process. `progress` is called with the
    number of flights that came in. A worker's job has `at_once` flights where the engine flies all of them; Drake's are
    AT_ONCE. InputError if a flight cannot be flown or what is kept cannot be written.
    """
    at_once = at_once if all(why_not(scenario) is None for scenario, _ in wanted) else AT_ONCE
    asked = [(scenario, list(seeds), kept_file(out, scenario)) for scenario, seeds in wanted]
    rows = GenericAlias(list, (kind,))
    found = {file: {its.seed: its for its in kept_json(file, rows, file.name) or ()} for _, _, file in asked}
    jobs: list[tuple[str, list[int], str]] = []
    files: list[Path] = []  # of each job
    for scenario, seeds, file in asked:
        missing = [seed for seed in seeds if seed not in found[file]]
        if progress and len(missing) < len(seeds):
            progress(len(seeds) - len(missing))
        text = scenario.model_dump_json()
        jobs += [(text, missing[k : k + at_once], file.name) for k in range(0, len(missing), at_once)]
        files += [file] * (len(jobs) - len(files))

    def take(number: int, flown: list[Any]) -> None:
        file = files[number]
        known = found[file]
        known.update({its.seed: its for its in flown})
        keep_json(file, [known[seed] for seed in sorted(known)], file.name)
        if progress:
            progress(len(flown))

    run_all(fly, jobs, workers, take)
    return [[found[file][seed] for seed in seeds] for _, seeds, file in asked]
