"""Errors of recorded ranges and differences, drawn anew as world/sensors/fitted_errors.py has them.

A difference of the ranges to b and a errs by e_b - e_a. Its row has the white noise of two ranges, drawn once, and is
an outlier where one of them is: with probability 1 - (1 - q)².
"""

import numpy as np

from ortilo_drake.interop.recorded.range_rows import Ranges
from ortilo_drake.scenario.range_errors import UwbNoise
from ortilo_drake.world.drawn_truth import AtStart
from ortilo_drake.world.sensors.fitted_errors import Day, growth, outlier_chain, outlier_rows, row_error, share_of_pairs


def numbers_of(rng: np.random.Generator) -> AtStart:
    """Return the standard normal numbers that a generator draws, whatever the name of their stream."""
    return lambda name, n: rng.standard_normal(n)


def lasting_errors(t: np.ndarray, n: int, time: float, sd: float, rng: np.random.Generator) -> np.ndarray:
    """Return Gauss-Markov errors of n anchors at rising stamps (m, n)."""
    g = sd * rng.standard_normal((len(t), n))
    keep = np.exp(-np.diff(t) / time)
    for k, a in enumerate(keep):
        g[k + 1] = a * g[k] + np.sqrt(1.0 - a * a) * g[k + 1]
    return g


def draw_outliers(ranges: Ranges, noise: UwbNoise, rng: np.random.Generator) -> np.ndarray:
    """Draw a mask (m) of the rows that are outliers, by the noise of single ranges."""
    share, found = noise.outliers.share, np.zeros(len(ranges.t), dtype=bool)
    for are, its in ((ranges.other < 0, share), (ranges.other >= 0, share_of_pairs(share))):
        if its == 0.0 or not are.any():
            continue
        anchor = ranges.anchor[are]
        u, before = rng.random(len(anchor)), rng.random(int(anchor.max()) + 1) < its
        found[are] = outlier_rows(anchor, before, u, *outlier_chain(its, noise.outliers.burst))
    return found


def draw_errors(
    ranges: Ranges, place: np.ndarray, floor: float, noise: UwbNoise, day: Day, rng: np.random.Generator
) -> np.ndarray:
    """Return the errors of ranges and differences (m) [m].

    Args:
        ranges: their stamps and anchors.
        place: of the antenna (m, 3).
        floor: its z [m].
        noise: how large; of differences or of single ranges, whatever the rows are.
        day: what is the same all day.
        rng: draws the rest.
    """
    noise, n, rows = noise.of_single_ranges, len(day.constants), np.arange(len(ranges.t))
    own = np.zeros((len(rows), n))
    if noise.lasting is not None:
        own += lasting_errors(ranges.t, n, noise.lasting.time, noise.lasting.sd, rng)
    for i, field in enumerate(day.fields):
        own[:, i] += field.at(place)
    s = np.array([growth(height, noise.near_floor) for height in place[:, 2] - floor])
    far = np.where(draw_outliers(ranges, noise, rng), noise.outliers.sd, 0.0)
    is_difference, a = ranges.other >= 0, np.maximum(ranges.other, 0)
    white = noise.white * np.where(is_difference, np.sqrt(2.0), 1.0)
    constant = day.constants[ranges.anchor] - np.where(is_difference, day.constants[a], 0.0)
    lasts = own[rows, ranges.anchor] - np.where(is_difference, own[rows, a], 0.0)
    return np.asarray(row_error(constant, lasts, s, white, far, rng.standard_normal(len(rows))))
