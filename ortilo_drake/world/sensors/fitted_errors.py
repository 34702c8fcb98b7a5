"""Errors of ranges as a NOISE.yaml describes them, of simulated flights and of recorded paths that are flown again.

A range from p, at the height z above the floor, to anchor i errs by

    e_i = c_i + s (g_i + f_i(p) + d v_i),   s = min(1 + (z_0 / z)^4, 10),   d = sqrt(w^2 + o^2) in an outlier, else w

c_i is a constant, g_i first-order Gauss-Markov noise (slow_error.py), f_i a field in space (matern_field.py) and v_i
standard normal. Outliers are a two-state chain along the rows of an anchor: they begin with probability q / ((1 - q) b)
and end with 1 / b, so that a share q of all rows are some, b in a row on average (E. N. Gilbert, "Capacity of a
burst-noise channel", 1960). Constants and fields are the same in all flights of a day.

With a heavy tail w is that times one of six factors, drawn for each row that is no outlier (white_scales).
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numba.extending import register_jitable

from ortilo_drake.scenario.range_errors import UwbNoise, white_scales
from ortilo_drake.world.drawn_truth import AtStart
from ortilo_drake.world.noise import uniforms
from ortilo_drake.world.sensors.matern_field import FEATURES, NUMBERS, MaternField, field_of

NEAREST, LARGEST = 0.02, 10.0  # no antenna is nearer to the floor than this [m], and no error grows by more


class Day(NamedTuple):
    """Errors that are the same in all flights of a day: each anchor's constant (n) [m], and its field, if any."""

    constants: np.ndarray
    fields: tuple[MaternField, ...]


def draw_day(noise: UwbNoise, n: int, draw: AtStart) -> Day:
    """Return a day drawn; constants that the noise has, n then, are these."""
    drawn, field, size = noise.constants_sd * draw("fitted/constants", n), noise.field, NUMBERS * FEATURES
    constants = drawn if noise.constants is None else np.array(noise.constants)
    if field is None:
        return Day(constants, ())
    its = [draw(f"fitted/field/{i}", size) for i in range(n)]
    return Day(constants, tuple(field_of(normals, field.length, field.sd) for normals in its))


def share_of_pairs(share: float) -> float:
    """Return the share of differences of two ranges that are outliers, of that of ranges."""
    return 1.0 - (1.0 - share) ** 2


def outlier_chain(share: float, burst: float) -> tuple[float, float]:
    """Return with which probability outliers begin and end from a row of an anchor to its next."""
    return share / ((1.0 - share) * burst), 1.0 / burst


@register_jitable
def odd_after(odd: bool, u: float, begins: float, ends: float) -> bool:
    """Return whether an anchor's next row is an outlier, u uniform on [0, 1)."""
    return u >= ends if odd else u < begins


@register_jitable
def growth(height: float, near_floor: float) -> float:
    """Return s, of the height z [m] and z_0 [m]."""
    return min(1.0 + (near_floor / max(height, NEAREST)) ** 4, LARGEST)


@register_jitable
def drawn_scales(scales: np.ndarray, seed: int, stream: np.uint64, tick: int, rows: int) -> np.ndarray:
    """Return the factor of each row's white deviation, drawn of some as likely (rows)."""
    found = np.ones(rows)
    if scales.size > 1:
        chance = uniforms(seed, stream, tick, rows)
        for j in range(rows):
            found[j] = scales[int(chance[j] * scales.size)]
    return found


@register_jitable
def row_error(constant: float, own: float, s: float, white: float, far: float, v: float) -> float:
    """Return c + s (g + f + d v) of a row, far the deviation of what an outlier adds, 0 in another row [m]."""
    return constant + s * (own + np.sqrt(white * white + far * far) * v)


def largest_sd(noise: UwbNoise) -> float:
    """Return the root mean square of a row's error at worst: an outlier, beside the floor if that counts [m]."""
    lasts = [part.sd for part in (noise.lasting, noise.field) if part is not None]
    s = LARGEST if noise.near_floor > 0.0 else 1.0
    white = noise.white * white_scales(noise.freedom).max()
    constant = noise.constants_sd if noise.constants is None else max(map(abs, noise.constants), default=0.0)
    return constant + s * float(np.linalg.norm([white, noise.outliers.sd, *lasts]))


@njit(cache=True)
def outlier_rows(anchor: np.ndarray, odd: np.ndarray, u: np.ndarray, begins: float, ends: float) -> np.ndarray:
    """Return a mask (m) of the outlier rows, of the anchor of each row and of uniform numbers u on [0, 1) (m).

    `odd` is whether the row before the first of each anchor was one (n), and changed; begins and ends are those of
    outlier_chain.
    """
    found = np.empty(anchor.size, dtype=np.bool_)
    for k in range(anchor.size):
        i = anchor[k]
        odd[i] = odd_after(odd[i], u[k], begins, ends)
        found[k] = odd[i]
    return found
