"""Rows of the filter on recorded events: each an innovation with its gradient.

A function writes to a blank row and returns the innovation, and the number of entries where that is not always the
same. x is the nominal state, R the body's attitude (3, 3), lever l the antenna in body axes (3).
"""

from typing import NamedTuple

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.onboard.estimator.tight.floor_rows import finder_row, flow_row
from ortilo_drake.onboard.estimator.tight.inertial import matrix_of
from ortilo_drake.onboard.estimator.tight.layout import THETA, P, Q, V
from ortilo_drake.onboard.estimator.tight.ranges import signed_range
from ortilo_drake.studies.recorded.filter_types import BIASES, ENTRIES, Aids, Noise, nominal

NEAREST, LARGEST = 0.02, 10.0  # no antenna is nearer to the floor than this [m], and no error grows by more
MAY = 2.0  # standard deviations by which a height may be more than is believed
nominal_at = register_jitable(nominal)


class SparseRow(NamedTuple):
    """A sparse row of H: the indices and values of its entries (16 each); and C H^T (N)."""

    where: np.ndarray
    of: np.ndarray
    PHt: np.ndarray


@register_jitable
def row_of(N: int) -> SparseRow:
    """Return a blank row for N error states."""
    return SparseRow(np.zeros(ENTRIES, np.int64), np.zeros(ENTRIES), np.empty(N))


@register_jitable
def wipe(row: SparseRow) -> None:
    """Make a row blank."""
    row.where[:], row.of[:] = 0, 0.0


@register_jitable
def state_row(at: int, row: SparseRow) -> None:
    """Write the row of one error state."""
    row.where[0], row.of[0] = at, 1.0


@register_jitable
def distance_row(
    x: np.ndarray,
    R: np.ndarray,
    lever: np.ndarray,
    anchors: np.ndarray,
    b: int,
    a: int,
    measured: float,
    row: SparseRow,
) -> tuple[float, int]:
    """Write the row of a range to anchor b, or of its difference to that to a, and return innovation and entries."""
    for i in range(3):
        row.where[i], row.where[3 + i] = P + i, THETA + i
    p, slow = x[P : P + 3], BIASES + len(anchors)
    r_b, m = signed_range(x, p, R, lever, anchors, b, 1.0, BIASES, slow, 6, row.where, row.of)
    if a < 0:
        return measured - r_b, m
    r_a, m = signed_range(x, p, R, lever, anchors, a, -1.0, BIASES, slow, m, row.where, row.of)
    return measured - r_b + r_a, m


@register_jitable
def height_row(x: np.ndarray, R: np.ndarray, lever: np.ndarray, height: float, row: SparseRow) -> float:
    """Write the row of the antenna's height, of four entries, and return its innovation."""
    state_row(P + 2, row)
    e = height - x[P + 2]
    for i in range(3):
        a, b = (i + 1) % 3, (i + 2) % 3
        row.where[1 + i], row.of[1 + i] = THETA + i, lever[a] * R[2, b] - lever[b] * R[2, a]
        e -= R[2, i] * lever[i]
    return e


@register_jitable
def distance_down_row(x: np.ndarray, R: np.ndarray, measured: float, aids: Aids, row: SparseRow) -> float:
    """Write the row of the range finder, of four entries, and return its innovation."""
    return measured - finder_row(x[P : P + 3], R, aids.finder, aids.floor, row.where, row.of)


@register_jitable
def pixels_row(
    axis: int,
    x: np.ndarray,
    R: np.ndarray,
    rates: np.ndarray,
    measured: float,
    scale_at: int,
    aids: Aids,
    row: SparseRow,
) -> float:
    """Write the row of the flow along an axis, of nine entries, and return its innovation.

    Args:
        axis: 0 or 1.
        x: nominal state.
        R: attitude.
        rates: body rates as measured (3).
        measured: [px].
        scale_at: where the error of the scale stands in the error state.
        aids: numbers of the flow.
        row: written to.
    """
    w = rates - x[Q + 4 : Q + 7]
    p, v, scale = x[P : P + 3], x[V : V + 3], x[nominal_at(scale_at)]
    return measured - flow_row(axis, p, v, R, w, aids.floor, aids.pixels, scale, scale_at, row.where, row.of)


@register_jitable
def held_back(S: float, deviation: float) -> float:
    """Return the noise of a row that brings its variance S down to deviation², and no further.

    What is known of a height is known once: taken at every epoch as if it were new, it would soon be believed to death.
    """
    return 1.0 / (1.0 / deviation**2 - 1.0 / S)


@register_jitable
def grown_at(x: np.ndarray, variance: float, lever: np.ndarray, noise: Noise, aids: Aids) -> float:
    """Return the extra error of ranges near the floor, at most LARGEST: a lost filter must still accept some.

    It is that at the height that the antenna may have, given its variance: a filter that is too low by mistake would
    else believe in no range that tells it so.
    """
    if noise.near_floor == 0.0:
        return 1.0
    down = matrix_of(x[Q : Q + 4])[2]
    z = x[P + 2] + down[0] * lever[0] + down[1] * lever[1] + down[2] * lever[2] - aids.floor
    z += MAY * np.sqrt(variance)
    return min(1.0 + (noise.near_floor / max(z, NEAREST)) ** 4, LARGEST)
