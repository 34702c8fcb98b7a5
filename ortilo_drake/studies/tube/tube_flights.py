"""Nonlinear flights against the predicted tube.

A point of a map is a pair of arrival rates of two sensors, such as uwb and camera, or an arrival rate and a mean burst
of both links. The same seeds are flown at each point. Two numbers are compared, over all flights of a point and all
their ticks up to the end or the loss:

    contained   the share of ticks whose horizontal deviation from r_k is within the predicted radius R_k;
    lost        the number of lost flights, and whether the tube's margin says that none should be. The ticks after a
                loss are in no share.

The prediction *holds* if at least 99 % of the ticks are contained and no flight is lost where the margin is above 0;
else it *breaks down* there. Successive ticks of a flight are correlated, so the interval of the share comes from a
bootstrap over whole flights. The report also gives the share that the linear theory expects for the arrivals of these
seeds (tube_map.py). If that share is below 99 % as well, the Gaussian assumption fails, not the
linearisation.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ortilo_drake.flight.ensemble import flight_folder, flights_of, fly_many
from ortilo_drake.flight.figures import REFERENCE, TRUE
from ortilo_drake.flight.lost import Lost
from ortilo_drake.flight.metrics import loss_of
from ortilo_drake.flight.players import choose, kept_player
from ortilo_drake.flight.processes.workers import run_all
from ortilo_drake.flight.summary import Loss
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario
from ortilo_drake.studies.maps.chunks import trace_of, traced
from ortilo_drake.studies.tube.corridor import corridor, margin
from ortilo_drake.studies.tube.tube import NominalFlight, predict_tube
from ortilo_drake.studies.tube.tube_map import bursts, chance_outside, mixture, mixture_radius, with_losses

Point = tuple[float, float]

# Shares of the two sensors' messages that arrive: both sides of the predicted boundary, and well inside.
PAIRS: tuple[Point, ...] = (
    (1.0, 1.0), (1.0, 0.3), (0.5, 0.5), (0.3, 1.0), (0.3, 0.3), (0.2, 0.2), (0.1, 1.0), (0.1, 0.1),
    (0.1, 0.0), (0.06, 0.3), (0.05, 1.0), (0.05, 0.05), (0.03, 1.0), (0.03, 0.1), (0.03, 0.03),
    (0.02, 0.3), (0.02, 0.02), (0.01, 1.0), (0.01, 0.05), (0.005, 0.3),
)  # fmt: skip
# Arrival rates and mean bursts [s] of both links, chosen in the same way.
BURSTS: tuple[Point, ...] = ((0.3, 0.5), (0.3, 2.0), (0.6, 1.0), (0.6, 3.0), (0.9, 2.0), (0.9, 8.0))
SHARE = 0.99  # least share of ticks in the tube for a prediction to hold
STRETCHES = 8  # equal parts of the path, of which the worst is told
COMPILED_AT_ONCE = 16  # flights in one job of a worker
OTHER_SEEDS = tuple(range(1001, 1041))  # seeds of the arrivals for the mixture's radius


class Flown(NamedTuple):
    """A seed's flight: true position less r_k [m] (n, 3) up to its loss, the loss's time [s] or None, its player."""

    seed: int
    deviation: np.ndarray
    lost: float | None
    player: str = "engine"


@dataclass(frozen=True)
class PointResult:
    """A point of a map: the theory's prediction, and the flights' result. Lengths in m."""

    at: Point
    """arrival rates of the two sensors, or their common arrival rate and mean burst [s]."""
    radius_mean: float
    """mean radius of the tube over the path; radius_max is the greatest."""
    radius_max: float
    margin: float
    """least distance by which the tube stays inside the corridor."""
    flights: int
    contained: float
    """share of ticks within the tube; contained_low to contained_high is its 95 % interval."""
    contained_low: float
    contained_high: float
    contained_worst: float
    """share of ticks within the tube in the worst of STRETCHES parts of the path."""
    expected: float
    """share of ticks within the tube that the linear theory expects, given the seeds' arrivals."""
    contained_mixture: float
    """share of ticks within the radius that the mixture leaves with probability 0.27 %."""
    radius_mixture: float
    """mean of this radius over the path."""
    lost: int
    holds: bool
    """whether the prediction holds, see the head of this file; `breakdown` says why not."""
    breakdown: str


def _breakdown(contained: float, expected: float, lost: int, least: float) -> str:
    reasons = []
    if contained < SHARE:
        gaussian = expected < SHARE
        reasons.append("tails longer than a Gaussian's" if gaussian else "deviations beyond the linear theory")
    if lost and least > 0.0:
        reasons.append(f"{lost} lost though the tube is inside")
    return "; ".join(reasons)


def _flown(seed: int, trace: np.ndarray, lost: Loss | Lost | None) -> Flown:
    return Flown(seed, trace[:, TRUE] - trace[:, REFERENCE], None if lost is None else lost.time)


def at_burst(scenario: Scenario, point: Point) -> Scenario:
    """Return the scenario with this arrival rate and mean burst [s] on both links; InputError if no chain has them."""
    loss = bursts(*point, scenario.h)
    if loss is None:
        raise InputError(f"burst: {point[1]:g} s: too short for an arrival rate of {point[0]:g}")
    return with_losses(scenario, loss, loss)


def fly_compiled(scenario_json: str, seeds: list[int], folder: str) -> list[Flown]:
    """Return flights by the engine. Runs in a worker process: the arguments are plain data."""
    engine = kept_player(scenario_json, folder)
    return [_flown(seed, *traced(engine, seed)) for seed in seeds]


def fly_point(
    lossy: Scenario, seeds: Iterable[int], out: Path, workers: int = 1, player: str = "fastest"
) -> list[Flown]:
    """Return the flights of a point; errors as in `fly_many`.

    The engine keeps no flight: reading a kept one would take longer. Drake's flights are kept in the folder, and those
    already there are not flown again. The player is as in fly_many.
    """
    seeds = list(seeds)
    if choose(lossy, player) == "engine":
        text, found, folder = lossy.model_dump_json(), dict[int, list[Flown]](), flight_folder(out, lossy).name
        jobs = [(text, seeds[at : at + COMPILED_AT_ONCE], folder) for at in range(0, len(seeds), COMPILED_AT_ONCE)]
        run_all(fly_compiled, jobs, workers, found.__setitem__)
        return [one for number in sorted(found) for one in found[number]]
    fly_many(lossy, seeds, out, workers, player=player)
    saved = zip(seeds, flights_of(lossy, seeds, out), strict=True)
    return [_flown(k, trace_of(its), loss_of(its))._replace(player=its.attrs["player"]) for k, its in saved]


def judge_point(
    lossy: Scenario, at: Point, flights: Sequence[Flown], nominal: NominalFlight, others: Sequence[int] = OTHER_SEEDS
) -> PointResult:
    """Return the comparison of a point's flights with the tube predicted for `lossy`, the scenario that was flown.

    The mixture's radius comes from the arrivals of `others`, seeds of which none was flown.
    """
    tube = predict_tube(lossy, nominal)
    about = corridor(lossy.load_room(), lossy.vehicle, nominal.r)
    given = mixture(lossy, nominal, [flight.seed for flight in flights])
    wide = mixture_radius(mixture(lossy, nominal, others), tube.radius)
    inside = [within(flight, tube.radius) for flight in flights]
    contained = float(np.mean(np.concatenate(inside)))
    low, high = interval(inside)
    expected = 1.0 - float(np.mean(chance_outside(tube.radius, given)))
    least, lost = margin(tube, about).least, sum(flight.lost is not None for flight in flights)
    return PointResult(
        at=at,
        radius_mean=float(tube.radius.mean()),
        radius_max=float(tube.radius.max()),
        margin=least,
        flights=len(flights),
        contained=contained,
        contained_low=low,
        contained_high=high,
        contained_worst=worst_stretch(inside, len(nominal.time)),
        expected=expected,
        contained_mixture=float(np.mean(np.concatenate([within(flight, wide) for flight in flights]))),
        radius_mixture=float(wide.mean()),
        lost=lost,
        holds=contained >= SHARE and not (lost and least > 0.0),
        breakdown=_breakdown(contained, expected, lost, least),
    )


def within(flight: Flown, radius: np.ndarray) -> np.ndarray:
    """Return the mask of a flight's ticks at which the horizontal deviation is within the radius (n)."""
    return np.hypot(flight.deviation[:, 0], flight.deviation[:, 1]) <= radius[: len(flight.deviation)]


def worst_stretch(inside: Sequence[np.ndarray], ticks: int) -> float:
    """Return the share of ticks inside in the worst of STRETCHES equal parts of the path, all flights together."""
    edges = np.linspace(0, ticks, STRETCHES + 1).astype(int)
    parts = [np.concatenate([ok[a:b] for ok in inside]) for a, b in pairwise(edges)]
    return min(float(part.mean()) for part in parts if part.size)


def interval(inside: Sequence[np.ndarray], draws: int = 2000) -> tuple[float, float]:
    """Return the 95 % interval of the share of ticks inside, by a percentile bootstrap over whole flights."""
    hits, ticks = np.array([ok.sum() for ok in inside]), np.array([ok.size for ok in inside])
    chosen = np.random.default_rng(0).integers(len(inside), size=(draws, len(inside)))
    low, high = np.quantile(hits[chosen].sum(axis=1) / ticks[chosen].sum(axis=1), [0.025, 0.975])
    return float(low), float(high)
