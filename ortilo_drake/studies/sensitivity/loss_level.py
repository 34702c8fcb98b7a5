"""The level of a mismatch at which a share of the flights is lost, from flights at several levels.

The probability of losing a flight is assumed to rise with the level v > 0 along a curve in its logarithm,

    P(v) = p_0 + (1 - p_0) F(a + b ln v),   b > 0,

where p_0 is the probability without any mismatch, and F is either the logistic 1 / (1 + exp(-z)) or Weibull's 1 -
exp(-exp(z)), since which of them holds is not known. The level v* with P(v*) = share is found by maximum likelihood,
its 95 % interval by the profile likelihood: where twice the log-likelihood is within 3.84 of its maximum, with the best
F, p_0 and b at each v*. The likelihood is the same whether levels were chosen beforehand or by what was lost before, as
here.

**The search.** The flights so far leave a posterior over the curves, all v* within the range and all slopes equally
likely at first on logarithmic axes. A batch is flown at the level of a ladder from which the variance of ln v* is
expected to fall the furthest (one step ahead, each number of losses weighed by its chance). With no flights that is a
bisection; with some it settles about v*. The posterior only chooses levels: value and interval are those above.
"""

from math import log
from typing import Final, NamedTuple

import numpy as np
from scipy.special import comb

WITHIN: Final = 3.84  # 95 % quantile of chi-square with one degree of freedom
SLOPES: Final = np.geomspace(1.0, 40.0, 60)  # b; at 40 the share lost rises from half a percent to all within 30 % of v
BEYOND: Final = 3.0  # how far beyond the levels flown v* is looked for, as a factor
POINTS: Final = 400  # values of v* that are tried
FRACTIONS: Final = np.array([0.0, 0.3, 0.6, 0.9])  # of the share: values of p_0 that are tried
_LARGE: Final = 500.0  # largest exponent


class Flown(NamedTuple):
    """Flights at one level, and how many of them were lost."""

    level: float
    flights: int
    lost: int


class LossLevel(NamedTuple):
    """The level at which a share is lost, and its 95 % interval.

    The level is None if it is beyond all levels flown, and 0 if it is below them or if more is lost without any
    mismatch; the same holds for the interval's ends.
    """

    value: float | None
    interval: tuple[float | None, float | None]


NO_LEVEL: Final = LossLevel(0.0, (0.0, 0.0))  # more is lost without any mismatch


def loss_level(without: Flown, flown: list[Flown], share: float = 0.05) -> LossLevel:
    """Return the level at which that share of the flights is lost, from flights without mismatch and at levels > 0."""
    level = np.array([row.level for row in flown])
    low, high = level.min() / BEYOND, level.max() * BEYOND
    at = np.geomspace(low, high, POINTS)
    profile = log_likelihood(without, flown, at, SLOPES, share).max(axis=(1, 2))
    best, inside = int(profile.argmax()), np.flatnonzero(2.0 * (profile.max() - profile) <= WITHIN)
    first, last = float(at[inside[0]]), float(at[inside[-1]])
    interval = (first if first >= level.min() / 2.0 else 0.0, last if last <= level.max() else None)
    if at[best] > level.max() or not any(row.lost for row in flown):
        return LossLevel(None, interval)
    return LossLevel(float(at[best]) if at[best] >= level.min() / 2.0 else 0.0, interval)


def log_likelihood(without: Flown, flown: list[Flown], at: np.ndarray, slopes: np.ndarray, share: float) -> np.ndarray:
    """Return the log-likelihood, up to a constant, at all v* (n), pairs of F and p_0 (8), and b (m): (n, 8, m).

    The flights are `without` the mismatch and `flown` at levels above 0. `at` are the v*, slopes the b; P(v*) = share.
    """
    level, flights, lost = (np.array(column, dtype=float) for column in zip(*flown, strict=True))
    total = binomial(loss_chance(level, at, slopes, share), flights, lost).sum(axis=-1)
    start = binomial(np.tile(share * FRACTIONS, 2), without.flights, without.lost)
    return np.asarray(total + start[:, np.newaxis])


def loss_chance(level: np.ndarray, at: np.ndarray, slopes: np.ndarray, share: float) -> np.ndarray:
    """Return P at the levels (k) for the curves of all v* (n), pairs of F and p_0 (8), and b (m): (n, 8, m, k)."""
    p_0 = share * FRACTIONS
    excess = (share - p_0) / (1.0 - p_0)  # F at v*
    above = slopes[:, None] * np.log(level / at[:, None, None, None])
    odds = np.exp(np.clip(np.log(excess / (1.0 - excess))[:, None, None] + above, -_LARGE, _LARGE))
    hazard = np.exp(np.clip(np.log(-np.log1p(-excess))[:, None, None] + above, -_LARGE, _LARGE))
    F = np.concatenate((odds / (1.0 + odds), -np.expm1(-hazard)), axis=1)
    start = np.tile(p_0, 2)[:, None, None]
    return np.asarray(start + (1.0 - start) * F)


def binomial(P: np.ndarray, flights: np.ndarray | int, lost: np.ndarray | int) -> np.ndarray:
    """Return the binomial log-likelihood up to a constant; 0 ln 0 is 0."""
    tiny = 1e-12
    P = np.clip(P, tiny, 1.0 - tiny)
    return np.asarray(lost * np.log(P) + (flights - lost) * np.log1p(-P))


BATCH: Final = 5  # flights in a batch
WIDE: Final = 2.0  # ratio of an interval's ends at which the search stops
LEAST: Final = 1.0 / 32.0  # lowest level that is flown, as a multiple of the careful value
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
    """Return the level of a ladder for the next batch, in the search for the level at which the share is lost.

    `without` are the flights without the mismatch, `flown` those at levels above 0, none at first.
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
    """Return whether more than a share of all flights is lost, given the flights flown and lost; None if undecided.

    It is Wald's sequential probability ratio test, which ends as soon as the flights decide (Sequential tests of
    statistical hypotheses, Annals of Mathematical Statistics 16, 1945, 117-186). With n flights of which l are lost,
    and p_0 = share / APART < p_1 = share ABOVE, between which no decision is needed,

        L = l ln(p_1 / p_0) + (n - l) ln((1 - p_1) / (1 - p_0)),

    the share is decided to be the larger where L >= ln((1 - e) / e) and the smaller where L <= -ln((1 - e) / e). For a
    true share of p_1 or more, or of p_0 or less, the decision is wrong with a probability of at most e / (1 - e).
    """
    p_0, p_1 = share / APART, share * ABOVE
    ratio = lost * log(p_1 / p_0) + (flights - lost) * log((1.0 - p_1) / (1.0 - p_0))
    bound = log((1.0 - ERROR) / ERROR)
    return True if ratio >= bound else False if ratio <= -bound else None
