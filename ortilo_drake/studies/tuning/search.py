"""Settings found by flying: CMA-ES over the mean distance from the path, judged on flights that it never saw.

The cost of a flight is the root mean square of its true distance from the planned path [m], and LOST if it was lost. A
candidate's cost is the mean over its flights; all candidates fly the same seeds, so that they are compared under the
same noise (common random numbers). CMA-ES (N. Hansen, "The CMA evolution strategy: a tutorial", 2016) is pycma's; it
searches the unit cube that the ranges span. Its result was chosen among many on these seeds, so its cost there is
biased downwards: start and result are compared on other seeds, flight by flight.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final

import numpy as np
import yaml
from pydantic import Field, model_validator

from ortilo_drake.flight.intervals import share_interval
from ortilo_drake.flight.lost import NOT_LOST
from ortilo_drake.flight.players import flown_by
from ortilo_drake.flight.processes.workers import kept_workers
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario, load_scenario
from ortilo_drake.studies.maps.chunks import columns_of
from ortilo_drake.studies.maps.map_flights import figures_of_points
from ortilo_drake.studies.maps.sweep import Name, OverScenario, Range, scenario_at
from ortilo_drake.studies.paper_tables.tables import mean_interval

LOST: Final = 10.0  # cost of a lost flight [m]: no kept flight is that far from its path on average
FIRST_STEP: Final = 0.25  # first step of CMA-ES, as a share of a range [1]
FEWEST: Final = 2  # settings that CMA-ES can search


class Search(OverScenario):
    """A search file."""

    axes: Annotated[dict[Name, Range], Field(min_length=FEWEST, max_length=20)]
    """range to search for each setting. A setting of several numbers, such as servo.weights.position, is multiplied by
    a factor from its range."""
    flights: Annotated[int, Field(ge=2, le=100_000)] = 50
    """number of flights for each candidate, with seeds from `seed` on."""
    judge: Annotated[int, Field(ge=2, le=100_000)] = 400
    """number of flights that compare start and result, with the seeds after those."""
    evaluations: Annotated[int, Field(ge=1, le=100_000)] = 200
    """largest number of candidates."""
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 0
    """seed of the first flight, and of the search."""

    @model_validator(mode="after")
    def _searches_numbers(self) -> "Search":
        for key, axis in self.axes.items():
            if axis.whole:
                raise ValueError(f"axes.{key}.whole: true: must be false: only real numbers are searched")
        return self


def base_of(search: Search) -> Scenario:
    """Return the scenario without the searched settings."""
    return load_scenario(search.scenario, tuple(search.settings.items()))


def setting_in(data: Any, key: str) -> Any:
    """Return a scenario's setting by its dotted key, None if it has none."""
    for word in key.split("."):
        data = data.get(word) if isinstance(data, dict) else None
    return data


def settings_at(search: Search, values: tuple[float, ...], source: str) -> dict[str, Any]:
    """Return the settings that a candidate's values mean; InputError if one is neither a number nor several numbers."""
    data, found = base_of(search).model_dump(mode="json"), {}
    for key, value in zip(search.axes, values, strict=True):
        now = setting_in(data, key)
        several = isinstance(now, list) and len(now) > 0
        if not all(n is None or type(n) in (float, int) for n in (now if several else [now])):
            raise InputError(f"{source}: axes.{key}: is {now!r} in the scenario: must be a number, or several")
        # If the setting has no value, the scenario decides later whether it may have one.
        found[key] = [number * value for number in now] if several else value
    return found


@dataclass(frozen=True)
class Candidate:
    """Settings that were flown (none for the start), their mean cost [m], and how many of their flights were lost."""

    settings: dict[str, Any]
    cost: float
    lost: int


@dataclass(frozen=True)
class Judged:
    """Start and result on `flights` flights with other seeds; start and found are their mean costs [m].

    difference is the mean of the result's cost less the start's, flight by flight; low and high are the ends of its 95
    % bootstrap interval [m]. start_lost and found_lost are the numbers lost, with Wilson's 95 % interval of the share.
    """

    flights: int
    start: float
    found: float
    difference: float
    low: float
    high: float
    start_lost: tuple[int, float, float]
    found_lost: tuple[int, float, float]


@dataclass(frozen=True)
class Found:
    """The result of a search: its file, the start, the best candidate, and all candidates in order.

    judged compares start and best. flown_by names the players that flew.
    """

    search: Search
    start: Candidate
    best: Candidate
    history: list[Candidate]
    judged: Judged
    flown_by: str


def costs_of(figures: np.ndarray, columns: Sequence[str]) -> np.ndarray:
    """Return the cost of each flight [m] from its figures (n, columns)."""
    rms = np.sqrt(figures[:, columns.index("path_distance_mse")])
    return np.where(figures[:, columns.index("cause")] == NOT_LOST, np.minimum(rms, LOST), LOST)


def compare_costs(start: np.ndarray, found: np.ndarray) -> Judged:
    """Return the comparison of two settings by the costs of flights of the same seeds (n each)."""
    difference = found - start
    ends = mean_interval(difference) if np.ptp(difference) > 0.0 else None
    low, high = ends or (float(difference[0]), float(difference[0]))
    counts = [int(np.sum(costs >= LOST)) for costs in (start, found)]
    lost = [(count, *share_interval(count, len(start))) for count in counts]
    return Judged(len(start), float(start.mean()), float(found.mean()), float(difference.mean()), low, high, *lost)


def search_by_flights(
    search: Search,
    source: str,
    out: Path,
    workers: int,
    say: Callable[[int, float], None] = lambda flown, least: None,
    player: str = "fastest",
) -> Found:
    """Search settings by flying them; `say` gets the number of candidates and the least cost [m] so far.

    Figures of all flights are kept in the folder `out` and not flown again: a stopped search continues where it was,
    and finds the same with any number of workers and any player (players.choose). `source` begins the errors.
    InputError if a setting does not allow its range, the player cannot fly it, or a flight cannot be flown or kept.
    """
    import cma  # an extra that reading a search file does not need

    axes, own, players = list(search.axes.values()), base_of(search), set[str]()

    def values_of(place: np.ndarray) -> tuple[float, ...]:
        return tuple(axis.at(np.array([share]))[0] for axis, share in zip(axes, place, strict=True))

    def fly(scenarios: list[Scenario], first: int, flights: int) -> list[np.ndarray]:
        figures, flying = figures_of_points(scenarios, out, first, flights, workers, player)
        players.update(flying)
        return [costs_of(f, columns_of(s)) for f, s in zip(figures, scenarios, strict=True)]

    def weigh(places: list[np.ndarray]) -> list[Candidate]:
        settings = [settings_at(search, values_of(place), source) for place in places]
        flown = fly([scenario_at(search, its, source) for its in settings], search.seed, search.flights)
        return [_candidate(its, costs) for its, costs in zip(settings, flown, strict=True)]

    for corner in (np.zeros(len(axes)), np.ones(len(axes))):  # wrong ranges are refused before anything flies
        scenario_at(search, settings_at(search, values_of(corner), source), source)
    options = {"bounds": [0.0, 1.0], "seed": search.seed + 1, "verbose": -9}
    strategy = cma.CMAEvolutionStrategy(place_of(search), FIRST_STEP, options)
    history: list[Candidate] = []
    with kept_workers():
        start = _candidate({}, fly([own], search.seed, search.flights)[0])
        while len(history) < search.evaluations and not strategy.stop():
            asked = strategy.ask()
            flown = weigh(asked)
            strategy.tell(asked, [one.cost for one in flown])
            history += flown
            say(len(history), min(one.cost for one in history))
        best = min(history, key=lambda one: one.cost)
        result = scenario_at(search, best.settings, source)
        judged = compare_costs(*fly([own, result], search.seed + search.flights, search.judge))
    return Found(search, start, best, history, judged, flown_by([own], players))


def _candidate(settings: dict[str, Any], costs: np.ndarray) -> Candidate:
    return Candidate(settings, float(costs.mean()), int(np.sum(costs >= LOST)))


def place_of(search: Search) -> np.ndarray:
    """Return the scenario's own point in the unit cube (d), clipped to the ranges.

    A setting of several numbers lies at the factor 1; a setting that the scenario lacks lies in the middle.
    """
    data, shares = base_of(search).model_dump(mode="json"), []
    for key, axis in search.axes.items():
        now = setting_in(data, key)
        value = 1.0 if isinstance(now, list) else now
        low, high = axis.start, axis.stop
        if value is not None and axis.scale == "log":
            value, low, high = np.log([max(value, low), low, high])
        shares.append(0.5 if value is None else float(np.clip((value - low) / (high - low), 0.0, 1.0)))
    return np.array(shares)


SHOWN = 6  # significant digits


def _millimetres(metres: float) -> str:
    return f"{round(1000.0 * metres, 1) + 0.0:.1f} mm"  # never -0.0


def search_lines(found: Found) -> list[str]:
    """Return the result in a few lines."""
    judged, search = found.judged, found.search
    low, high = _millimetres(judged.low), _millimetres(judged.high)
    said = "no difference is shown" if judged.low <= 0.0 <= judged.high else "better" if judged.high < 0.0 else "worse"
    lines = [
        f"{len(found.history)} candidates, {search.flights} flights each: {_millimetres(found.start.cost)} -> "
        f"{_millimetres(found.best.cost)}, on the seeds that were searched on",
        f"on {judged.flights} other seeds: {_millimetres(judged.start)} -> {_millimetres(judged.found)}, "
        f"difference {_millimetres(judged.difference)} ({low} to {high}, 95 %): {said}",
    ]
    for name, (count, least, most) in (("start", judged.start_lost), ("found", judged.found_lost)):
        lines.append(f"{name}: {count} of {judged.flights} lost ({least:.2%} to {most:.2%})")
    lines.append(f"the mean over flights of the RMS distance from the path, a lost flight counting {LOST:g} m")
    return [*lines, f"flown by {found.flown_by}"]


def found_text(found: Found, base: str) -> str:
    """Return the best candidate as a scenario file over a base, with the result in a comment before it."""
    data: dict[str, object] = {"base": base}
    for key, value in (*found.search.settings.items(), *found.best.settings.items()):
        *groups, last = key.split(".")
        inner = data
        for group in groups:
            below = inner.setdefault(group, {})
            assert isinstance(below, dict)
            inner = below
        inner[last] = _rounded(value)
    return "".join(f"# {line}\n" for line in search_lines(found)) + yaml.safe_dump(data, sort_keys=False)


def _rounded(value: object) -> object:
    if isinstance(value, list):
        return [_rounded(one) for one in value]
    return float(f"{value:.{SHOWN}g}") if isinstance(value, float) else value
