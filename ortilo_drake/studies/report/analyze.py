"""The work of `ortilo analyze`: the theory of a scenario, and the flights that check it."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ortilo_drake.flight.ensemble import flights_of, fly_many
from ortilo_drake.flight.flight import AXES
from ortilo_drake.flight.players import choose, flown_by
from ortilo_drake.flight.summary import Summary
from ortilo_drake.model.as_data import as_data
from ortilo_drake.model.signals import N_X
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import LqServo, Scenario
from ortilo_drake.studies.arrivals.arrival_map import ArrivalReport, arrival_report
from ortilo_drake.studies.command_link.command_flights import (
    CommandFlights,
    command_cases,
    command_flights,
    hover_point,
    hover_V,
    learned_at,
)
from ortilo_drake.studies.command_link.command_report import CommandReport, command_report
from ortilo_drake.studies.consistency.consistency_figures import nees_figure, whiteness_figure
from ortilo_drake.studies.consistency.consistency_flights import ConsistencyReport, consistency_report
from ortilo_drake.studies.linearization.linearization_report import LinearizationReport, linearization_report
from ortilo_drake.studies.linearization.operating_point import check_sensors
from ortilo_drake.studies.loop.error_moments import in_the_rms_alone, left_out
from ortilo_drake.studies.loop.hover_loop import filter_V, hover_loop, why_no_gain, why_no_loop
from ortilo_drake.studies.loop.margins import LoopMargins, margins_report
from ortilo_drake.studies.loop.riccati_report import RiccatiReport, riccati_report
from ortilo_drake.studies.paper_tables.tables import AxisEfficiency, efficiency_of
from ortilo_drake.studies.tube.tube_map import without_blackouts
from ortilo_drake.studies.tube.tube_report import Step, TubeReport, tube_report, why_no_tube
from ortilo_drake.views.pictures import figure_file

RATES = np.linspace(0.0, 1.0, 21)  # rates of the bounds' map
LOSSES, DELAYS = (0.2, 0.5, 0.8), (1, 2, 3, 4, 5)  # losses and delays [ticks] of commands that are flown
COMMAND_SEEDS = range(4)


@dataclass(frozen=True)
class Theory:
    """The analyses that need no flight: linearisation, Riccati equations, margins, arrival rates, commands.

    The linearisation compares Drake's derivatives with closed forms. It is None for a servo or an estimator of one's
    own, which has no closed forms.
    """

    linearization: LinearizationReport | None
    riccati: RiccatiReport
    margins: dict[str, LoopMargins]
    arrivals: ArrivalReport
    commands: CommandReport


@dataclass(frozen=True)
class Honesty(ConsistencyReport):
    """The consistency of a scenario's own flights, their efficiency by axis, and the players that flew."""

    efficiency: dict[str, AxisEfficiency]
    flown_by: str


@dataclass(frozen=True)
class Analysis:
    """The theory of a scenario, which needs no flight, or why there is none; and the flights that check it.

    left_out are the world's settings that the theory lacks; in_rms_alone are those that only the rms predicted at hover
    includes; both are None without a theory. `flights` is the number of flights of the scenario, judged in honesty, and
    of each pair of arrival rates. command_flights are behind command links. honesty and command_flights are None if
    none was flown. tube is the one along the path, or no_tube says why there is none.
    """

    scenario: str
    no_theory: str | None
    theory: Theory | None
    left_out: list[str] | None
    in_rms_alone: list[str] | None
    flights: int
    command_flights: CommandFlights | None
    honesty: Honesty | None
    no_tube: str | None
    tube: TubeReport | None


def analysis_data(analysis: Analysis) -> dict[str, Any]:
    """Return an analysis as plain data for JSON: the theory's parts beside the others, and no missing parts."""
    data: dict[str, Any] = as_data(analysis)
    data |= data.pop("theory") or {}
    return {key: value for key, value in data.items() if value is not None or key.startswith("no_")}


def theory(scenario: Scenario, step: Step = lambda what, done, total: None) -> Theory:
    """Return all that needs no flight, for the filter with what its banks learn at hover (sensors/learned_survey.py).

    Only the linearisation is of the filter as it is. InputError naming the modes that the sensors leave undetected, or
    naming what else is wrong.
    """
    check_sensors(scenario)
    point = hover_point(scenario)
    told = learned_at(scenario, point)
    V, loop = hover_V(told, point), hover_loop(told)
    rates = RATES if len(loop.names) == N_X else RATES[::4]  # twice the states take eight times as long
    uwb, camera = (rates.tolist() if sensor in scenario.sensors else [0.0] for sensor in loop.measurement.positions[:2])
    step("linearization", 0, 5)
    # Drake differentiates only the paper's servo and filter.
    built_in = isinstance(scenario.servo, LqServo) and scenario.linear_filter is scenario.estimator
    linearization = linearization_report(scenario, V=hover_V(scenario, point)) if built_in else None
    step("riccati", 1, 5)
    riccati = riccati_report(told, V)
    step("margins", 2, 5)
    margins = margins_report(told, V)
    step("arrivals", 3, 5)
    arrivals = arrival_report(loop, filter_V(told, V), uwb, camera)
    step("commands", 4, 5)
    commands = command_report(told, V)
    return Theory(linearization, riccati, margins, arrivals, commands)


def honesty_section(
    scenario: Scenario, flights: int, out: Path, workers: int, step: Step, player: str = "fastest"
) -> tuple[Honesty, list[Path]]:
    """Return the consistency and efficiency of the scenario's own flights, and the files of the figures.

    `player` is as in fly_many.
    """
    done = 0

    def count(_: Summary) -> None:
        nonlocal done
        done += 1
        step("flights", done, flights)

    summaries = fly_many(scenario, range(flights), out / "flights", workers, count, player)
    flown = flights_of(scenario, range(flights), out / "flights")
    efficiency = {axis: efficiency_of(axis, summaries) for axis in AXES}
    by = flown_by([scenario], (its.player or "unknown" for its in summaries))
    report = Honesty(**vars(consistency_report(flown)), efficiency=efficiency, flown_by=by)
    name = scenario.name
    nees = nees_figure({name: flown}, figure_file(out, "nees"))
    return report, [nees, whiteness_figure({name: report}, figure_file(out, "whiteness"))]


def analyze(
    scenario: Scenario,
    flights: int,
    out: Path,
    workers: int = 1,
    step: Step = lambda what, done, total: None,
    player: str = "fastest",
) -> tuple[Analysis, list[Path]]:
    """Return the whole analysis, and the files of the figures, which are in the folder `out` beside the flights.

    `flights` flights, 0 for none, are of the scenario and of each pair of arrival rates, with seeds as in the flights'
    sections. The flights of a scenario without theory (why_no_loop) are judged too. Flights that are already there are
    not flown again. `step` gets what is being done, how much is done, and the total. `player` is as in fly_many.
    InputError as theory; if there is neither theory nor flights; or if the player cannot fly the scenario.
    """
    why = why_no_loop(scenario) or why_no_gain(hover_loop(scenario))
    if why and not flights:
        raise InputError(f"{why}; without theory, --flights must be 1 or more: flights are judged alone")
    choose(scenario, player)  # refuses before any work
    found, figures = None if why else theory(scenario, step), []
    flown = honesty = tube = None
    if flights and found:
        flown = command_flights(
            without_blackouts(scenario),
            command_cases(LOSSES, ("hold", "zero"), DELAYS),
            COMMAND_SEEDS,
            out / "flights",
            point=hover_point(scenario),
            workers=workers,
            progress=lambda case: step("command flights", 0, 1),
            player=player,
        )
    if flights:
        honesty, drawn = honesty_section(scenario, flights, out, workers, step, player)
        figures += drawn
    no_tube = why or why_no_tube(scenario)
    if no_tube is None:
        tube, drawn = tube_report(scenario, flights, out, workers, step, player)
        figures += drawn
    missing, alone = (left_out(scenario), in_the_rms_alone(scenario)) if found else (None, None)
    return Analysis(scenario.name, why, found, missing, alone, flights, flown, honesty, no_tube, tube), figures
