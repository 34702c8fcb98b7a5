"""The ways to account for late commands: the delays that each is predicted to bear, and flights behind delays."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ortilo_drake.model.typed_yaml import InputError, validate
from ortilo_drake.scenario import Scenario
from ortilo_drake.studies.command_link.command_flights import (
    POINT,
    CommandCase,
    command_cases,
    command_flights,
    hover_V,
)
from ortilo_drake.studies.command_link.command_loop import last_stable, loop_at_once
from ortilo_drake.studies.command_link.command_report import growth_with

LONGEST = 12  # ticks of delay to look at


@dataclass(frozen=True)
class StableDelays:
    """The least and the greatest delay [ticks] with which a loop is stable; None if with the longest looked at."""

    low: float
    high: float | None


def stable_delays(scenario: Scenario, V: np.ndarray, longest: int = LONGEST) -> StableDelays:
    """Return the delays with which a loop is stable, from the one that it assumes downwards and upwards.

    Without commands.delay that is no delay. Between whole ticks it is looked at each quarter. The scenario's own
    command link is not used; V is the covariance of the measurements (p x p).

    Raises:
        InputError: if it is unstable with the delay that it assumes.
    """
    loop = loop_at_once(scenario, V)
    start = (scenario.commands.delay or 0.0) / scenario.h

    def is_stable(delay: float) -> bool:
        return growth_with(loop, scenario, delay) < 1.0

    if not is_stable(start):
        raise InputError(f"command_link: unstable with the assumed delay, {start:g} ticks")
    low, high = start, start
    while low > 0.0 and is_stable(max(low - 0.25, 0.0)):
        low = max(low - 0.25, 0.0)
    if low > 0.0:
        low = last_stable(is_stable, low, max(low - 0.25, 0.0), 1e-4)
    while high < longest and is_stable(high + 0.25):
        high += 0.25
    return StableDelays(low, last_stable(is_stable, high, high + 0.25, 1e-4) if high < longest else None)


@dataclass(frozen=True)
class WayReport:
    """A way to account for late commands.

    Attributes:
        way: its name.
        stable: the delays with which the loop at hover is stable, predicted.
        cases: hovering behind delays, predicted and flown.
    """

    way: str
    stable: StableDelays
    cases: list[CommandCase]


def ways(delay: float) -> dict[str, dict[str, object]]:
    """Return settings of `commands` by name; delay [s] is the one that the precomputed gain assumes."""
    acted: dict[str, object] = {"filter": "acted"}
    return {
        "as sent": {},
        "predicted, measured": acted | {"servo": "predicted"},
        f"predicted, {1e3 * delay:.0f} ms": acted | {"servo": "predicted", "delay": delay},
        f"augmented, {1e3 * delay:.0f} ms": acted | {"servo": "augmented", "delay": delay},
    }


def with_way(scenario: Scenario, way: dict[str, object]) -> Scenario:
    """Return a scenario with such commands and a filter that replays; InputError if they cannot be."""
    data = scenario.model_dump(mode="json")
    data["commands"] = way
    data["estimator"]["delay"] = "replay"
    return validate(Scenario, data, scenario.name)


def delay_ways(
    scenario: Scenario,
    delay: float,
    delays: Sequence[int],
    seeds: Iterable[int],
    out: Path,
    duration: float = 20.0,
    point: tuple[float, float, float] = POINT,
    workers: int = 1,
    progress: Callable[[WayReport], None] | None = None,
) -> list[WayReport]:
    """Hover behind each delay in each way, on the same seeds, and return flown beside predicted.

    Args:
        scenario: the scenario; its planner, command link, `commands` and estimator.delay are replaced.
        delay: see ways [s].
        delays: of the commands [ticks].
        seeds: of the flights behind each.
        out: folder for the flights.
        duration: of the hovering that counts [s].
        point: where to hover.
        workers: processes.
        progress: called with each way as it is done.
    """
    seeds, reports = list(seeds), []
    for number, (name, settings) in enumerate(ways(delay).items()):
        flown = with_way(scenario, settings)
        stable = stable_delays(flown, hover_V(flown, point))
        links, folder = command_cases((), (), delays), out / f"way_{number}"
        found = command_flights(flown, links, seeds, folder, duration, point, workers)
        reports.append(WayReport(name, stable, found.cases))
        if progress:
            progress(reports[-1])
    return reports
