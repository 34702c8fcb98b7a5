"""Errors of ranges and differences, drawn as a NOISE.yaml describes them."""

from typing import NamedTuple

import numpy as np

from ortilo_drake.interop.recorded.range_rows import Ranges
from ortilo_drake.studies.fit.noise_file import UwbNoise
from ortilo_drake.studies.predict.matern_field import MaternField, draw_field

NEAREST, LARGEST = 0.02, 10.0  # no antenna is nearer to the floor than this [m], and no error grows by more


class Day(NamedTuple):
    """What is the same in all flights of a day: each anchor's constant (n) [m], and its field in space, if any."""

    constants: np.ndarray
    fields: tuple[MaternField, ...]


def draw_day(noise: UwbNoise, n: int, rng: np.random.Generator) -> Day:
    """Return a day drawn; constants that the noise has, n then, are these."""
    drawn = noise.constants_sd * rng.standard_normal(n)
    constants = drawn if noise.constants is None else np.array(noise.constants)
    field = noise.field
    fields = () if field is None else tuple(draw_field(rng, field.length, field.sd) for _ in range(n))
    return Day(constants, fields)


def lasting_errors(t: np.ndarray, n: int, time: float, sd: float, rng: np.random.Generator) -> np.ndarray:
    """Return Gauss-Markov errors of n anchors at rising stamps (m, n)."""
    g = sd * rng.standard_normal((len(t), n))
    keep = np.exp(-np.diff(t) / time)
    for k, a in enumerate(keep):
        g[k + 1] = a * g[k] + np.sqrt(1.0 - a * a) * g[k + 1]
    return g


def outlier_rows(anchor: np.ndarray, share: float, burst: float, rng: np.random.Generator) -> np.ndarray:
    """Return which rows are outliers (m): a two-state chain along each anchor's rows."""
    if share == 0.0:
        return np.zeros(len(anchor), dtype=bool)
    begins, draws = share / ((1.0 - share) * burst), rng.random(len(anchor))
    state = rng.random(int(anchor.max()) + 1) < share
    found = np.empty(len(anchor), dtype=bool)
    for k, i in enumerate(anchor):
        state[i] = draws[k] >= 1.0 / burst if state[i] else draws[k] < begins
        found[k] = state[i]
    return found


def draw_errors(
    ranges: Ranges, place: np.ndarray, floor: float, noise: UwbNoise, day: Day, rng: np.random.Generator
) -> np.ndarray:
    """Return the errors of ranges and differences (m) [m].

    Args:
        ranges: their stamps and anchors.
        place: of the antenna (m, 3).
        floor: its z [m].
        noise: how large.
        day: what is the same all day.
        rng: draws the rest.
    """
    n, rows = len(day.constants), np.arange(len(ranges.t))
    g = np.tile(day.constants, (len(ranges.t), 1))
    own = np.zeros_like(g)
    if noise.lasting is not None:
        own += lasting_errors(ranges.t, n, noise.lasting.time, noise.lasting.sd, rng)
    for i, field in enumerate(day.fields):
        own[:, i] += field.at(place)
    grown = np.minimum(1.0 + (noise.near_floor / np.maximum(place[:, 2] - floor, NEAREST)) ** 4, LARGEST)
    g += own * grown[:, None]
    e = g[rows, ranges.anchor] - np.where(ranges.other >= 0, g[rows, np.maximum(ranges.other, 0)], 0.0)
    odd = outlier_rows(ranges.anchor, noise.outliers.share, noise.outliers.burst, rng)
    deviation = np.where(odd, np.hypot(noise.white, noise.outliers.sd), noise.white)
    return np.asarray(e + grown * deviation * rng.standard_normal(len(rows)))
