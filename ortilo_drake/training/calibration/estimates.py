"""Estimates of the tables of a camera calibration from sightings.

A table is piecewise linear between knots, so it is linear in its values r at the knots. With W the shares of the knots
(hat functions), y the observations and a prior r_0 that counts as k further observations at each knot, the best r
solves

    (W^T W + k I) r = W^T y + k r_0.
"""

import numpy as np
from scipy.optimize import brentq
from scipy.special import ndtri

SHARES = np.array([0.0, 0.15, 0.3, 0.5, 0.7, 0.85, 0.95, 1.0])  # knots of the tables over a landmark's share in view
PRIOR = 10.0  # observations that the prior counts as; it decides where nothing was observed

NODES, WEIGHTS = np.polynomial.legendre.leggauss(12)


def knot_shares(knots: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Return W (n, k), the share of each knot in the value at each place; constant beyond the last knots."""
    return np.column_stack([np.interp(at, knots, column) for column in np.eye(len(knots))])


def fit_table(
    knots: np.ndarray, at: np.ndarray, y: np.ndarray, prior: np.ndarray, strength: float, gain: np.ndarray | None = None
) -> np.ndarray:
    """Return the table's values r at its knots (k) so that gain r(at) is nearest to y.

    The observations y (n) are at places `at` (n), where the table's factor, 1 by default, is known (n); the prior r_0
    (k) counts as so many observations, its strength, at each knot.
    """
    W = knot_shares(knots, at)
    if gain is not None:
        W = W * gain[:, np.newaxis]
    return np.linalg.solve(W.T @ W + strength * np.eye(len(knots)), W.T @ y + strength * prior)


def slow_correlation(lag: np.ndarray) -> np.ndarray:
    """Return the correlation of the slow noise of projected_camera.py at a lag, in spacings of its nodes.

    It depends on the place between two nodes; this is its mean over all places.
    """
    a = (np.arange(200) + 0.5) / 200
    later = a + np.asarray(lag, dtype=float)[..., np.newaxis]
    whole = np.floor(later)
    b = later - whole
    product = np.where(whole == 0, (1 - a) * (1 - b) + a * b, np.where(whole == 1, a * (1 - b), 0.0))
    return np.mean(product / np.sqrt(((1 - a) ** 2 + a**2) * ((1 - b) ** 2 + b**2)), axis=-1)


def fit_slow(lags: np.ndarray, correlation: np.ndarray, weight: np.ndarray) -> tuple[float, float]:
    """Return the slow part's share and spacing whose correlation share * slow_correlation(lag / spacing) fits best.

    The correlation (k), each of a weight (k), is measured at lags above 0 (k); the spacing is in their unit.
    """
    best = (np.inf, 0.0, float(lags[0]))
    for spacing in np.geomspace(lags[0], 2.0 * lags[-1], 60):
        shape = slow_correlation(lags / spacing)
        share = float(np.clip(np.sum(weight * shape * correlation) / np.sum(weight * shape**2), 0.0, 1.0))
        misfit = float(np.sum(weight * (correlation - share * shape) ** 2))
        if misfit < best[0]:
            best = (misfit, share, float(spacing))
    return best[1], best[2]


def both_below(p: np.ndarray, q: np.ndarray, rho: float) -> np.ndarray:
    """Return the chance that two standard normals of correlation rho lie below their quantiles of p and q.

    d Phi_2 / d rho is the joint density (Plackett, 1954), here integrated by Gauss-Legendre quadrature.
    """
    h, k = ndtri(p)[:, np.newaxis], ndtri(q)[:, np.newaxis]
    r = 0.5 * rho * (NODES + 1.0)
    density = np.exp(-(h**2 - 2.0 * r * h * k + k**2) / (2.0 * (1.0 - r**2))) / (2.0 * np.pi * np.sqrt(1.0 - r**2))
    return p * q + 0.5 * rho * density @ WEIGHTS


def latent_correlation(p: np.ndarray, q: np.ndarray, both: int) -> float:
    """Return the correlation of n pairs of normals, of which so many, `both`, lie below their quantiles.

    The first of each pair lies below its quantile with the chance p (n), the second with q (n), within (0, 1).
    """

    def surplus(rho: float) -> float:
        return float(np.sum(both_below(p, q, rho))) - both

    if surplus(0.0) >= 0.0:
        return 0.0
    return float(brentq(surplus, 0.0, 0.995)) if surplus(0.995) > 0.0 else 0.995


def normal_scores(values: np.ndarray) -> np.ndarray:
    """Return the standard normal quantiles that belong to the ranks of values (n)."""
    return ndtri((np.argsort(np.argsort(values)) + 0.5) / len(values))
