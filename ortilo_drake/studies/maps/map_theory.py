"""The theory of a map whose axes are a link's rates and losses: lines to be drawn over the flights.

The filter's error: the fixed point of the expected Riccati equation bounds the mean of P_k from above, for rates and
for losses one by one or in bursts (studies/arrivals). The loss of vehicles: a flight of the duration D in which a share
p of all messages is lost in bursts of the mean length L has about p D / L of them, and each is longer than T with the
chance exp(-T / L). If a flight were lost when one is longer than T, and only then,

    P(lost) = 1 - exp(-p D / L exp(-T / L)).
"""

import re
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize_scalar

from ortilo_drake.flight.flyable import flight_ticks
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario
from ortilo_drake.studies.arrivals.arrival_map import diagonals, filter_model, link_chain
from ortilo_drake.studies.command_link.command_flights import hover_point, hover_V, learned_at
from ortilo_drake.studies.loop.hover_loop import filter_V, hover_loop
from ortilo_drake.studies.maps.map_flights import Map
from ortilo_drake.studies.maps.sweep import scenario_at

_KNOWN = re.compile(r"(uwb|camera)\.link\.(rate|loss(\..+)?)")
_TWO_MODES = ("bursts", "gilbert_elliott")
MOST_MODES = 128  # of a chain of arrivals; with more, as of rates that have no short common period, a point is left out
_SHORTEST, _LONGEST = 0.1, 1000.0  # T [s]


class MapTheory(NamedTuple):
    """The theory at each of n points of a map, or in a line why it says nothing, silence.

    rms is the root of the bound on the mean squared error of the position [m] (n), NaN where it says nothing. The share
    of flights lost [1] (n) is of bursts alone, with the longest that a flight stands, T that fits the map's own flights
    best [s]; both are None for other axes, and where none was lost, or all were.
    """

    rms: np.ndarray
    lost: np.ndarray | None
    longest: float | None
    silence: str | None


def lost_in_bursts(share: np.ndarray, length: np.ndarray, duration: np.ndarray | float, longest: float) -> np.ndarray:
    """Return the chance of a burst longer than T, `longest` [s], in a flight of D [s].

    Its messages are lost in a share p [1], in bursts of the mean length L [s].
    """
    return np.asarray(1.0 - np.exp(-share * duration / length * np.exp(-longest / length)))


def theory_of(found: Map) -> MapTheory:
    """Return the theory of a map."""
    nothing = np.full(len(found.rows), np.nan)
    other = [key for key in found.sweep.axes if not _KNOWN.fullmatch(key)]
    if other:
        return MapTheory(nothing, None, None, f"theory has lines for rates and losses of links, not for {other[0]}")
    try:
        scenarios = [scenario_at(found.sweep, row.point, "map") for row in found.rows]
        rms = np.array([expected_rms(scenario) for scenario in scenarios])
    except InputError as error:
        return MapTheory(nothing, None, None, f"theory says nothing of this scenario: {error}")
    lost = _fitted(found, scenarios)
    if np.isnan(rms).all() and lost is None:
        return MapTheory(rms, None, None, f"the links' rates have no common period of {MOST_MODES} ticks or fewer")
    share, longest = lost or (None, None)
    return MapTheory(rms, share, longest, None)


def expected_rms(scenario: Scenario) -> float:
    """Return the root of the bound on the trace of E[P_k] of the position, hovering [m].

    Infinity where position is never seen; NaN where the arrivals have more than MOST_MODES modes. InputError if the
    scenario's filter has no such bound.
    """
    h = scenario.h
    mapped = scenario.measurement.positions[:2]
    links = [scenario.link_of(name) if name in scenario.sensors else None for name in mapped]
    period = int(np.lcm.reduce([1 if link is None else link.every(h) for link in links]))
    modes = period * int(np.prod([2 if link is not None and link.loss.kind in _TWO_MODES else 1 for link in links]))
    if modes > MOST_MODES:
        return float("nan")
    point = hover_point(scenario)
    told = learned_at(scenario, point)
    model = filter_model(hover_loop(told), filter_V(told, hover_V(told, point)))
    return float(np.sqrt(np.sum(diagonals(model, link_chain(links[0], links[1], h)).upper[:3])))


def _fitted(found: Map, scenarios: list[Scenario]) -> tuple[np.ndarray, float] | None:
    """Return lost_in_bursts at each point and the T of the greatest likelihood.

    None where a point has no bursts, and where no flight was lost, or each: any T beyond some bound is as likely then.
    """
    sensors = {key.split(".")[0] for key in found.sweep.axes}
    losses = [scenario.link_of(next(iter(sensors))).loss for scenario in scenarios]
    if len(sensors) != 1 or any(loss.kind != "bursts" for loss in losses):
        return None
    p, L = np.array([(loss.loss, loss.mean_length) for loss in losses if loss.kind == "bursts"]).T
    D = np.array([flight_ticks(scenario) * scenario.h for scenario in scenarios])
    lost, flights = np.array([(row.lost, row.flights) for row in found.rows]).T
    if lost.sum() in (0, flights.sum()):
        return None

    def unlikely(log_T: float) -> float:
        chance = np.clip(lost_in_bursts(p, L, D, float(np.exp(log_T))), 1e-12, 1.0 - 1e-12)
        return -float(np.sum(lost * np.log(chance) + (flights - lost) * np.log(1.0 - chance)))

    T = float(np.exp(minimize_scalar(unlikely, bounds=np.log([_SHORTEST, _LONGEST]), method="bounded").x))
    return lost_in_bursts(p, L, D, T), T
