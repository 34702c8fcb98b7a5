"""Tails and margins of the predicted tube over rates and bursts: how few measurements keep it in the corridor.

**Tails**: the probability, by the linear theory, that the vehicle is outside the tube. Given the messages that arrive,
the linear loop's deviation is Gaussian, with the filter's own P_k for X. Over random arrivals the deviation is a
mixture: wide after a long gap, narrow after a fix. The tube takes the mixture's covariance for a Gaussian's. The
mixture's tails are longer, so the vehicle leaves a tube of 3 sigma more often than in 0.27 % of the ticks. The share of
ticks outside is

    E[Q(R_k | arrivals)],   Q the probability of leaving the disc, see disc_radius.py,

and the mixture's own radius is the one at which this mean is 0.27 %. The mean is over arrivals drawn from the links'
own noise. So a seed's arrivals are those of the flight with this seed, except where the flight is off its path.

**Maps** of margins vary two sensors, see map_sensors; all other sensors stay as they are. The level 0 of a map shows
the lowest arrival rates, or the longest bursts, that keep the 3-sigma tube inside the room's corridors.

Bursts come from a Gilbert-Elliott chain on each of the two links, independent of each other. A chain loses everything
while it is bad. Its share of good ticks is the arrival rate, and its mean stay in the bad state is the burst. For a
burst of b ticks, bad_to_good = 1 / b and good_to_bad = (1 - rate) / (rate b). A chain can leave the good state at most
once a tick, so no mean burst is shorter than (1 - rate) / rate ticks. A sensor slower than the tick loses at most one
message in a burst that is shorter than the time between two messages.
"""

import os
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import BernoulliLoss, Link, Loss, NoLoss, Scenario
from ortilo_drake.scenario.loss_chain import loss_of
from ortilo_drake.sensors.described import unwired
from ortilo_drake.studies.tube.corridor import corridor
from ortilo_drake.studies.tube.disc_radius import THREE_SIGMA, least_margin, outside_discs
from ortilo_drake.studies.tube.tube import NominalFlight, delay_of, deviations, losses_of, nominal_flight, tube_height
from ortilo_drake.world.radio.link import NOT_SENT, Radio, chain_after, delay_of_message, radio_of


class Mixture(NamedTuple):
    """Means (m, n, 2) and covariances (m, n, 2, 2) of the horizontal deviation from r_k, given m arrival histories."""

    means: np.ndarray
    covariances: np.ndarray


def arrivals_of_seed(scenario: Scenario, nominal: NominalFlight, seed: int) -> np.ndarray:
    """Return a mask of the messages that arrive at each tick (n, s) with a seed's losses, on the planned path."""
    sensors = scenario.measurement.sensors
    arrives = np.zeros((len(nominal.time), len(sensors)), dtype=np.bool_)
    for s, sensor in enumerate(sensors):
        if sensor not in scenario.sensors:
            continue
        late, loses = delay_of(scenario, sensor), Link(loss=scenario.link_of(sensor).loss)  # without its blackouts
        there = np.ascontiguousarray(nominal.there[late:, s])
        arrives[late:, s] = _kept_by_link(there, nominal.r, radio_of(sensor, loses, 1, scenario.h), seed)
    return arrives


@cached_njit(nogil=True)
def _kept_by_link(there: np.ndarray, r: np.ndarray, radio: Radio, seed: int) -> np.ndarray:
    """Return a mask (n) of the messages that a link does not lose."""
    kept, bad = np.zeros_like(there), False
    for k in range(there.shape[0]):
        if there[k]:
            kept[k] = delay_of_message(radio, k, r[k], bad, seed) != NOT_SENT
        if bad or radio.loss[0] > 0.0:
            bad = chain_after(k, bad, radio.loss, seed, radio.stream)
    return kept


def mixture(scenario: Scenario, nominal: NominalFlight, seeds: Iterable[int]) -> Mixture:
    """Return the deviation given the arrivals of each seed; errors as in `predict_tube`."""
    there = np.array([arrivals_of_seed(scenario, nominal, seed) for seed in seeds])
    means, covariances, _ = deviations(scenario, nominal, np.zeros((len(there), there.shape[2], 4)), there)
    return Mixture(means[:, :, :2], covariances[:, :, :2, :2])


def chance_outside(radius: np.ndarray, of: Mixture) -> np.ndarray:
    """Return the probability (n) that the mixture leaves the discs of radius (n) about r_k."""
    parts = [
        outside_discs(radius, np.ascontiguousarray(mean), np.ascontiguousarray(C))
        for mean, C in zip(of.means, of.covariances, strict=True)
    ]
    return np.asarray(np.mean(parts, axis=0))


def greatest_chance(radius: np.ndarray, of: Mixture) -> float:
    """Return the greatest of chance_outside; ticks whose upper bound is below the greatest so far are skipped.

    The bound: |z - m| > x has a probability of at most exp(-x^2 / (2 s_1^2)), with equality for a round C.
    """
    a, b, c = of.covariances[..., 0, 0], of.covariances[..., 0, 1], of.covariances[..., 1, 1]
    largest = 0.5 * (a + c) + np.hypot(0.5 * (a - c), b)  # s_1^2
    left = np.maximum(radius - np.hypot(of.means[..., 0], of.means[..., 1]), 0.0)
    bound = np.exp(-0.5 * left**2 / np.maximum(largest, 1e-300)).mean(axis=0)
    greatest = 0.0
    for k in np.argsort(-bound):
        if bound[k] < greatest:
            break
        at_k = np.full(len(of.means), radius[k]), np.ascontiguousarray(of.means[:, k]), of.covariances[:, k].copy()
        greatest = max(greatest, float(np.mean(outside_discs(*at_k))))
    return greatest


def mixture_radius(of: Mixture, start: np.ndarray) -> np.ndarray:
    """Return the radius (n) that the mixture leaves with the probability THREE_SIGMA, by bisection to 0.1 %.

    start: a first guess (n), above 0, such as the tube's radius.
    """
    low, high = np.zeros_like(start), np.array(start)
    while np.any(wide := chance_outside(high, of) > THREE_SIGMA):
        high = np.where(wide, 2.0 * high, high)
    for _ in range(12):
        middle = 0.5 * (low + high)
        wide = chance_outside(np.maximum(middle, 1e-9), of) > THREE_SIGMA
        low, high = np.where(wide, middle, low), np.where(wide, high, middle)
    return 0.5 * (low + high)


CAMERA = 1  # column of NominalFlight.there


class MarginMap(NamedTuple):
    """Least margins of the tube [m] over rates a and b of two sensors, or over a common rate a and mean burst b [s].

    whole: over the whole path (len(a), len(b)), NaN if no such link exists; guided: over the path up to the second
    sensor's last measurement, see guided_ticks.
    """

    a: np.ndarray
    b: np.ndarray
    whole: np.ndarray
    guided: np.ndarray


def map_sensors(scenario: Scenario) -> tuple[str, str]:
    """Return the two sensors that a scenario's maps vary.

    They are the first sensor beside the imu, and the next one that measures the position, or else the last sensor.
    InputError if fewer than two sensors fly beside the imu.
    """
    measurement = scenario.measurement
    flying = unwired(sensor for sensor in measurement.sensors if sensor in scenario.sensors)
    if len(flying) < 2:
        raise InputError(f"sensors: {list(scenario.sensors)}: must be two beside the imu")
    is_position = dict(zip(measurement.sensors, measurement.layout.is_position, strict=True))
    return flying[0], next((sensor for sensor in flying[1:] if is_position[sensor]), flying[-1])


def with_losses(scenario: Scenario, first: Loss, second: Loss) -> Scenario:
    """Return the scenario with other losses on the links of its two map_sensors."""
    changes = {}
    for sensor, loss in zip(map_sensors(scenario), (first, second), strict=True):
        group = scenario.group_of(sensor)
        changes[sensor] = group.model_copy(update={"link": group.link.model_copy(update={"loss": loss})})
    return scenario.model_copy(update=changes)


def without_blackouts(scenario: Scenario) -> Scenario:
    """Return the scenario with a projected camera, and without blackouts on any sensor's link."""
    changes: dict[str, Any] = {}
    for sensor in scenario.sensors:
        group = scenario.group_of(sensor)
        changes[sensor] = group.model_copy(update={"link": group.link.model_copy(update={"blackouts": ()})})
    return scenario.model_copy(update=changes).projected()


def with_rates(scenario: Scenario, first: float, second: float) -> Scenario:
    """Return the scenario in which these shares of its map_sensors' messages arrive, independently of each other.

    The shares are of the messages sent: with a message on every third tick, a third of the share is the rate per tick
    of expected_riccati.py. InputError if a rate is not in [0, 1].
    """
    for name, rate in zip(map_sensors(scenario), (first, second), strict=True):
        if not 0.0 <= rate <= 1.0:
            raise InputError(f"rate of {name}: {rate}: must be in [0, 1]")

    def bernoulli(rate: float) -> Loss:
        return NoLoss() if rate == 1.0 else BernoulliLoss(kind="bernoulli", probability=1.0 - rate)

    return with_losses(scenario, bernoulli(first), bernoulli(second))


def bursts(rate: float, burst_s: float, h: float) -> Loss | None:
    """Return the chain with this share of good ticks, in (0, 1], and mean burst [s], above 0; None if none exists."""
    if not 0.0 < rate <= 1.0:
        raise InputError(f"rate: {rate}: must be in (0, 1]")
    if not burst_s > 0.0:
        raise InputError(f"burst: {burst_s} s: must be above 0")
    try:
        return loss_of(1.0 - rate, burst_s / h)
    except InputError:
        return None


def guided_ticks(nominal: NominalFlight, column: int = CAMERA) -> int:
    """Return the number of ticks up to a sensor's last measurement, the camera's by default; all if it has none."""
    seen = np.flatnonzero(nominal.there[:, column])
    return int(seen[-1]) + 1 if len(seen) else len(nominal.time)


Cases = list[list[Scenario | None]]


def rate_cases(scenario: Scenario, first: np.ndarray, second: np.ndarray) -> Cases:
    """Return the scenario at every pair of arrival rates, losses independent; errors as in `with_rates`."""
    return [[with_rates(scenario, float(a), float(b)) for b in second] for a in first]


def burst_cases(scenario: Scenario, rates: np.ndarray, burst_lengths_s: np.ndarray) -> Cases:
    """Return the scenario at every rate and mean burst of both links, None if no chain has them; errors as bursts."""
    losses = [[bursts(float(a), float(b), scenario.h) for b in burst_lengths_s] for a in rates]
    return [[None if loss is None else with_losses(scenario, loss, loss) for loss in row] for row in losses]


def tube_map(scenario: Scenario, first: np.ndarray, second: np.ndarray) -> MarginMap:
    """Return the tube's margins over the arrival rates of the map_sensors; errors as in rate_cases and predict_tube."""
    return _margins(scenario, first, second, rate_cases(scenario, first, second))


def burst_map(scenario: Scenario, rates: np.ndarray, burst_lengths_s: np.ndarray) -> MarginMap:
    """Return the tube's margins over a common rate and mean burst [s]; errors as in burst_cases and predict_tube."""
    return _margins(scenario, rates, burst_lengths_s, burst_cases(scenario, rates, burst_lengths_s))


def _margins(scenario: Scenario, a: np.ndarray, b: np.ndarray, cases: Cases) -> MarginMap:
    """Return the least margins over the whole path and its guided part; all cases share one nominal flight."""
    nominal = nominal_flight(scenario)
    about = corridor(scenario.load_room(), scenario.vehicle, nominal.r)
    n = guided_ticks(nominal, scenario.measurement.sensors.index(map_sensors(scenario)[1]))
    there = [(i, j, losses_of(case)) for i, row in enumerate(cases) for j, case in enumerate(row) if case is not None]
    whole, guided = np.full((len(a), len(b)), np.nan), np.full((len(a), len(b)), np.nan)
    mean, covariance, _ = deviations(scenario, nominal, np.array([losses for _, _, losses in there]))
    height = about.height - tube_height(mean, covariance)
    plane = np.ascontiguousarray(mean[..., :2]), np.ascontiguousarray(covariance[..., :2, :2])
    for q, (i, j, _) in enumerate(there):
        for margins, ticks in ((whole, len(about.radius)), (guided, n)):
            horizontal = least_margin(about.radius[:ticks], plane[0][q, :ticks], plane[1][q, :ticks], THREE_SIGMA)
            margins[i, j] = min(horizontal, height[q, :ticks].min())
    return MarginMap(a, b, whole, guided)


def chance_map(scenario: Scenario, cases: Cases, seeds: Iterable[int]) -> np.ndarray:
    """Return the greatest chance, over the ticks of the path, of being outside the corridor's disc; NaN without a case.

    The chance is the mixture's over the arrivals of the seeds, the same seeds in all cases. Its level THREE_SIGMA is
    the boundary that the Gaussian tube's level 0 stands for, with the mixture's tails. The few longest gaps make this
    chance, so it takes hundreds of histories: with 20 instead of 200, the boundary of nominal_imu_uwb_yolo without
    blackouts is at a UWB rate of 0.116 instead of 0.088. All cases share the scenario's nominal flight.
    """
    nominal, seeds = nominal_flight(scenario), list(seeds)
    room = corridor(scenario.load_room(), scenario.vehicle, nominal.r).radius

    def chance(case: Scenario | None) -> float:
        return np.nan if case is None else greatest_chance(room, mixture(case, nominal, seeds))

    with ThreadPoolExecutor(os.cpu_count()) as threads:
        return np.array([list(threads.map(chance, row)) for row in cases])
