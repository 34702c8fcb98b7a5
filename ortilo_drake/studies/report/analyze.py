"""The work of `ortilo analyze`: the theory of a scenario, and the flights that check it."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ortilo_drake.flight.ensemble import flights_of, fly_many
from ortilo_drake.scenario import Scenario
from ortilo_drake.studies.arrivals.arrival_report import arrival_report
from ortilo_drake.studies.command_link.command_flights import command_cases, command_flights, hover_V
from ortilo_drake.studies.command_link.command_report import command_report
from ortilo_drake.studies.consistency.consistency_figures import nees_figure, whiteness_figure
from ortilo_drake.studies.consistency.consistency_flights import consistency_report
from ortilo_drake.studies.linearization.linearization_report import linearization_report
from ortilo_drake.studies.linearization.observability import check_sensors
from ortilo_drake.studies.loop.hover_loop import hover_loop
from ortilo_drake.studies.loop.margins import margins_report
from ortilo_drake.studies.loop.riccati_report import riccati_report
from ortilo_drake.studies.paper_tables.tables import efficiency_table
from ortilo_drake.studies.tube.tube_map import without_blackouts
from ortilo_drake.studies.tube.tube_report import Step, tube_report, why_no_tube

RATES = np.linspace(0.0, 1.0, 21)  # of the bounds' map
LOSSES, DELAYS = (0.2, 0.5, 0.8), (1, 2, 3, 4, 5)  # of commands, flown
COMMAND_SEEDS = range(4)


def theory(scenario: Scenario, step: Step = lambda what, done, total: None) -> dict[str, Any]:
    """Return all that needs no flight: linearisation, Riccati equations, margins, arrival rates, commands.

    Args:
        scenario: the scenario.
        step: called with what is being done, how far and of how much.

    Raises:
        InputError: naming the modes, if the sensors leave some undetected, or naming what else is wrong.
    """
    check_sensors(scenario)
    V, loop = hover_V(scenario), hover_loop(scenario)
    uwb, camera = (RATES.tolist() if sensor in scenario.sensors else [0.0] for sensor in ("uwb", "camera"))
    parts: dict[str, Callable[[], Any]] = {
        "linearization": lambda: linearization_report(scenario, V=V),
        "riccati": lambda: riccati_report(scenario, V),
        "margins": lambda: margins_report(scenario, V),
        "arrivals": lambda: arrival_report(loop.W, V, scenario.h, uwb, camera, loop.C),
        "commands": lambda: command_report(scenario, V),
    }
    data: dict[str, Any] = {"scenario": scenario.name}
    for k, (name, part) in enumerate(parts.items()):
        step(name, k, len(parts))
        data[name] = part()
    return data


def honesty_section(
    scenario: Scenario, flights: int, out: Path, workers: int, step: Step
) -> tuple[dict[str, Any], list[Path]]:
    """Return consistency of the scenario's own flights and their efficiency, and the figures drawn."""
    done = 0

    def count(_: dict[str, Any]) -> None:
        nonlocal done
        done += 1
        step("flights", done, flights)

    summaries = fly_many(scenario, range(flights), out / "flights", workers, count)
    flown = flights_of(scenario, range(flights), out / "flights")
    report = consistency_report(flown)
    report["efficiency"] = efficiency_table([s for s in summaries if s["lost"] is None])
    names = {scenario.name: flown}
    figures = [
        nees_figure(names, out / "nees.png"),
        whiteness_figure({scenario.name: report}, out / "whiteness.png"),
    ]
    return report, figures


def analyze(
    scenario: Scenario, flights: int, out: Path, workers: int = 1, step: Step = lambda what, done, total: None
) -> tuple[dict[str, Any], list[Path]]:
    """Return the whole analysis as plain data for JSON, and the figures drawn in the folder ``out``.

    Args:
        scenario: the scenario.
        flights: of the scenario and of each pair of arrival rates, seeds as in the flights' sections; 0 flies none.
        out: folder of figures and flights; flights that are already there are not flown again.
        workers: processes that fly.
        step: called with what is being done, how far and of how much.

    Raises:
        InputError: as theory.
    """
    data, figures = theory(scenario, step), []
    data["flights"] = flights
    if flights:
        links = command_cases(LOSSES, ("hold", "zero"), DELAYS)
        data["command_flights"] = command_flights(
            without_blackouts(scenario),
            links,
            COMMAND_SEEDS,
            out / "flights",
            workers=workers,
            progress=lambda case: step("command flights", 0, 1),
        )
        data["honesty"], drawn = honesty_section(scenario, flights, out, workers, step)
        figures += drawn
    data["no_tube"] = why_no_tube(scenario)
    if data["no_tube"] is None:
        data["tube"], drawn = tube_report(scenario, flights, out, workers, step)
        figures += drawn
    return data, figures
