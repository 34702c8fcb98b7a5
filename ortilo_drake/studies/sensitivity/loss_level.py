"""The level of a mismatch at which a share of the flights is lost, from flights at several levels.

The chance of losing a flight is taken to rise with the level v > 0 by a logistic curve in its logarithm,

    P(v) = p_0 + (1 - p_0) / (1 + exp(-(a + b ln v))),   b > 0,

p_0 the chance without any mismatch. The level v* with P(v*) = share is found by maximum likelihood, its 95 % interval
by the profile likelihood: where twice the log-likelihood is within 3.84 of its greatest, the best p_0 and b at each v*.
"""

from typing import Final, NamedTuple

import numpy as np

WITHIN: Final = 3.84  # 95 % quantile of chi-square with one degree of freedom
SLOPES: Final = np.geomspace(1.0, 40.0, 60)  # b; at 40 half a percent of the flights become all within 30 % of v
BEYOND: Final = 10.0  # how far beyond the levels flown v* is looked for, as a factor
POINTS: Final = 800  # values of v* that are tried


class Flown(NamedTuple):
    """Flights at one level, and how many of them were lost."""

    level: float
    flights: int
    lost: int


class LossLevel(NamedTuple):
    """The level at which a share is lost.

    Attributes:
        value: None if it is beyond all levels flown; 0 if more is lost without any mismatch.
        interval: its 95 % interval; None at an end that is beyond all levels flown.
    """

    value: float | None
    interval: tuple[float | None, float | None]


def loss_level(without: Flown, flown: list[Flown], share: float = 0.05) -> LossLevel:
    """Return the level at which that share of the flights is lost.

    Args:
        without: the flights without the mismatch; its level is not read.
        flown: the flights at levels above 0.
        share: of the flights.
    """
    level, flights, lost = (np.array(column, dtype=float) for column in zip(*flown, strict=True))
    low, high = level.min() / BEYOND, level.max() * BEYOND
    at = np.geomspace(low, high, POINTS)
    p_0 = share * np.array([0.0, 0.3, 0.6, 0.9])
    excess = (share - p_0) / (1.0 - p_0)  # of the logistic curve at v*
    a = np.log(excess / (1.0 - excess))
    # Axes: v*, p_0, b, levels.
    z = a[:, None, None] + SLOPES[:, None] * np.log(level / at[:, None, None, None])
    P = p_0[:, None, None] + (1.0 - p_0[:, None, None]) / (1.0 + np.exp(-np.clip(z, -500.0, 500.0)))
    likelihood = _log_likelihood(P, flights, lost).sum(axis=-1)
    likelihood += _log_likelihood(p_0, without.flights, without.lost)[:, None]
    profile = likelihood.max(axis=(1, 2))
    best, inside = int(profile.argmax()), np.flatnonzero(2.0 * (profile.max() - profile) <= WITHIN)
    first, last = float(at[inside[0]]), float(at[inside[-1]])
    interval = (first if first >= level.min() / 2.0 else 0.0, last if last <= level.max() else None)
    if without.lost > share * without.flights:
        return LossLevel(0.0, (0.0, interval[1]))
    value = float(at[best]) if at[best] <= level.max() and np.any(lost > 0) else None
    return LossLevel(value, interval)


def _log_likelihood(P: np.ndarray, flights: np.ndarray | int, lost: np.ndarray | int) -> np.ndarray:
    """Return the binomial log-likelihood, but for a constant; 0 ln 0 is 0."""
    tiny = 1e-12
    P = np.clip(P, tiny, 1.0 - tiny)
    return np.asarray(lost * np.log(P) + (flights - lost) * np.log1p(-P))
