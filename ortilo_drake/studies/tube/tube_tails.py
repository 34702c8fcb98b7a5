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

from ortilo_drake.scenario import NoLoss, Scenario
from ortilo_drake.scenario.loss_chain import loss_parameters
from ortilo_drake.studies.tube.disc_radius import THREE_SIGMA, outside_discs
from ortilo_drake.studies.tube.nominal_flight import NominalFlight, delay_of
from ortilo_drake.studies.tube.tube import deviation
from ortilo_drake.world.noise import stream_id
from ortilo_drake.world.radio.link import NOT_SENT, chain_after, delay_of_message


class Mixture(NamedTuple):
    """The deviation from r_k in the plane given each of m arrival histories.

    Attributes:
        means: (m, n, 2).
        covariances: (m, n, 2, 2).
    """

    means: np.ndarray
    covariances: np.ndarray


def arrivals_of_seed(scenario: Scenario, nominal: NominalFlight, seed: int) -> np.ndarray:
    """Return which messages arrive in each tick (n, s) with that seed's losses, on the planned path."""
    n, sensors = len(nominal.time), scenario.measurement.sensors
    arrives = np.zeros((n, len(sensors)), dtype=np.bool_)
    no_blackouts = np.empty((0, 3))  # the nominal flight holds them
    for s, sensor in enumerate(sensors):
        if sensor not in scenario.sensors:
            continue
        loss, bad = loss_parameters(scenario.link_of(sensor).loss, scenario.h), False
        stream = stream_id(f"link/{sensor}")
        late = delay_of(scenario, sensor)
        for k in range(n - late):
            if nominal.there[k + late, s]:
                sent = delay_of_message(k, nominal.r[k], bad, loss, no_blackouts, (0, 0), seed, stream)
                arrives[k + late, s] = sent != NOT_SENT
            bad = chain_after(k, bad, loss, seed, stream)
    return arrives


def without_losses(scenario: Scenario) -> Scenario:
    """Return the scenario with links that lose nothing at random."""
    groups = {name: scenario.group_of(name) for name in scenario.sensors}
    return scenario.model_copy(
        update={
            name: group.model_copy(update={"link": group.link.model_copy(update={"loss": NoLoss()})})
            for name, group in groups.items()
        }
    )


def mixture(scenario: Scenario, nominal: NominalFlight, seeds: Iterable[int]) -> Mixture:
    """Return the deviation given the arrivals of each seed; errors as predict_tube."""
    sure = without_losses(scenario)
    parts = [deviation(sure, nominal._replace(there=arrivals_of_seed(scenario, nominal, seed)))[:2] for seed in seeds]
    return Mixture(np.array([mean[:, :2] for mean, _ in parts]), np.array([C[:, :2, :2] for _, C in parts]))


def chance_outside(radius: np.ndarray, of: Mixture) -> np.ndarray:
    """Return with what probability the mixture leaves the discs of that radius (n) about r_k (n)."""
    parts = [
        outside_discs(radius, np.ascontiguousarray(mean), np.ascontiguousarray(C))
        for mean, C in zip(of.means, of.covariances, strict=True)
    ]
    return np.asarray(np.mean(parts, axis=0))


def mixture_radius(of: Mixture, start: np.ndarray, outside: float = THREE_SIGMA) -> np.ndarray:
    """Return the radius (n) that the mixture leaves with the probability ``outside``, by bisection to 0.1 %.

    Args:
        of: the mixture.
        start: a first guess (n), above 0, such as the tube's radius.
        outside: in (0, 1).
    """
    low, high = np.zeros_like(start), np.array(start)
    while np.any(wide := chance_outside(high, of) > outside):
        high = np.where(wide, 2.0 * high, high)
    for _ in range(12):
        middle = 0.5 * (low + high)
        wide = chance_outside(np.maximum(middle, 1e-9), of) > outside
        low, high = np.where(wide, middle, low), np.where(wide, high, middle)
    return 0.5 * (low + high)
