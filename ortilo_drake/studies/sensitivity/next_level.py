"""The search for the level at which a share of the flights is lost: the next level, and when to stop.

The flights so far leave a posterior over the curves of loss_level.py, all v* within the range and all slopes equally
likely at first on logarithmic axes. A batch is flown at the level of a ladder from which the variance of ln v* is
expected to fall the furthest (one step ahead, each number of losses weighed by its chance). With no flights that is a
bisection; with some it settles about v*. The posterior chooses levels alone: value and interval are loss_level's.
"""

from math import log
from typing import Final

import numpy as np
from scipy.special import comb

from ortilo_drake.studies.sensitivity.loss_level import Flown, LossLevel, log_likelihood, loss_chance

BATCH: Final = 5  # flights
WIDE: Final = 2.0  # of an interval: the factor from its low to its high end at which the search ends
LEAST: Final = 1.0 / 32.0  # of the careful value: below it none is flown
STEP: Final = 2.0**0.25  # from one level of the ladder to the next, as a factor
_SLOPES: Final = np.geomspace(1.0, 40.0, 6)
_POINTS: Final = 64  # values of v*


def ladder(careful: float, largest: float) -> np.ndarray:
    """Return the levels that may be flown, from the largest downwards."""
    count = 1 + int(np.floor(np.log(largest / (LEAST * careful)) / np.log(STEP) + 1e-9))
    return np.asarray(largest * STEP ** -np.arange(count))


def is_settled(found: LossLevel, levels: np.ndarray) -> bool:
    """Return whether the part of an interval that lies within the levels' range is narrow enough."""
    low, high = found.interval
    low = max(low or 0.0, levels.min())
    return min(levels.max() if high is None else high, levels.max()) <= WIDE * low


def next_level(without: Flown, flown: list[Flown], levels: np.ndarray, share: float) -> float:
    """Return the level of a ladder at which the next batch is flown, in search of the one that loses the share.

    So far there are the flights without the mismatch, and those flown at levels above 0, none at first.
    """
    at = np.geomspace(levels.min() / 2.0, 2.0 * levels.max(), _POINTS)
    known = flown or [Flown(1.0, 0, 0)]
    log_posterior = log_likelihood(without, known, at, _SLOPES, share).reshape(_POINTS, -1)
    posterior = np.exp(log_posterior - log_posterior.max())
    posterior /= posterior.sum()
    P = loss_chance(levels, at, _SLOPES, share).reshape(*posterior.shape, -1)
    lost = np.arange(BATCH + 1)[:, None, None, None]
    # Axes: losses, v*, the curve's other parameters, levels.
    joint = comb(BATCH, lost) * P**lost * (1.0 - P) ** (BATCH - lost) * posterior[:, :, None]
    of_at = joint.sum(axis=2)
    chance, x = of_at.sum(axis=1), np.log(at)
    mean = np.einsum("kil,i->kl", of_at, x) / np.maximum(chance, 1e-300)
    variance = np.einsum("kil,i->l", of_at, x**2) - np.sum(chance * mean**2, axis=0)
    return float(levels[np.argmin(variance)])


ERROR: Final = 0.05  # e
APART: Final = 2.5  # p_0 = share / APART
ABOVE: Final = 2.0  # p_1 = share ABOVE


def loses_more(flights: int, lost: int, share: float) -> bool | None:
    """Return whether more than a share of all flights is lost, from so many flown and lost; None if undecided.

    It is Wald's sequential probability ratio test, which ends as soon as the flights decide (Sequential tests of
    statistical hypotheses, Annals of Mathematical Statistics 16, 1945, 117-186). With n flights of which l are lost,
    and p_0 = share / APART < p_1 = share ABOVE, between which no decision is asked for,

        L = l ln(p_1 / p_0) + (n - l) ln((1 - p_1) / (1 - p_0)),

    the share is decided to be the larger where L >= ln((1 - e) / e) and the smaller where L <= -ln((1 - e) / e). Each
    decision is wrong with a chance of at most e / (1 - e): of p_1 or more, and of p_0 or less.
    """
    p_0, p_1 = share / APART, share * ABOVE
    ratio = lost * log(p_1 / p_0) + (flights - lost) * log((1.0 - p_1) / (1.0 - p_0))
    bound = log((1.0 - ERROR) / ERROR)
    return True if ratio >= bound else False if ratio <= -bound else None
