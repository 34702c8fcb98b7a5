"""Tails of the tube: the probability, by the linear theory, that the vehicle is outside it.

Given which messages arrive, the linear loop's deviation is Gaussian, with the filter's own P_k for X. Over random
arrivals it is a mixture: after a long gap it is wide, after a fix it is narrow. The tube takes the covariance of that
mixture for the covariance of a Gaussian. The mixture's tails are longer, so the vehicle leaves a tube of 3 sigma more
often than in 0.27 % of the ticks. The share of ticks outside is

    E[Q(R_k | arrivals)],   Q the probability of leaving the disc, see disc_radius.py,

and the mixture's own radius is the one at which that mean is 0.27 %. The mean is taken over arrivals drawn from the
links' own noise. The arrivals of a seed are therefore those of the flight with that seed, except where that flight is
off its path.
"""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numba import njit

from ortilo_drake.scenario import Scenario
from ortilo_drake.scenario.loss_chain import loss_parameters
from ortilo_drake.studies.tube.disc_radius import THREE_SIGMA, outside_discs
from ortilo_drake.studies.tube.tube import NominalFlight, delay_of, deviations
from ortilo_drake.world.noise import stream_id
from ortilo_drake.world.radio.link import NOT_SENT, chain_after, delay_of_message


class Mixture(NamedTuple):
    """Means (m, n, 2) and covariances (m, n, 2, 2) of the deviation from r_k in the plane given m arrival histories."""

    means: np.ndarray
    covariances: np.ndarray


def arrivals_of_seed(scenario: Scenario, nominal: NominalFlight, seed: int) -> np.ndarray:
    """Return a mask of the messages that arrive in each tick (n, s) with a seed's losses, on the planned path."""
    sensors = scenario.measurement.sensors
    arrives = np.zeros((len(nominal.time), len(sensors)), dtype=np.bool_)
    for s, sensor in enumerate(sensors):
        if sensor not in scenario.sensors:
            continue
        loss, late = loss_parameters(scenario.link_of(sensor).loss, scenario.h), delay_of(scenario, sensor)
        there = np.ascontiguousarray(nominal.there[late:, s])
        arrives[late:, s] = _kept_by_link(there, nominal.r, loss, seed, stream_id(f"link/{sensor}"))
    return arrives


@njit(cache=True, nogil=True)
def _kept_by_link(there: np.ndarray, r: np.ndarray, loss: np.ndarray, seed: int, stream: np.uint64) -> np.ndarray:
    """Return a mask (n) of the messages that a link does not lose, its blackouts aside."""
    kept, bad, no_blackouts = np.zeros_like(there), False, np.empty((0, 3))
    for k in range(there.shape[0]):
        if there[k]:
            kept[k] = delay_of_message(k, r[k], bad, loss, no_blackouts, (0, 0), seed, stream) != NOT_SENT
        if bad or loss[0] > 0.0:
            bad = chain_after(k, bad, loss, seed, stream)
    return kept


def mixture(scenario: Scenario, nominal: NominalFlight, seeds: Iterable[int]) -> Mixture:
    """Return the deviation given the arrivals of each seed; errors as predict_tube."""
    there = np.array([arrivals_of_seed(scenario, nominal, seed) for seed in seeds])
    means, covariances, _ = deviations(scenario, nominal, np.zeros((len(there), there.shape[2], 4)), there)
    return Mixture(means[:, :, :2], covariances[:, :, :2, :2])


def chance_outside(radius: np.ndarray, of: Mixture) -> np.ndarray:
    """Return the probability that the mixture leaves the discs of that radius (n) about r_k (n)."""
    parts = [
        outside_discs(radius, np.ascontiguousarray(mean), np.ascontiguousarray(C))
        for mean, C in zip(of.means, of.covariances, strict=True)
    ]
    return np.asarray(np.mean(parts, axis=0))


def greatest_chance(radius: np.ndarray, of: Mixture) -> float:
    """Return the greatest of chance_outside; ticks whose bound is below it are skipped.

    |z - m| > x has a probability of at most exp(-x^2 / (2 s_1^2)), which holds for a round C.
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

    It starts from a first guess (n), above 0, such as the tube's radius.
    """
    low, high = np.zeros_like(start), np.array(start)
    while np.any(wide := chance_outside(high, of) > THREE_SIGMA):
        high = np.where(wide, 2.0 * high, high)
    for _ in range(12):
        middle = 0.5 * (low + high)
        wide = chance_outside(np.maximum(middle, 1e-9), of) > THREE_SIGMA
        low, high = np.where(wide, middle, low), np.where(wide, high, middle)
    return 0.5 * (low + high)
