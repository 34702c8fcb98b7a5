"""Measured errors of the boxes that the detector finds, the rates at which it finds them, and how both persist."""

from typing import Any

import numpy as np
from scipy.special import ndtr

from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.landmarks.landmark_association import BORDER
from ortilo_drake.training.calibration.estimates import (
    PRIOR,
    SHARES,
    fit_slow,
    fit_table,
    knot_shares,
    latent_correlation,
    normal_scores,
)
from ortilo_drake.training.calibration.sightings import Sightings, cut_boxes, is_whole
from ortilo_drake.world.sensors.camera_calibration import OTHER, QUANTILES
from ortilo_drake.world.sensors.landmark_view import BOX, DISTANCE, INSIDE, LANDMARK, VISIBLE

SIZES = np.array([5.0, 10.0, 20.0, 40.0, 80.0, 160.0])  # [px]
NORMALS = np.array([-3.0, -2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0, 3.0])


def box_errors(s: Sightings, size: tuple[int, int]) -> tuple[dict[str, Any], np.ndarray]:
    """Return the fields of BoxErrors, and normal scores of the errors (n, 4), NaN where none is known.

    Only boxes that the border does not cut are used.
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
    """Return the mean error of an edge [px] of boxes with these widths and heights (n, 2).

    It is half the extent's error and the centre's error, added as if they were normal.
    """
    center, extent = (np.column_stack([np.interp(side, SIZES, mean) for side in sides.T]) for mean in means)
    return np.hypot(center, 0.5 * extent)


def cut_errors(s: Sightings, truth: np.ndarray, usual: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the growth of errors on landmarks that the border cuts, and the factors of edges at the border.

    Both are tables over SHARES. With the factors, edges move off the border as often as in the sightings, by errors of
    the size of other edges. A box whose edge is off the border counts as whole. The truth are boxes cut at the border
    (n, 4), the usual error is the mean of an edge in clear view [px] (n, 4).
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


DISTANCES = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 12.0, 14.0, 17.0])  # [m]


def detection_rates(s: Sightings, classes: tuple[str, ...]) -> tuple[dict[str, Any], np.ndarray]:
    """Return the fields of Found, and the probability they give each sighting (n).

    The prior of a class's rates are the rates of all classes, and their prior is a line from 1 at 4 m to 0 at 24 m. The
    factors of the shares are fitted to what the rates of landmarks in clear view leave unexplained; their prior is the
    share itself.
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


LAGS = np.array([1, 2, 3, 5, 8, 12, 20, 30, 50])  # pictures
UNSURE = 0.02, 0.98  # range of rates in which misses count; beyond it the error of the rate itself decides


def pairs_at_lag(s: Sightings, lag: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the indices of pairs of sightings of the same landmark that are lag pictures apart."""
    landmarks = int(s.view[:, LANDMARK].max()) + 1
    key = s.picture * landmarks + s.view[:, LANDMARK].astype(int)
    later = np.searchsorted(key, key + lag * landmarks)  # views are in the map's order, so keys rise
    there = np.minimum(later, len(key) - 1)
    same = (key[there] == key + lag * landmarks) & (s.flight[there] == s.flight)
    return np.flatnonzero(same), there[same]


def persistence(s: Sightings, rate: np.ndarray, scores: np.ndarray, interval: float) -> dict[str, Any]:
    """Return the fields slow_errors and slow_misses, of pictures an interval [s] apart.

    Each sighting is expected with a rate (n), and has normal scores of its errors, NaN where none is known (n, 4).
    InputError if no landmark was found in enough pictures one after another.
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
        weights.append(1.0 / lag)  # the lags are spaced about evenly in their logarithm
    if not lags:
        raise InputError("seeds: too few landmarks found one picture after another: fly more")
    slow = {}
    for name, correlation in (("slow_errors", errors), ("slow_misses", misses)):
        share, spacing = fit_slow(np.array(lags), np.array(correlation), np.array(weights))
        slow[name] = {"share": share, "period": spacing * interval}
    return slow
