"""The report on the tube over arrival rates and bursts, and on the flights that check it, for `ortilo analyze`."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ortilo_drake.flight.players import flown_by
from ortilo_drake.onboard.estimator.filter_model import filter_of
from ortilo_drake.scenario import Scenario
from ortilo_drake.sensors.described import unwired
from ortilo_drake.studies.tube.tube import nominal_flight
from ortilo_drake.studies.tube.tube_figures import ChanceGrid, bursts_figure, plan_figure, rates_figure
from ortilo_drake.studies.tube.tube_flights import (
    BURSTS,
    PAIRS,
    Flown,
    Point,
    PointResult,
    at_burst,
    fly_point,
    judge_point,
)
from ortilo_drake.studies.tube.tube_map import (
    burst_cases,
    burst_map,
    chance_map,
    map_sensors,
    rate_cases,
    tube_map,
    with_rates,
    without_blackouts,
)
from ortilo_drake.views.pictures import figure_file

RATES = np.geomspace(0.003, 1.0, 21)
BURST_RATES = np.linspace(0.1, 1.0, 17)
BURST_LENGTHS = np.geomspace(0.1, 10.0, 17)  # [s]
# The mixture's boundary, from fewer points: each needs the arrivals of many seeds; with few, the tails are too long.
CHANCE_RATES = np.geomspace(0.01, 1.0, 7)
CHANCE_BURST_RATES = np.linspace(0.2, 0.95, 6)
CHANCE_BURSTS = np.geomspace(0.3, 10.0, 7)  # [s]
ARRIVALS = range(2001, 2101)  # seeds of these arrivals
SHOWN = ((0.1, 0.1), (0.02, 0.3))  # pairs drawn in the room

Step = Callable[[str, int, int], None]


def why_no_tube(scenario: Scenario) -> str | None:
    """Return why a scenario's tube has no maps, None if it has maps."""
    if filter_of(scenario).force != "none":
        return "the filter estimates more than the vehicle's states, and the tube is that of the paper's filter"
    if len(unwired(scenario.sensors)) < 2:
        return "its maps are over the arrival rates of two sensors beside the imu, and both must fly"
    if scenario.lends_velocities:
        return "the servo is given the true velocities, and the tube is that of a servo fed by the filter"
    if any(scenario.world.drag):
        return "the tube is that of a vehicle without drag, and world.drag is not 0"
    links = [scenario.link_of(sensor) for sensor in scenario.sensors]
    return "delays are drawn at random" if any(link.random_delay for link in links) else None


@dataclass(frozen=True)
class TubeReport:
    """The tube's margins over rates and bursts, and the points by 'rates' and 'bursts' whose flights check the tube.

    rates: the rates of the two sensors by name, and 'margin', the least margin over them [m] (first, second). bursts:
    'rate' of both links, mean burst 'burst_s' [s], and 'margin', the least margin over them [m], NaN without a chain.
    flown_by names the players that flew, empty if there was no flight.
    """

    rates: dict[str, np.ndarray]
    bursts: dict[str, np.ndarray]
    flights: dict[str, list[PointResult]]
    flown_by: str


def tube_report(
    scenario: Scenario, flights: int, out: Path, workers: int, step: Step, player: str = "fastest"
) -> tuple[TubeReport, list[Path]]:
    """Return the tube's margins over rates and bursts with the comparison of flights, and the figures drawn.

    The scenario has two sensors beside the imu; its own blackouts and losses are left out. `flights` of each point are
    flown, 0 for none, in the folder flights within `out`, the figures' folder. `step` is called with the name of the
    work, the number of steps done and their total. `player` is as in fly_many.
    """
    calm = without_blackouts(scenario)
    nominal, sensors = nominal_flight(calm), map_sensors(calm)
    step("tube over rates", 0, 4)
    rates = tube_map(calm, RATES, RATES)
    step("tube over bursts", 1, 4)
    bursts = burst_map(calm, BURST_RATES, BURST_LENGTHS)
    step("tails over rates", 2, 4)
    cases = rate_cases(calm, CHANCE_RATES, CHANCE_RATES)
    rates_chance = ChanceGrid(CHANCE_RATES, CHANCE_RATES, chance_map(calm, cases, ARRIVALS))
    step("tails over bursts", 3, 4)
    cases = burst_cases(calm, CHANCE_BURST_RATES, CHANCE_BURSTS)
    bursts_chance = ChanceGrid(CHANCE_BURST_RATES, CHANCE_BURSTS, chance_map(calm, cases, ARRIVALS))

    shown: dict[Point, Sequence[Flown]] = {}
    players = set[str]()
    results: dict[str, list[PointResult]] = {"rates": [], "bursts": []}
    points = [("rates", p) for p in PAIRS] + [("bursts", p) for p in BURSTS]
    for k, (kind, point) in enumerate(points if flights else []):
        step("tube flights", k, len(points))
        lossy = with_rates(calm, *point) if kind == "rates" else at_burst(calm, point)
        flown = fly_point(lossy, range(1, flights + 1), out / "flights", workers, player)
        players.update(one.player for one in flown)
        results[kind].append(judge_point(lossy, point, flown, nominal))
        if kind == "rates" and point in SHOWN:
            shown[point] = flown
    figures = [
        rates_figure(sensors, rates, rates_chance, results["rates"], figure_file(out, "tube_rates")),
        bursts_figure(sensors, bursts, bursts_chance, results["bursts"], figure_file(out, "tube_bursts")),
    ]
    if shown:
        figures.append(plan_figure(calm, nominal, shown, figure_file(out, "tube_plan")))
    maps = (
        dict.fromkeys(sensors, RATES) | {"margin": rates.whole},
        {"rate": BURST_RATES, "burst_s": BURST_LENGTHS, "margin": bursts.whole},
    )
    return TubeReport(*maps, results, flown_by([calm], players)), figures
