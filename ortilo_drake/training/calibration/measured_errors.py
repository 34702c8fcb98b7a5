"""Measured errors of the boxes that the detector finds."""

from typing import Any

import numpy as np

from ortilo_drake.onboard.landmarks.landmark_association import BORDER
from ortilo_drake.training.calibration.estimates import PRIOR, SHARES, chances, fit_table, knot_shares, normal_scores
from ortilo_drake.training.calibration.sightings import Sightings, cut_boxes, is_whole
from ortilo_drake.world.sensors.camera_calibration import QUANTILES
from ortilo_drake.world.sensors.landmark_view import BOX, INSIDE, VISIBLE

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
        quantiles[name] = np.quantile(relative[known, j], chances(NORMALS))
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
    the size of other edges. A box whose edge is off the border counts as whole.

    Args:
        s: the sightings.
        truth: boxes cut at the border (n, 4).
        usual: mean error of an edge in clear view [px] (n, 4).
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
