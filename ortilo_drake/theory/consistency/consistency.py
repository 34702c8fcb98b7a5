"""NEES and NIS of a filter over an ensemble of flights, with their bands: tests of its consistency.

A consistent filter's error e and covariance P make e^T P^-1 e chi-square with as many degrees of freedom as e has
components; the same holds for an innovation and its S = H P H^T + V. Averaged over N independent flights at one tick, N
times the mean is chi-square with N n degrees (Y. Bar-Shalom, X. R. Li, T. Kirubarajan, Estimation with Applications to
Tracking and Navigation, Wiley 2001, section 5.4). The ticks of one flight are not independent, since an error made in a
blackout lasts for seconds, so an average over time has no such band. There the means of the flights are the independent
samples, and their mean has Student's interval.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import chi2, sem, t

REGULAR = 1e-10  # least eigenvalue of a correlation matrix that counts as regular

PROBABILITY = 0.95  # of bands and intervals


@dataclass(frozen=True)
class Average:
    """The average of a normalised square (NEES or NIS) of n = `expected` degrees of freedom over the ticks of a mask.

    mean is the mean of the flights' means, over the `flights` that have a value in the mask; ratio is mean / expected.
    The interval of the mean, and consistent, whether it contains n, are None for one flight. in_band is the share of
    ticks at which the ensemble's average lies in its chi-square band; None without a tick.
    """

    expected: int
    mean: float
    interval: tuple[float, float] | None
    ratio: float
    consistent: bool | None
    flights: int
    in_band: float | None


def normalized_square(e: np.ndarray, S: np.ndarray) -> np.ndarray:
    """Return e_k^T S_k^-1 e_k (n); NaN where S_k is not regular or a value is not finite.

    e (n, m) holds errors or innovations, S (n, m, m) the filter's covariances of them. Each component is first scaled
    by its own standard deviation, so that metres and radians weigh alike.
    """
    out = np.full(len(e), np.nan)
    sd = np.sqrt(np.maximum(np.diagonal(S, axis1=1, axis2=2), 0.0))
    good = np.isfinite(e).all(axis=1) & np.isfinite(S).all(axis=(1, 2)) & (sd > 0.0).all(axis=1)
    C = S[good] / (sd[good, :, np.newaxis] * sd[good, np.newaxis, :])
    regular = np.linalg.eigvalsh(C)[:, 0] > REGULAR
    good[good] = regular
    z = (e[good] / sd[good])[:, :, np.newaxis]
    out[good] = np.sum(z * np.linalg.solve(C[regular], z), axis=(1, 2))
    return out


def average_band(dof: int, flights: int | np.ndarray) -> tuple[Any, Any]:
    """Return the 95 % band of a tick's average over N flights, chi2_{N n} / N with n = dof; arrays if N is an array."""
    tail = (1.0 - PROBABILITY) / 2.0
    return chi2.ppf(tail, dof * flights) / flights, chi2.ppf(1.0 - tail, dof * flights) / flights


def ensemble_average(flights: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Return the average over the flights at each tick, and the number of flights that have a value there.

    Each flight is a series, NaN where it has no value; the series of a lost flight is shorter.
    """
    length = max(len(series) for series in flights)
    total, count = np.zeros(length), np.zeros(length, dtype=int)
    for series in flights:
        there = np.isfinite(series)
        total[: len(series)] += np.where(there, series, 0.0)
        count[: len(series)] += there
    return np.where(count > 0, total / np.maximum(count, 1), np.nan), count


def share_in_band(flights: Sequence[np.ndarray], dof: int) -> float | None:
    """Return the share of ticks at which the ensemble's average lies in its band; None without a tick.

    Only ticks at which at least half of the flights have a number count.
    """
    average, count = ensemble_average(flights)
    enough = count >= max(1.0, len(flights) / 2.0)
    if not enough.any():
        return None
    low, high = average_band(dof, count[enough])
    return float(np.mean((average[enough] >= low) & (average[enough] <= high)))


def mean_interval(samples: np.ndarray) -> tuple[float, float] | None:
    """Return Student's 95 % interval of the mean of independent samples; None for fewer than two."""
    if len(samples) < 2:
        return None
    half = t.ppf(0.5 + PROBABILITY / 2.0, len(samples) - 1) * sem(samples)
    return float(np.mean(samples) - half), float(np.mean(samples) + half)


def nees_interval(samples: np.ndarray) -> tuple[float, float] | None:
    """Return mean_interval of NEES or NIS, with ends of at least 0, because neither statistic is negative."""
    interval = mean_interval(samples)
    return interval and (max(interval[0], 0.0), interval[1])


def time_average(flights: Sequence[np.ndarray], masks: Sequence[np.ndarray], dof: int) -> Average | None:
    """Return the Average of normalised squares, one series per flight, over each flight's mask; None without a value.

    A consistent filter's squares are chi-square with dof degrees of freedom.
    """
    masked = [np.where(mask, series, np.nan) for series, mask in zip(flights, masks, strict=True)]
    means = np.array([np.nanmean(series) for series in masked if np.isfinite(series).any()])
    if not len(means):
        return None
    interval = mean_interval(means)
    return Average(
        expected=dof,
        mean=float(np.mean(means)),
        interval=interval,
        ratio=float(np.mean(means)) / dof,
        consistent=None if interval is None else bool(interval[0] <= dof <= interval[1]),
        flights=len(means),
        in_band=share_in_band(masked, dof),
    )
