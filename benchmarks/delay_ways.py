"""The ways to account for late commands: the delays that each is predicted to bear, and flights behind delays."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from ortilo_drake.model.typed_yaml import validate
from ortilo_drake.scenario import Scenario
from ortilo_drake.studies.command_link.command_delay import StableDelays, stable_delays
from ortilo_drake.studies.command_link.command_flights import (
    POINT,
    CommandCase,
    command_cases,
    command_flights,
    hover_V,
)

LONGEST = 12  # ticks of delay to look at


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
        stable = stable_delays(flown, hover_V(flown, point), longest=LONGEST)
        links, folder = command_cases((), (), delays), out / f"way_{number}"
        found = command_flights(flown, links, seeds, folder, duration, point, workers)
        reports.append(WayReport(name, stable, found.cases))
        if progress:
            progress(reports[-1])
    return reports
