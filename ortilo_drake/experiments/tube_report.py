"""The tube of a scenario over arrival rates and bursts, and the flights that check it, for `ortilo analyze`."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ortilo_drake.analysis.course import course_of
from ortilo_drake.analysis.tube_map import burst_cases, burst_map, chance_map, rate_cases, tube_map, without_blackouts
from ortilo_drake.experiments.tube_figures import ChanceGrid, bursts_figure, plan_figure, rates_figure
from ortilo_drake.experiments.tube_flights import (
    BURSTS,
    PAIRS,
    Flown,
    Point,
    PointResult,
    at_burst,
    at_rates,
    fly_point,
    judge_point,
)
from ortilo_drake.scenario import Scenario

RATES = np.geomspace(0.003, 1.0, 21)
BURST_RATES = np.linspace(0.1, 1.0, 17)
BURST_LENGTHS = np.geomspace(0.1, 10.0, 17)  # [s]
COARSE = slice(None, None, 2)  # the mixture's boundary is drawn from every other point
ARRIVALS = range(10)  # seeds of the arrivals that the mixture is over
SHOWN = ((0.3, 0.3), (0.02, 0.02))  # pairs drawn in the room

Step = Callable[[str, int, int], None]


def has_both(scenario: Scenario) -> bool:
    """Return whether both position sensors fly, over whose rates the maps are."""
    return {"uwb", "camera"} <= set(scenario.sensors)


def plain(values: np.ndarray) -> list[Any]:
    """Return an array as lists for JSON, None where it is not finite."""
    kept = values.astype(object)
    kept[~np.isfinite(values)] = None
    return list(kept.tolist())


def tube_report(
    scenario: Scenario, flights: int, out: Path, workers: int, step: Step
) -> tuple[dict[str, Any], list[Path]]:
    """Return the tube's margins over rates and bursts and how flights compare with it, and the figures drawn.

    The scenario's own blackouts and losses are left out.

    Args:
        scenario: the scenario, with uwb and camera.
        flights: of each point that is flown; 0 flies none.
        out: folder of figures, and of flights in its folder flights.
        workers: processes that fly.
        step: called with what is being done, how far and of how much.
    """
    calm = without_blackouts(scenario)
    course = course_of(calm)
    step("tube maps", 0, 4)
    rates = tube_map(calm, RATES, RATES)
    step("tube maps", 1, 4)
    bursts = burst_map(calm, BURST_RATES, BURST_LENGTHS)
    step("tube maps", 2, 4)
    a, b, c = RATES[COARSE], BURST_RATES[COARSE], BURST_LENGTHS[COARSE]
    rates_chance = ChanceGrid(a, a, chance_map(calm, rate_cases(calm, a, a), ARRIVALS))
    step("tube maps", 3, 4)
    bursts_chance = ChanceGrid(b, c, chance_map(calm, burst_cases(calm, b, c), ARRIVALS))

    shown: dict[Point, Sequence[Flown]] = {}
    results: dict[str, list[PointResult]] = {"rates": [], "bursts": []}
    points = [("rates", at_rates, p) for p in PAIRS] + [("bursts", at_burst, p) for p in BURSTS]
    for k, (kind, lossy_at, point) in enumerate(points if flights else []):
        step("tube flights", k, len(points))
        lossy = lossy_at(calm, point)
        flown = fly_point(lossy, range(1, flights + 1), out / "flights", workers)
        results[kind].append(judge_point(lossy, point, flown, course))
        if kind == "rates" and point in SHOWN:
            shown[point] = flown
    figures = [
        rates_figure(rates, rates_chance, results["rates"], out / "tube_rates.png"),
        bursts_figure(bursts, bursts_chance, results["bursts"], out / "tube_bursts.png"),
    ]
    if shown:
        figures.append(plan_figure(calm, course, shown, out / "tube_plan.png"))
    data = {
        "rates": {"uwb": RATES.tolist(), "camera": RATES.tolist(), "margin": plain(rates.whole)},
        "bursts": {"rate": BURST_RATES.tolist(), "burst_s": BURST_LENGTHS.tolist(), "margin": plain(bursts.whole)},
        "flights": {kind: [r._asdict() | {"breakdown": r.breakdown} for r in found] for kind, found in results.items()},
    }
    return data, figures
