"""The probability that a scenario's vehicle is lost, or strays from its reference, where that is rare.

Subset simulation chooses its levels once and is then repeated, each time with noise of its own. The estimates of the
repetitions are independent and without bias, so their mean has no bias either. The event is also counted in all flights
with independent noise, and the answer combines both.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
from pydantic import Field

from ortilo_drake.flight.engine import Engine
from ortilo_drake.flight.ensemble import flight_folder
from ortilo_drake.flight.processes.workers import run_all
from ortilo_drake.flight.store import in_folder, keep_json, kept_json
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario
from ortilo_drake.studies.rare.estimate import Counted, Joined, counted_of, estimate
from ortilo_drake.studies.rare.subset import CHAIN, LEAST, Climb, Plan, climb, flights_of, plan_climb

AT_ONCE = 500  # flights counted by one job
TRIED = 3  # repetitions that fly first; the others fly only if one of these reaches the event


@dataclass(frozen=True)
class Event:
    """An event in a flight: the vehicle is lost, or its distance from its path or reference reaches the corridor [m].

    A loss always counts; without a corridor only a loss counts. With from_path, the distance is from the nearest point
    of the path, the reference's points at all times. Otherwise it is from the reference of the same moment, so that a
    late vehicle is off too.
    """

    corridor: float | None
    from_path: bool = False

    @property
    def goal(self) -> float:
        """The distance at which the event happens; infinity stands for a loss [m]."""
        return np.inf if self.corridor is None else self.corridor

    @property
    def origin(self) -> str:
        """The origin of the distance, as reports name it."""
        return "path" if self.from_path else "reference"

    @property
    def file(self) -> str:
        """The first part of the file names of kept results."""
        what = "lost" if self.corridor is None else f"corridor_{self.corridor:g}"
        return f"{what}_from_path" if self.from_path else what


def doubted_corridor(scenario: Scenario, event: Event) -> list[str]:
    """Return a line of doubt about a corridor so wide that a vehicle in the room's middle would meet a wall before."""
    interior = scenario.load_room().interior
    sides = sorted(high - low for low, high in zip(interior.min, interior.max, strict=True))
    if event.corridor is None or event.corridor <= sides[1] / 2.0:
        return []
    room = " by ".join(f"{side:.2g} m" for side in reversed(sides))
    return [
        f"--corridor: {event.corridor:g} m: in cm? The room is {room}: a vehicle so far off has met a wall before,"
        " unless it flew along the longest side"
    ]


@dataclass(frozen=True)
class Rare:
    """The probability of a rare event in a flight, and the evidence for it."""

    event: Event
    """the event."""
    probability: float | None
    """probability of the event in a flight [1]; None if only the count of `independent` gives it."""
    low: float
    """lower end of the probability's 95 % interval [1]."""
    high: float
    """upper end of this interval [1]."""
    joined: Joined | None
    """separate results of the repetitions and of the count; None if only a count gives the probability."""
    least: float
    """smallest probability that was sought [1]."""
    plan: Plan
    """levels [m] and steps chosen by the first climb."""
    repetitions: list[Climb]
    """results of the later climbs; empty if the first climb never reached the event."""
    flights: int
    """number of flights in all climbs, including the first."""
    paths: int
    """number of flights of each level."""
    drawn: dict[str, int]
    """count of the normal numbers that decide each draw at the start, by the draw's name."""
    independent: Counted
    """plain count over all flights that belong to no chain: the first flights of each climb, and `counted`."""
    counted: Counted | None
    """plain count over additional flights, None if none was asked for."""


class _Job(NamedTuple):
    """A job: its arguments, the file of its result, the result's type, and the largest number of its flights."""

    arguments: tuple[Any, ...]
    file: Path
    kind: Any
    most: int


@lru_cache(maxsize=1)
def _engine_of(scenario_json: str) -> Engine:
    return Engine(Scenario.model_validate_json(scenario_json))


def _farthest(engine: Engine, event: Event, numbers: np.ndarray) -> np.ndarray:
    """Return the largest distance of each flight [m] (n), infinity if the flight is lost."""
    return engine.distances_given(numbers, event.from_path).max(axis=1)


def climb_flights(scenario_json: str, event: Event, plan: Plan, paths: int, seed: int, repetition: int) -> Climb:
    """Return one estimate. Runs in a worker process: the arguments are plain data."""
    engine = _engine_of(scenario_json)
    return climb(partial(_farthest, engine, event), engine.numbers, event.goal, plan, paths, seed, repetition)


def count_flights(scenario_json: str, event: Event, seeds: range) -> int:
    """Return the number of flights with the event. Runs in a worker process: the arguments are plain data."""
    engine = _engine_of(scenario_json)
    of_ticks = np.repeat(np.array(seeds)[:, np.newaxis], engine.ticks, axis=1)
    return int(np.sum(engine.distances(of_ticks, event.from_path).max(axis=1) >= event.goal))


def rare_flights(
    scenario: Scenario,
    event: Event,
    paths: int,
    repetitions: int,
    out: Path,
    workers: int,
    count: int = 0,
    progress: Callable[[int, int | None], None] = lambda done, total: None,
    least: float = LEAST,
) -> Rare:
    """Return the probability that an event happens in a flight.

    If the climb that chooses the levels never reaches the event, nothing is repeated. If none of the first TRIED
    repetitions reaches it, no more fly. A count then bounds the probability. Finished repetitions are kept in `out`,
    and not flown again; one worker flies in this process. paths: flights of each level, a multiple of CHAIN;
    repetitions: at least 2, each with noise from the scenario's seed and its own number; count: flights counted in
    addition, with seeds from 0 on; progress: called with the flights done and the largest number of flights, None until
    levels are chosen and it is decided whether more than TRIED repetitions fly; least: smallest probability sought [1].
    InputError if the scenario has a part that is not compiled, or if a result cannot be written.
    """
    if paths % CHAIN:
        raise InputError(f"paths: {paths}: must be a multiple of {CHAIN}")
    engine = _engine_of(text := scenario.model_dump_json())  # refuses before anything is kept
    folder, size = flight_folder(out, scenario), engine.numbers
    plan_file = folder / f"{event.file}_{paths}_paths_to_{least:g}_plan_{scenario.seed}.json"
    plan: Plan | None = kept_json(plan_file, Plan, in_folder(plan_file))
    if plan is None:

        def planned(flights: int) -> None:
            progress(flights, None)

        plan = plan_climb(partial(_farthest, engine, event), size, event.goal, paths, scenario.seed, least, planned)
        keep_json(plan_file, plan, in_folder(plan_file))
    numbers = range(repetitions if plan.reached else 0)
    each = flights_of(len(plan.levels), paths)
    done, total, decided = plan.flights, plan.flights + each * len(numbers) + count, len(numbers) <= TRIED

    def advance(flights: int, planned: int) -> None:
        """Count flights done; a climb that reaches no event ends early, with fewer flights than planned."""
        nonlocal done, total
        done, total = done + flights, total + flights - planned
        progress(done, total if decided else None)

    advance(0, 0)
    files = [plan_file.with_stem(f"{plan_file.stem}_repetition_{i}") for i in numbers]
    climbs = [_Job((text, event, plan, paths, scenario.seed, i), file, Climb, each) for i, file in enumerate(files)]
    found: list[Climb] = _run(climb_flights, climbs[:TRIED], workers, advance)
    more = climbs[TRIED:] if any(one.probability for one in found) else []
    total, decided = total - each * (len(climbs[TRIED:]) - len(more)), True
    advance(0, 0)
    found += _run(climb_flights, more, workers, advance)
    batches = [range(at, min(at + AT_ONCE, count)) for at in range(0, count, AT_ONCE)]
    counting = [
        _Job(
            (text, event, batch),
            folder / f"{event.file}_counted_{batch.start:08d}_{batch.stop - 1:08d}.json",
            Annotated[int, Field(ge=0, le=len(batch))],
            len(batch),
        )
        for batch in batches
    ]
    counts: list[int] = _run(count_flights, counting, workers, advance)
    counted = counted_of(count, sum(counts)) if count else None
    met = plan.met + sum(one.met for one in found) + sum(counts)
    independent = counted_of(paths * (1 + len(found)) + count, met)
    answer = estimate(plan, found, paths, independent, count, sum(counts))
    return Rare(
        event,
        **vars(answer),
        least=least,
        plan=plan,
        repetitions=found,
        flights=plan.flights + sum(one.flights for one in found),
        paths=paths,
        drawn={name: n for name, n in engine.drawn.items() if n},
        independent=independent,
        counted=counted,
    )


def _run(function: Any, jobs: list[_Job], workers: int, advance: Callable[[int, int], None]) -> list[Any]:
    """Run the jobs without a kept result, keep their results, and return all; tell the flights flown and planned."""
    results = [kept_json(job.file, job.kind, in_folder(job.file)) for job in jobs]
    missing = [i for i, result in enumerate(results) if result is None]

    def tell(job: _Job, result: Climb | int) -> None:
        advance(result.flights if isinstance(result, Climb) else job.most, job.most)

    for job, result in zip(jobs, results, strict=True):
        if result is not None:
            tell(job, result)

    def take(number: int, result: Climb | int) -> None:
        job = jobs[missing[number]]
        keep_json(job.file, result, in_folder(job.file))
        results[missing[number]] = result
        tell(job, result)

    if missing:
        run_all(function, [jobs[i].arguments for i in missing], workers, take)
    return results
