"""Flights behind a lossy or late command link, compared with the theory's prediction."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr
from scipy.linalg import block_diag

from ortilo_drake.flight.ensemble import flights_of, fly_many
from ortilo_drake.flight.metrics import loss_of as end_of
from ortilo_drake.flight.metrics import reference_distance
from ortilo_drake.flight.players import flown_by
from ortilo_drake.model.signals import N_X
from ortilo_drake.model.typed_yaml import InputError, validate
from ortilo_drake.onboard.planner.planned import path_of
from ortilo_drake.scenario import CommandLink, HoverPlanner, Scenario
from ortilo_drake.scenario.loss_chain import loss_of
from ortilo_drake.sensors.described import as_learned
from ortilo_drake.studies.command_link.command_loop import commanded_loop
from ortilo_drake.studies.command_link.command_report import lossy_loop
from ortilo_drake.studies.loop.error_moments import error_inputs, position_moments
from ortilo_drake.studies.loop.fix_covariance import fix_noise
from ortilo_drake.studies.loop.hover_loop import why_no_loop
from ortilo_drake.theory.jump_linear.jump_linear import MARGIN, JumpLinear, mean_square_radius, steady_second_moment

POINT = (8.0, 1.0, 1.5)  # in the authors' room, out of their blackouts and far from walls
PLACES = 41  # places of the path that are tried in another room
WARM_UP = 10.0  # a flight starts without error; from here on it counts as steady [s]


@dataclass(frozen=True)
class CommandCase:
    """A link, predicted and flown; growth is the second moment's per tick, and the link is stable if it is below 1.

    predicted_rms is the predicted rms distance from r [m], None if not stable; it includes the world's errors as behind
    a perfect link, see loop/error_moments.py. `lost` of the flights were lost, after a mean time lost_after [s].
    flown_rms is over the flights that were not lost, None if all were. agrees says whether a stable link lost no
    flight, or an unstable one all. A flight may survive behind an unstable link, so agrees may be False.
    """

    link: CommandLink
    growth: float
    stable: bool
    predicted_rms: float | None
    flights: int
    lost: int
    lost_after: float | None
    causes: list[str]
    flown_rms: float | None
    agrees: bool


@dataclass(frozen=True)
class CommandFlights:
    """Hovering behind command links: the conditions, the cases, how many cases agree, and the players that flew."""

    scenario: str
    point: tuple[float, float, float]
    duration: float
    warm_up: float
    seeds: list[int]
    cases: list[CommandCase]
    agree: int
    flown_by: str


def hovering(p_WB: tuple[float, float, float]) -> np.ndarray:
    """Return x (12) of a vehicle that hovers at a point."""
    return np.append(p_WB, np.zeros(N_X - 3))


def hover_V(scenario: Scenario, p_WB: tuple[float, float, float] = POINT) -> np.ndarray:
    """Return the covariance V (p x p) of the measurements that the filter assumes when hovering at a point.

    InputError if a sensor that flies would give no measurement there.
    """
    V, there = fix_noise(scenario, hovering(p_WB))
    silent = [s for s in scenario.sensors if not there[s]]
    if silent:
        raise InputError(f"point: {p_WB}: no measurement of {', '.join(silent)} there")
    return np.asarray(block_diag(*V.values()))


def hover_point(scenario: Scenario) -> tuple[float, float, float]:
    """Return the place to hover at: POINT, or if the vehicle cannot be there, a place of the scenario's path.

    That place is the one nearest the middle of the path's duration at which every sensor that flies gives a
    measurement. InputError if there is none, or if the scenario has no linear loop.
    """
    if why := why_no_loop(scenario):
        raise InputError(why)

    def why_not(p_WB: tuple[float, float, float]) -> InputError | None:
        hover = HoverPlanner(kind="hover", point=p_WB, duration=1.0)
        try:
            path_of(scenario.model_copy(update={"planner": hover}))
            hover_V(scenario, p_WB)
        except InputError as error:
            return error
        return None

    if (error := why_not(POINT)) is None:
        return POINT
    path = path_of(scenario)
    times = np.linspace(path.start_time(), path.end_time(), PLACES)
    for i in sorted(range(PLACES), key=lambda i: abs(i - PLACES // 2)):
        x, y, z = path.value(times[i]).ravel().tolist()
        if (error := why_not((x, y, z))) is None:
            return x, y, z
    raise error


def learned_at(scenario: Scenario, p_WB: tuple[float, float, float] = POINT) -> Scenario:
    """Return the scenario whose filter has the values that its banks learn when hovering at a point.

    InputError as hover_V, or if the scenario has no linear loop.
    """
    if why := why_no_loop(scenario):
        raise InputError(why)
    hover_V(scenario, p_WB)  # nothing is learned where a sensor gives no measurement
    return as_learned(scenario, hovering(p_WB))


def errors_moment(scenario: Scenario, point: tuple[float, float, float], duration: float) -> float:
    """Return the mean squared distance from r [m^2] that the world's errors cause in `duration` [s] after WARM_UP."""
    first, ticks = (round(time / scenario.h) for time in (WARM_UP, WARM_UP + duration))
    moments = position_moments(scenario, hover_V(scenario, point), error_inputs(scenario, hovering(point)), ticks + 1)
    return float(np.mean(np.trace(moments[first:], axis1=1, axis2=2)))


def command_cases(losses: Sequence[float], strategies: Sequence[str], delays: Sequence[int]) -> list[CommandLink]:
    """Return command links to fly: every loss with every strategy without delay, then every delay without loss.

    InputError naming the share, strategy or delay that is not possible, and what is allowed.
    """
    lossy = [{"loss": loss_of(p).model_dump(), "when_lost": s} for s in strategies for p in losses]
    return [validate(CommandLink, data, "command_link") for data in lossy + [{"delay": d} for d in delays]]


def command_flights(
    scenario: Scenario,
    links: Sequence[CommandLink],
    seeds: Iterable[int],
    out: Path,
    duration: float = 40.0,
    point: tuple[float, float, float] = POINT,
    workers: int = 1,
    progress: Callable[[CommandCase], None] | None = None,
    player: str = "fastest",
) -> CommandFlights:
    """Hover behind each link at a point, with the same seeds, and return predicted and flown figures.

    The scenario's planner and command link are replaced. The hovering that counts lasts `duration` [s], after WARM_UP.
    Flights are kept in the folder `out`, as fly_many does, which takes `player`; `progress` gets each finished case.
    InputError as hover_V.
    """
    seeds = list(seeds)
    told = learned_at(scenario, point)
    V, errors = hover_V(told, point), errors_moment(told, point, duration)
    planner = HoverPlanner(kind="hover", point=point, duration=WARM_UP + duration)
    calm = scenario.model_copy(update={"planner": planner, "settle": 0.0})
    cases, players = [], set[str]()
    for link in links:
        flown = calm.model_copy(update={"command_link": link})
        players.update(its.player or "unknown" for its in fly_many(flown, seeds, out, workers, player=player))
        loop = commanded_loop(told, V, delay=link.delay)
        case = _case(link, lossy_loop(loop, link, scenario.h), errors, flights_of(flown, seeds, out))
        cases.append(case)
        if progress:
            progress(case)
    agree, by = sum(case.agrees for case in cases), flown_by([calm], players)
    return CommandFlights(scenario.name, point, duration, WARM_UP, seeds, cases, agree, by)


def _case(link: CommandLink, system: JumpLinear, errors: float, flights: list[xr.Dataset]) -> CommandCase:
    radius = mean_square_radius(system)
    stable = radius < 1.0 - MARGIN
    rms = float(np.sqrt(np.trace(steady_second_moment(system).mean(axis=0)[:3, :3]) + errors)) if stable else None
    ends = [end for flight in flights if (end := end_of(flight))]
    kept = [flight for flight in flights if end_of(flight) is None]
    squares = [reference_distance(flight)[flight["time"].values >= WARM_UP] ** 2 for flight in kept]
    return CommandCase(
        link=link,
        growth=radius,
        stable=stable,
        predicted_rms=rms,
        flights=len(flights),
        lost=len(ends),
        lost_after=float(np.mean([end.time for end in ends])) if ends else None,
        causes=sorted({end.cause for end in ends}),
        flown_rms=float(np.sqrt(np.mean(np.concatenate(squares)))) if squares else None,
        agrees=len(ends) == (0 if stable else len(flights)),
    )
