"""Autocorrelation of a filter's innovations over an ensemble of flights, and a portmanteau test of their whiteness.

The innovations of an optimal filter are independent from tick to tick (R. K. Mehra, "On the identification of variances
and adaptive Kalman filtering", IEEE Trans. Automatic Control 15, 1970). Normalised by the filter's own covariance,
z = L^-1 e with L L^T = S, each component is standard normal and

    r_l = (sum z_k z_{k+l} / N_l) / (sum z_k^2 / N_0),    N_l the pairs at lag l,

has variance 1 / N_l. The statistic of all lags together, Q = (N_0 + 2) / N_0 sum_l N_l r_l^2, is chi-square with
as many degrees as there are lags. For a single series without gaps it is the statistic of G. M. Ljung and
G. E. P. Box, "On a measure of lack of fit in time series models", Biometrika 65, 1978. The lag of measurements with
gaps is counted in two ways: in arrivals (the gaps are removed first) and in ticks (only pairs without a gap count).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2, norm


@dataclass(frozen=True)
class LagReport:
    """Autocorrelation of the ensemble for one way to count lags; r and band are None at lags without a pair.

    r has one row per lag 1 .. L, with a value per component; band is half the width of the two-sided 95 % band. Q is
    the portmanteau statistic of all components together, dof its degrees of freedom, and p_value the probability that
    white innovations give a larger Q.
    """

    r: list[list[float] | None]
    band: list[float | None]
    Q: float
    dof: int
    p_value: float


@dataclass(frozen=True)
class WhitenessReport:
    """Whiteness of a sensor's normalised innovations z; a consistent filter's z have mean 0 and variance 1."""

    samples: int
    mean: list[float]
    variance: list[float]
    lag_arrivals: LagReport
    lag_ticks: LagReport


def normalized_innovations(e: np.ndarray, S: np.ndarray) -> np.ndarray:
    """Return z_k = L_k^-1 e_k (n, m), given the innovations e (n, m), NaN where nothing arrived, and S (n, m, m)."""
    z = np.full(e.shape, np.nan)
    there = np.isfinite(e).all(axis=1)
    L = np.linalg.cholesky(S[there])
    z[there] = np.linalg.solve(L, e[there][:, :, np.newaxis])[:, :, 0]
    return z


def only_arrivals(z: np.ndarray) -> np.ndarray:
    """Return the finite rows of z, without the gaps, so that lags count arrivals."""
    return z[np.isfinite(z).all(axis=1)]


def autocorrelation(flights: Sequence[np.ndarray], lags: int) -> LagReport | None:
    """Return the autocorrelation of normalised innovations; None if there are none.

    Each flight has a series of them (n, m), NaN where nothing arrived. The mean is not removed: it is 0 in a consistent
    filter, and a bias shows at all lags.
    """
    m = flights[0].shape[1]
    sums, pairs = np.zeros((lags + 1, m)), np.zeros(lags + 1, dtype=int)
    for z in flights:
        there = np.isfinite(z).all(axis=1)
        filled = np.where(there[:, np.newaxis], z, 0.0)
        for lag in range(min(lags, len(z) - 1) + 1):
            sums[lag] += np.sum(filled[: len(z) - lag] * filled[lag:], axis=0)
            pairs[lag] += np.sum(there[: len(z) - lag] & there[lag:])
    samples = int(pairs[0])
    if not samples or not (sums[0] > 0.0).all():
        return None
    r: list[list[float] | None] = [None] * lags
    band: list[float | None] = [None] * lags
    Q, dof = 0.0, 0
    for k in np.flatnonzero(pairs[1:]):
        r_l = sums[k + 1] / pairs[k + 1] / (sums[0] / samples)
        r[k], band[k] = r_l.tolist(), float(norm.ppf(0.975) / np.sqrt(pairs[k + 1]))
        Q += (samples + 2) / samples * float(np.sum(pairs[k + 1] * r_l**2))
        dof += m
    return LagReport(r, band, Q, dof, float(chi2.sf(Q, dof)) if dof else 1.0)


def whiteness_report(flights: Sequence[np.ndarray], lags: int) -> WhitenessReport | None:
    """Return the whiteness figures of one sensor, None if it never arrived. Arguments as for autocorrelation."""
    arrived = [only_arrivals(z) for z in flights]
    z = np.concatenate(arrived)
    by_arrival, by_tick = autocorrelation(arrived, lags), autocorrelation(flights, lags)
    if by_arrival is None or by_tick is None:
        return None
    return WhitenessReport(len(z), z.mean(axis=0).tolist(), np.mean(z**2, axis=0).tolist(), by_arrival, by_tick)
