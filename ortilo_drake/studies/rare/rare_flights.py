"""How often a scenario's vehicle is lost, or strays from its reference, when that is rare.

Subset simulation chooses its levels once and is then repeated, each time with noise of its own. The estimates of the
repetitions are independent and without bias, so their mean is one too, and Student's t gives its interval.
"""

import json
import logging
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import lru_cache, partial
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
from ortilo_drake.studies.rare.subset import CHAIN, Climb, Paths, Plan, climb, plan_climb

_LOG = logging.getLogger(__name__)
LEVEL = 0.95  # of the intervals
AT_ONCE = 500  # flights that are counted by one job
_IN_MEMORY = 100  # flights whose distances are held at a time


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
        plan: levels [m] and steps, as the first climb chose them.
        repetitions: what each of those after it found.
        flights: how many flew in all of them, the first among them.
        drawn: how many normal numbers decide what is drawn at the start.
        counted: plain counting beside it, if asked for.
    """

    corridor: float | None
    probability: float
    low: float
    high: float
    plan: Plan
    repetitions: list[Climb]
    flights: int
    drawn: int
    counted: Counted | None


@lru_cache(maxsize=1)
def _engine_of(scenario_json: str) -> Engine:
    return Engine(Scenario.model_validate_json(scenario_json))


def _farthest(engine: Engine, paths: Paths) -> np.ndarray:
    """Return the largest distance from the reference of each flight [m], infinity if it is lost (n)."""
    parts = (
        paths.at(np.arange(i, min(i + _IN_MEMORY, len(paths.seeds)))) for i in range(0, len(paths.seeds), _IN_MEMORY)
    )
    return np.concatenate([engine.distances(*part).max(axis=1) for part in parts])


def _goal(corridor: float | None) -> float:
    return np.inf if corridor is None else corridor


def plan_flights(scenario_json: str, corridor: float | None, paths: int, seed: int) -> Plan:
    """Return levels and steps. Runs in a worker: the arguments are plain data."""
    engine = _engine_of(scenario_json)
    drawn = sum(engine.drawn.values())
    return plan_climb(partial(_farthest, engine), engine.ticks, drawn, _goal(corridor), paths, seed)


def climb_flights(scenario_json: str, corridor: float | None, plan: Plan, paths: int, seed: int) -> Climb:
    """Return one estimate. Runs in a worker: the arguments are plain data."""
    engine = _engine_of(scenario_json)
    drawn = sum(engine.drawn.values())
    return climb(partial(_farthest, engine), engine.ticks, drawn, _goal(corridor), plan, paths, seed)


def count_flights(scenario_json: str, corridor: float | None, seeds: range) -> int:
    """Return in how many flights it happens. Runs in a worker: the arguments are plain data."""
    engine = _engine_of(scenario_json)
    of_ticks = np.repeat(np.array(seeds)[:, np.newaxis], engine.ticks, axis=1)
    return int(np.sum(engine.distances(of_ticks).max(axis=1) >= _goal(corridor)))


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
        paths: flights of a level, a multiple of CHAIN.
        repetitions: with noise of their own, at least 2.
        out: folder in which each repetition is kept.
        workers: worker processes; 1 flies in this one.
        count: flights to be counted beside it, seeds from 0 on.
        progress: called with how many repetitions, the first climb among them, or batches of counted flights came in.

    Raises:
        InputError: if the scenario has a part that is not compiled, or what is found cannot be kept.
    """
    if paths % CHAIN:
        raise InputError(f"paths: {paths}: must be a multiple of {CHAIN}")
    engine = _engine_of(text := scenario.model_dump_json())  # refuses before anything is kept
    event = "lost" if corridor is None else f"corridor_{corridor:g}"
    folder = flight_folder(out, scenario)
    seeds = range(scenario.seed, scenario.seed + repetitions)
    plan_file = folder / f"{event}_{paths}_paths_plan_{scenario.seed}.json"
    _run([(plan_flights, (text, corridor, paths, scenario.seed))], [plan_file], workers, progress)
    plan: Plan = _read(plan_file)
    files = [folder / f"{event}_{paths}_paths_plan_{scenario.seed}_seed_{seed}.json" for seed in seeds]
    _run([(climb_flights, (text, corridor, plan, paths, seed)) for seed in seeds], files, workers, progress)
    batches = [range(at, min(at + AT_ONCE, count)) for at in range(0, count, AT_ONCE)]
    count_files = [folder / f"{event}_counted_{b.start:08d}_{b.stop - 1:08d}.json" for b in batches]
    _run([(count_flights, (text, corridor, batch)) for batch in batches], count_files, workers, progress)
    found: list[Climb] = [_read(file) for file in files]
    p = np.array([one.probability for one in found])
    half = float(stats.t.ppf(0.5 + LEVEL / 2.0, len(p) - 1) * p.std(ddof=1) / np.sqrt(len(p)))
    mean, counted = float(p.mean()), None
    if count:
        events = sum(_read(file) for file in count_files)
        share = stats.binomtest(events, count).proportion_ci(LEVEL, method="wilson")
        counted = Counted(count, events, float(share.low), float(share.high))
    flights, drawn = plan.flights + sum(one.flights for one in found), sum(engine.drawn.values())
    return Rare(corridor, mean, max(mean - half, 0.0), mean + half, plan, found, flights, drawn, counted)


def _run(jobs: list[tuple[Any, Any]], files: list[Path], workers: int, progress: Callable[[int], None]) -> None:
    """Do those jobs, all of one function, whose result is not kept yet, and keep it."""
    missing = [i for i, file in enumerate(files) if _kept(file) is None]
    progress(len(files) - len(missing))

    def take(number: int, result: Plan | Climb | int) -> None:
        kept = {"events": result} if isinstance(result, int) else {type(result).__name__.lower(): asdict(result)}
        write_text(files[missing[number]], json.dumps(kept))
        progress(1)

    if missing:
        run_all(jobs[0][0], [jobs[i][1] for i in missing], workers, take)


def _kept(file: Path) -> Any:
    """Return what a file keeps; None where it is not there, and a warning where it is damaged."""
    if not file.exists():
        return None
    try:
        ((kind, found),) = json.loads(file.read_text(encoding="utf-8")).items()
        if kind == "events" and isinstance(found, int):
            return found
        fields = {name: tuple(value) if isinstance(value, list) else value for name, value in found.items()}
        return {"plan": Plan, "climb": Climb}[kind](**fields)
    except (OSError, ValueError, TypeError, KeyError, AttributeError) as error:
        _LOG.warning("%s: flown again: %s", file, error)
        return None


def _read(file: Path) -> Any:
    found = _kept(file)
    if found is None:
        raise InputError(f"{file}: was there, and is gone or damaged now; run it again")
    return found
