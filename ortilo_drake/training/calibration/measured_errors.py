"""Measured errors of the detector's boxes, detection rates of landmarks, and the persistence of both over pictures.

A table of a camera calibration is piecewise linear between knots, so it is linear in its values r at the knots. With
the shares W of the knots (hat functions), the observations y and a prior r_0 that counts as k further observations at
each knot, the best r solves

    (W^T W + k I) r = W^T y + k r_0.
"""

from typing import Any

import numpy as np
from scipy.optimize import brentq
from scipy.special import ndtr, ndtri

from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.landmarks.landmark_association import BORDER
from ortilo_drake.training.calibration.sightings import Sightings, cut_boxes, is_whole
from ortilo_drake.world.sensors.camera_calibration import OTHER, QUANTILES
from ortilo_drake.world.sensors.landmark_view import BOX, DISTANCE, INSIDE, LANDMARK, VISIBLE

SHARES = np.array([0.0, 0.15, 0.3, 0.5, 0.7, 0.85, 0.95, 1.0])  # knots of the tables over a landmark's share in view
PRIOR = 10.0  # number of observations that the prior counts as; without observations the prior decides

NODES, WEIGHTS = np.polynomial.legendre.leggauss(12)


def knot_shares(knots: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Return W (n x k), the share of each knot in the value at each place; constant beyond the first and last knot."""
    return np.column_stack([np.interp(at, knots, column) for column in np.eye(len(knots))])


def fit_table(
    knots: np.ndarray, at: np.ndarray, y: np.ndarray, prior: np.ndarray, strength: float, gain: np.ndarray | None = None
) -> np.ndarray:
    """Return the values r of a table at its knots (k) for which gain r(at) is nearest to y in least squares.

    The observations y (n) are at places `at` (n). `gain` is a known factor of the table at each place (n), by default
    1. The prior r_0 (k) counts as `strength` observations at each knot.
    """
    W = knot_shares(knots, at)
    if gain is not None:
        W = W * gain[:, np.newaxis]
    return np.linalg.solve(W.T @ W + strength * np.eye(len(knots)), W.T @ y + strength * prior)


def slow_correlation(lag: np.ndarray) -> np.ndarray:
    """Return the correlation of projected_camera.py's slow noise at lags (k), in units of the spacing of its nodes.

    The correlation depends on the place between two nodes; this is the mean over all places.
    """
    a = (np.arange(200) + 0.5) / 200
    later = a + np.asarray(lag, dtype=float)[..., np.newaxis]
    whole = np.floor(later)
    b = later - whole
    product = np.where(whole == 0, (1 - a) * (1 - b) + a * b, np.where(whole == 1, a * (1 - b), 0.0))
    return np.mean(product / np.sqrt(((1 - a) ** 2 + a**2) * ((1 - b) ** 2 + b**2)), axis=-1)


def fit_slow(lags: np.ndarray, correlation: np.ndarray, weight: np.ndarray) -> tuple[float, float]:
    """Return the share and spacing with which share * slow_correlation(lag / spacing) fits measured correlations best.

    The correlations (k), with weights (k), are measured at lags above 0 (k). The spacing has the unit of the lags.
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
    """Return the probability that two standard normals with correlation rho lie below their quantiles of p and q (n).

    d Phi_2 / d rho is the joint density (Plackett, 1954), here integrated by Gauss-Legendre quadrature.
    """
    h, k = ndtri(p)[:, np.newaxis], ndtri(q)[:, np.newaxis]
    r = 0.5 * rho * (NODES + 1.0)
    density = np.exp(-(h**2 - 2.0 * r * h * k + k**2) / (2.0 * (1.0 - r**2))) / (2.0 * np.pi * np.sqrt(1.0 - r**2))
    return p * q + 0.5 * rho * density @ WEIGHTS


def latent_correlation(p: np.ndarray, q: np.ndarray, both: int) -> float:
    """Return the correlation of n pairs of normals, given that in `both` pairs each normal is below its quantile.

    The first normal of a pair is below its quantile with probability p (n), the second with q (n), within (0, 1). The
    correlation is limited to [0, 0.995].
    """

    def surplus(rho: float) -> float:
        return float(np.sum(both_below(p, q, rho))) - both

    if surplus(0.0) >= 0.0:
        return 0.0
    return float(brentq(surplus, 0.0, 0.995)) if surplus(0.995) > 0.0 else 0.995


def normal_scores(values: np.ndarray) -> np.ndarray:
    """Return the standard normal quantiles of the ranks of values (n)."""
    return ndtri((np.argsort(np.argsort(values)) + 0.5) / len(values))


SIZES = np.array([5.0, 10.0, 20.0, 40.0, 80.0, 160.0])  # knots of the tables over a box's side [px]
NORMALS = np.array([-3.0, -2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0, 3.0])  # knots of the quantiles [standard deviations]


def box_errors(s: Sightings, size: tuple[int, int]) -> tuple[dict[str, Any], np.ndarray]:
    """Return the fields of BoxErrors, and the normal scores of the errors (n x 4), NaN where the error is unknown.

    The errors are known for found boxes of landmarks that the border does not cut.
    """
    truth = cut_boxes(s.view[:, BOX], size)
    known = s.found & is_whole(s.view)
    e, b = np.full((len(truth), 4), np.nan), truth[:, 2:] - truth[:, :2]
    for axis in range(2):
        low, high = s.seen[:, axis] - truth[:, axis], s.seen[:, 2 + axis] - truth[:, 2 + axis]
        e[:, axis], e[:, 2 + axis] = 0.5 * (low + high), high - low
    visible, sides = s.view[known, VISIBLE], np.concatenate([b[known, 0], b[known, 1]])
    clear = np.tile(visible >= 0.95, 2)
    means, relative = [], np.full_like(e, np.nan)
    for part in (slice(0, 2), slice(2, 4)):
        size_of_error = np.abs(e[known, part]).T.ravel()
        usual = np.full(len(SIZES), np.mean(size_of_error[clear]) if clear.any() else 1.0)
        mean = fit_table(SIZES, sides[clear], size_of_error[clear], usual, PRIOR)
        means.append(np.maximum(mean, 0.02))
        for axis in range(2):
            relative[known, part.start + axis] = e[known, part.start + axis] / (
                knot_shares(SIZES, b[known, axis]) @ means[-1]
            )
    ones = np.ones(len(SHARES))
    growth = np.maximum(fit_table(SHARES, np.tile(visible, 4), np.abs(relative[known]).T.ravel(), ones, PRIOR), 0.1)
    relative[known] /= (knot_shares(SHARES, visible) @ growth)[:, np.newaxis]
    scores, quantiles = np.full_like(e, np.nan), {}
    for j, name in enumerate(QUANTILES):
        quantiles[name] = np.quantile(relative[known, j], ndtr(NORMALS))
        scores[known, j] = normal_scores(relative[known, j])
    usual = (knot_shares(SHARES, s.view[:, VISIBLE]) @ growth)[:, np.newaxis] * edge_errors(b, means)
    inside_growth, border_factor = cut_errors(s, truth, np.tile(usual, 2))
    return {
        "size": SIZES,
        "center": means[0],
        "extent": means[1],
        "visible_growth": growth,
        "inside_growth": inside_growth,
        "border_factor": border_factor,
        "normal": NORMALS,
        "quantiles": quantiles,
    }, scores


def edge_errors(sides: np.ndarray, means: list[np.ndarray]) -> np.ndarray:
    """Return the mean error of an edge [px] along each axis (n x 2), for boxes of these widths and heights (n x 2).

    The error is the root sum of squares of the centre's error and half of the extent's error.
    """
    center, extent = (np.column_stack([np.interp(side, SIZES, mean) for side in sides.T]) for mean in means)
    return np.hypot(center, 0.5 * extent)


def cut_errors(s: Sightings, truth: np.ndarray, usual: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the growth of errors on landmarks that the border cuts, and the factors of edges at the border.

    Both are tables over SHARES. With the factors, edges leave the border as often as in the sightings, if their errors
    have the size of other edges' errors. A box whose edge has left the border counts as whole. `truth` has the boxes
    cut at the border (n x 4), `usual` the mean error of each edge [px] (n x 4).
    """
    free, seen = truth == s.view[:, BOX], (s.found & ~is_whole(s.view))[:, np.newaxis]
    inward = (s.seen - truth) * np.array([1.0, 1.0, -1.0, -1.0])
    inside, ones = np.tile(s.view[:, [INSIDE]], 4), np.ones(len(SHARES))
    others, borders = free & seen, ~free & seen
    if not others.any() or not borders.any():
        return ones, ones
    growth = np.maximum(fit_table(SHARES, inside[others], np.abs(inward[others]), ones, PRIOR, usual[others]), 0.1)
    growth[-1] = 1.0
    usual = usual * (knot_shares(SHARES, s.view[:, INSIDE]) @ growth)[:, np.newaxis]
    left = (inward[borders] > BORDER).astype(float)
    leaving = np.clip(fit_table(SHARES, inside[borders], left, ones * left.mean(), PRIOR), 0.0, 0.45)
    reach = growth * np.mean(usual[borders]) / np.mean(knot_shares(SHARES, inside[borders]) @ growth)
    reach = reach * np.maximum(np.quantile(inward[others] / usual[others], 1.0 - leaving), 0.1)
    return growth, np.clip(BORDER / reach, 0.0, 1.5)


DISTANCES = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 12.0, 14.0, 17.0])  # knots of rates [m]


def detection_rates(s: Sightings, classes: tuple[str, ...]) -> tuple[dict[str, Any], np.ndarray]:
    """Return the fields of Found, and the probability of each sighting according to them (n).

    The prior of a class's rates is the rate of all classes, whose own prior falls from 1 at 4 m to 0 at 24 m. The
    factors of the shares are fitted after the rates of landmarks in clear view; the prior of a factor is the share.
    """
    distance, inside, visible = s.view[:, DISTANCE], s.view[:, INSIDE], s.view[:, VISIBLE]
    near = distance <= DISTANCES[-1]  # beyond the last knot the rate is 0
    found, clear = s.found.astype(float), (visible >= 0.95) & is_whole(s.view) & near

    def rates(chosen: np.ndarray, prior: np.ndarray) -> np.ndarray:
        return np.clip(fit_table(DISTANCES, distance[chosen], found[chosen], prior, PRIOR), 0.0, 1.0)

    falling = np.clip(1.2 - DISTANCES / 20.0, 0.0, 1.0)
    table = {OTHER: rates(clear, falling)}
    rate = np.zeros(len(found))
    for c, name in enumerate(classes):
        table[name] = rates(clear & (s.label == c), table[OTHER])
        mine = s.label == c
        rate[mine] = np.where(near[mine], knot_shares(DISTANCES, distance[mine]) @ table[name], 0.0)
    factors = []
    for at, chosen in ((visible, is_whole(s.view) & near), (inside, ~is_whole(s.view) & near)):
        factor = np.clip(fit_table(SHARES, at[chosen], found[chosen], SHARES, PRIOR, rate[chosen]), 0.0, 1.0)
        factor[-1] = 1.0
        factors.append(factor)
        rate = rate * (knot_shares(SHARES, at) @ factor)
    return {
        "distance": DISTANCES,
        "rate": table,
        "inside": SHARES,
        "inside_factor": factors[1],
        "visible": SHARES,
        "visible_factor": factors[0],
    }, rate


LAGS = np.array([1, 2, 3, 5, 8, 12, 20, 30, 50])  # lags [pictures]
UNSURE = 0.02, 0.98  # range of rates in which misses count; outside, the rate's own error would decide


def pairs_at_lag(s: Sightings, lag: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the indices of both sightings in all pairs of the same landmark that are `lag` pictures apart (m), (m)."""
    landmarks = int(s.view[:, LANDMARK].max()) + 1
    key = s.picture * landmarks + s.view[:, LANDMARK].astype(int)
    later = np.searchsorted(key, key + lag * landmarks)  # landmarks are in the map's order, so keys increase
    there = np.minimum(later, len(key) - 1)
    same = (key[there] == key + lag * landmarks) & (s.flight[there] == s.flight)
    return np.flatnonzero(same), there[same]


def persistence(s: Sightings, rate: np.ndarray, scores: np.ndarray, interval: float) -> dict[str, Any]:
    """Return the fields slow_errors and slow_misses, from pictures that are an interval [s] apart.

    `rate` is the detection probability of each sighting (n), `scores` has the normal scores of its errors (n x 4), NaN
    where the error is unknown. InputError if no landmark was found in enough successive pictures.
    """
    errors, misses, weights = [], [], []
    telling, lags = (rate > UNSURE[0]) & (rate < UNSURE[1]), []
    for lag in LAGS:
        a, b = pairs_at_lag(s, int(lag))
        product = scores[a] * scores[b]
        if np.isfinite(product).sum() < 100:
            continue
        lags.append(float(lag))
        errors.append(np.nanmean(product) / np.nanmean(scores**2))
        a, b = a[telling[a] & telling[b]], b[telling[a] & telling[b]]
        misses.append(latent_correlation(rate[a], rate[b], int(np.sum(s.found[a] & s.found[b]))))
        weights.append(1.0 / lag)  # the lags are about evenly spaced on a logarithmic scale
    if not lags:
        raise InputError("seeds: too few landmarks found one picture after another: fly more")
    slow = {}
    for name, correlation in (("slow_errors", errors), ("slow_misses", misses)):
        share, spacing = fit_slow(np.array(lags), np.array(correlation), np.array(weights))
        slow[name] = {"share": share, "period": spacing * interval}
    return slow
