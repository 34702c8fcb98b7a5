"""Scalar updates of the tight filter: gate, weight, correct, one row of H at a time.

A row is sparse: the indices and the values of its nonzero entries. With S = H C H^T + r and the innovation e,

    K = C H^T / S,  error <- K e,  C <- C - g g^T,  g = C H^T / sqrt(S),

and the error is added to the nominal state at once, so that the next row is linearised at the corrected state. Rows
with independent noise may be used one after the other (Anderson and Moore, "Optimal Filtering", 1979).

To update the whole of C for each row would take most of a step's time. So the filter keeps the g of each used row,
computes C H^T of the next row from C and these g, and updates C once at the end: C - sum g g^T, which equals the update
row by row up to rounding.

The gate refuses a row if e^2 / S exceeds a quantile of chi-square. Huber's weight keeps the noise variance r if |e| is
within c sqrt(S), and replaces it by r |e| / (c sqrt(S)) beyond (Huber, "Robust Statistics", 1981).
"""

from typing import NamedTuple

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.onboard.estimator.tight.inertial import turn
from ortilo_drake.onboard.estimator.tight.layout import ADDITIVE, GYRO, THETA, Q


@register_jitable
def inject(x: np.ndarray, error: np.ndarray, core: int) -> None:
    """Add an error state (n) to the nominal state and its clones."""
    for i in range(THETA):
        x[i] += error[i]
    turn(x[Q : Q + 4], error[THETA], error[THETA + 1], error[THETA + 2])
    for i in range(GYRO, core):
        x[ADDITIVE + i - GYRO] += error[i]
    for c in range((error.size - core) // 6):
        at, e = core + 1 + 7 * c, core + 6 * c
        for i in range(3):
            x[at + i] += error[e + i]
        turn(x[at + 3 : at + 7], error[e + 3], error[e + 4], error[e + 5])


class Taken(NamedTuple):
    """The used rows that `settle` has not yet subtracted from C: the covariance is C - sum g g^T."""

    g: np.ndarray
    """C H^T / sqrt(S) of each row; 0 in unused places (m, n)."""
    number: np.ndarray
    """number of rows (1)."""


_AT_ONCE = 4  # number of rows processed in one pass over C
_ALIGNED = 16  # columns right of the diagonal start at a multiple of this, so that vector loops have no remainder


@register_jitable
def none_taken(rows: int, n: int) -> Taken:
    """Return an empty Taken with room for `rows` rows of n numbers."""
    return Taken(np.zeros((rows + (-rows) % _AT_ONCE, n)), np.zeros(1, np.int64))


@register_jitable
def keep_row(taken: Taken, PHt: np.ndarray, S: float) -> None:
    """Append g = C H^T / sqrt(S) of a used row to `taken`, given C H^T (n) and S."""
    g, s = taken.g[taken.number[0]], 1.0 / np.sqrt(S)
    for i in range(PHt.size):
        g[i] = PHt[i] * s
    taken.number[0] += 1


@cached_njit
def settle(C: np.ndarray, taken: Taken) -> None:
    """Subtract the rows in `taken` from the covariance, C <- C - sum g g^T, symmetric, and empty `taken`."""
    n, count = C.shape[0], taken.number[0]
    if count == 0:
        return
    even = n - n % 2
    for i in range(0, even, 2):  # two rows of C at once, so that each number of g is read once for both
        at = i // _ALIGNED * _ALIGNED
        C_0, C_1 = C[i, at:], C[i + 1, at:]
        for k in range(0, count, _AT_ONCE):
            g = taken.g[k : k + _AT_ONCE, i : i + 2]
            g_0, g_1, g_2, g_3 = taken.g[k, at:], taken.g[k + 1, at:], taken.g[k + 2, at:], taken.g[k + 3, at:]
            a_0, a_1, a_2, a_3 = g[0, 0], g[1, 0], g[2, 0], g[3, 0]
            b_0, b_1, b_2, b_3 = g[0, 1], g[1, 1], g[2, 1], g[3, 1]
            for j in range(C_0.size):
                C_0[j] -= a_0 * g_0[j] + a_1 * g_1[j] + a_2 * g_2[j] + a_3 * g_3[j]
                C_1[j] -= b_0 * g_0[j] + b_1 * g_1[j] + b_2 * g_2[j] + b_3 * g_3[j]
    if even < n:
        for k in range(count):
            C[even, even] -= taken.g[k, even] ** 2
    for i in range(n):
        for j in range(i):
            C[i, j] = C[j, i]
    taken.g[:count] = 0.0
    taken.number[0] = 0


@cached_njit
def innovation_variance(
    C: np.ndarray, taken: Taken, where: np.ndarray, row: np.ndarray, m: int, PHt: np.ndarray
) -> float:
    """Return H C H^T of a row and write C H^T to PHt (n), both with C - sum g g^T for C; arguments as in update."""
    n = C.shape[0]
    PHt[:] = 0.0
    for k in range(m):
        if row[k] != 0.0:
            column, of = C[where[k]], row[k]
            for i in range(n):
                PHt[i] += column[i] * of
    for b in range(0, taken.number[0], _AT_ONCE):
        g_0, g_1, g_2, g_3 = taken.g[b], taken.g[b + 1], taken.g[b + 2], taken.g[b + 3]
        s_0 = s_1 = s_2 = s_3 = 0.0
        for k in range(m):
            s_0 += row[k] * g_0[where[k]]
            s_1 += row[k] * g_1[where[k]]
            s_2 += row[k] * g_2[where[k]]
            s_3 += row[k] * g_3[where[k]]
        for i in range(n):
            PHt[i] -= s_0 * g_0[i] + s_1 * g_1[i] + s_2 * g_2[i] + s_3 * g_3[i]
    S = 0.0
    for k in range(m):
        S += row[k] * PHt[where[k]]
    return S


@cached_njit
def correct(x: np.ndarray, taken: Taken, PHt: np.ndarray, S: float, e: float, core: int) -> None:
    """Correct the nominal state by an innovation e of variance S = H C H^T + r, and append the row to `taken`.

    PHt is C H^T (n) and is replaced by the error C H^T e / S. Other arguments as in update.
    """
    keep_row(taken, PHt, S)
    for i in range(PHt.size):
        PHt[i] *= e / S
    inject(x, PHt, core)


@cached_njit
def update(
    x: np.ndarray,
    C: np.ndarray,
    taken: Taken,
    where: np.ndarray,
    row: np.ndarray,
    m: int,
    e: float,
    r: float,
    gate: float,
    huber: float,
    core: int,
    PHt: np.ndarray,
) -> float:
    """Update with one row; return e^2 / S, or -e^2 / S if the row was refused because e^2 / S exceeds the gate.

    `where` holds the indices and `row` the values of the row's m entries; e is the innovation, r the noise variance.
    `huber` is c, inf for no weighting; `core` is the size of the error state without clones; PHt is work memory (n).
    """
    own = innovation_variance(C, taken, where, row, m, PHt)
    S = own + r
    squared = e * e / S
    if not squared <= gate:  # so that NaN is refused too
        return -squared
    if squared > huber * huber:
        S = own + r * np.sqrt(squared) / huber
    correct(x, taken, PHt, S, e, core)
    return squared
