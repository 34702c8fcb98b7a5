"""How often a scenario's vehicle is lost, or strays from its reference, when that is rare.

Splitting is repeated, each time with noise of its own. The estimates of the repetitions are independent and without
bias, so their mean is one too, and Student's t gives its interval.
"""

import json
import logging
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from ortilo_drake.flight.compiled.engine import Engine
from ortilo_drake.flight.ensemble import flight_folder
from ortilo_drake.flight.files import write_text
from ortilo_drake.flight.processes.workers import run_all
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario
from ortilo_drake.studies.rare.splitting import Split, split

_LOG = logging.getLogger(__name__)
LEVEL = 0.95  # of the intervals
AT_ONCE = 500  # flights that are counted by one job


@dataclass(frozen=True)
class Counted:
    """Plain counting.

    Attributes:
        flights: how many flew.
        events: in how many it happened.
        low: lower end of Wilson's 95 % interval of the share [1].
        high: its upper end [1].
    """

    flights: int
    events: int
    low: float
    high: float


@dataclass(frozen=True)
class Rare:
    """How often something happens in a flight.

    Attributes:
        corridor: distance from the reference that is strayed from [m]; None where losing the vehicle is meant.
        probability: mean of the repetitions [1].
        low: lower end of its 95 % interval [1], not below 0.
        high: its upper end [1].
        repetitions: what each of them found.
        flights: how many flew in all of them.
        counted: plain counting beside it, if asked for.
    """

    corridor: float | None
    probability: float
    low: float
    high: float
    repetitions: list[Split]
    flights: int
    counted: Counted | None


@lru_cache(maxsize=1)
def _engine_of(scenario_json: str) -> Engine:
    return Engine(Scenario.model_validate_json(scenario_json))


def split_flights(scenario_json: str, corridor: float | None, paths: int, seed: int) -> Split:
    """Return one estimate. Runs in a worker: the arguments are plain data."""
    engine, goal = _engine_of(scenario_json), np.inf if corridor is None else corridor
    return split(lambda seeds: danger(*engine.distances(seeds), goal), engine.ticks, goal, paths, seed)


def danger(distances: np.ndarray, errors: np.ndarray, goal: float) -> np.ndarray:
    """Return how near each tick is to the event: at least the goal where it happens, and nowhere else.

    The servo holds the estimate at the reference, so an error of the estimate is where the vehicle is led to before it
    is there: the larger of distance and error counts, drawn together below the goal where it does not happen yet.

    Args:
        distances: from the reference [m].
        errors: of the estimate [m].
        goal: distance that is the event [m]; infinity for a loss, where distances are infinite.
    """
    larger = np.maximum(distances, errors)
    if goal == np.inf:
        return np.where(np.isfinite(distances), np.minimum(larger, np.finfo(float).max), np.inf)
    below = np.minimum(goal * (1.0 - goal / (goal + larger)), np.nextafter(goal, 0.0))
    return np.where(distances >= goal, distances, below)


def count_flights(scenario_json: str, corridor: float | None, seeds: range) -> int:
    """Return in how many flights it happens. Runs in a worker: the arguments are plain data."""
    engine = _engine_of(scenario_json)
    distances, _ = engine.distances(np.repeat(np.array(seeds)[:, np.newaxis], engine.ticks, axis=1))
    return int(np.sum(distances.max(axis=1) >= (np.inf if corridor is None else corridor)))


def rare_flights(
    scenario: Scenario,
    corridor: float | None,
    paths: int,
    repetitions: int,
    out: Path,
    workers: int,
    count: int = 0,
    progress: Callable[[int], None] = lambda done: None,
) -> Rare:
    """Return how often the vehicle is lost or strays; what has been found is kept and not flown again.

    Args:
        scenario: whose seed is that of the first repetition.
        corridor: distance from the reference [m]; None for losing the vehicle.
        paths: flights that splitting keeps going at a time.
        repetitions: of splitting, at least 2.
        out: folder in which each repetition is kept.
        workers: worker processes; 1 flies in this one.
        count: flights to be counted beside it, seeds from 0 on.
        progress: called with how many repetitions or batches of counted flights have come in.

    Raises:
        InputError: if the scenario has a part that is not compiled, or what is found cannot be kept.
    """
    _engine_of(text := scenario.model_dump_json())  # refuses before anything is kept
    event = "lost" if corridor is None else f"corridor_{corridor:g}"
    folder = flight_folder(out, scenario)
    seeds = range(scenario.seed, scenario.seed + repetitions)
    files = [folder / f"{event}_{paths}_paths_seed_{seed}.json" for seed in seeds]
    batches = [range(at, min(at + AT_ONCE, count)) for at in range(0, count, AT_ONCE)]
    count_files = [folder / f"{event}_counted_{b.start:08d}_{b.stop - 1:08d}.json" for b in batches]
    wanted = [(split_flights, (text, corridor, paths, seed)) for seed in seeds]
    counts = [(count_flights, (text, corridor, batch)) for batch in batches]
    _run(wanted, files, workers, progress)
    _run(counts, count_files, workers, progress)
    found = [Split(**_read(file)["split"]) for file in files]
    p = np.array([one.probability for one in found])
    half = float(stats.t.ppf(0.5 + LEVEL / 2.0, len(p) - 1) * p.std(ddof=1) / np.sqrt(len(p)))
    mean, counted = float(p.mean()), None
    if count:
        events = sum(_read(file)["events"] for file in count_files)
        share = stats.binomtest(events, count).proportion_ci(LEVEL, method="wilson")
        counted = Counted(count, events, float(share.low), float(share.high))
    return Rare(corridor, mean, max(mean - half, 0.0), mean + half, found, sum(one.paths for one in found), counted)


def _run(jobs: list[tuple[Any, Any]], files: list[Path], workers: int, progress: Callable[[int], None]) -> None:
    """Do those jobs, all of one function, whose result is not kept yet, and keep it."""
    missing = [i for i, file in enumerate(files) if _kept(file) is None]
    progress(len(files) - len(missing))

    def take(number: int, result: Split | int) -> None:
        kept = {"split": asdict(result)} if isinstance(result, Split) else {"events": result}
        write_text(files[missing[number]], json.dumps(kept))
        progress(1)

    if missing:
        run_all(jobs[0][0], [jobs[i][1] for i in missing], workers, take)


def _kept(file: Path) -> dict[str, Any] | None:
    """Return what a file keeps; None where it is not there, and a warning where it is damaged."""
    if not file.exists():
        return None
    try:
        found: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
        if "split" in found:
            Split(**found["split"])
        elif not isinstance(found["events"], int):
            raise TypeError("events: is no number")
    except (OSError, ValueError, TypeError, KeyError) as error:
        _LOG.warning("%s: flown again: %s", file, error)
        return None
    return found


def _read(file: Path) -> dict[str, Any]:
    found = _kept(file)
    if found is None:
        raise InputError(f"{file}: was there, and is gone or damaged now; run it again")
    return found
