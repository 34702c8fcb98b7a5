"""Scalar updates of the tight filter: gate, weight, correct, one row of H at a time.

A row is given sparsely: where it is not 0, and what it is there. With S = H C H^T + r and the innovation e,

    K = C H^T / S,  error <- K e,  C <- C - K S K^T,

and the error goes into the nominal state at once, so that the next row is linearised there. Rows of one measurement
whose noises are independent may be taken one after the other (Anderson and Moore, "Optimal Filtering", 1979).

A gate refuses e^2 / S above a quantile of chi-square. Huber's weight leaves the noise r of an innovation e as it is
within c standard deviations sqrt(S) and takes r |e| / (c sqrt(S)) beyond (Huber, "Robust Statistics", 1981).
"""

import numpy as np
from numba import njit
from numba.extending import register_jitable

from ortilo_drake.onboard.estimator.tight.inertial import turned
from ortilo_drake.onboard.estimator.tight.layout import ADDITIVE, GYRO, THETA, Q


@register_jitable
def inject(x: np.ndarray, error: np.ndarray, core: int) -> None:
    """Add an error state (n) to the nominal state, clones included."""
    for i in range(THETA):
        x[i] += error[i]
    x[Q : Q + 4] = turned(x[Q : Q + 4].copy(), error[THETA], error[THETA + 1], error[THETA + 2])
    for i in range(GYRO, core):
        x[ADDITIVE + i - GYRO] += error[i]
    for c in range((error.size - core) // 6):
        at, e = core + 1 + 7 * c, core + 6 * c
        for i in range(3):
            x[at + i] += error[e + i]
        x[at + 3 : at + 7] = turned(x[at + 3 : at + 7].copy(), error[e + 3], error[e + 4], error[e + 5])


@njit(cache=True)
def innovation_variance(C: np.ndarray, where: np.ndarray, row: np.ndarray, m: int, PHt: np.ndarray) -> float:
    """Return H C H^T of a row, and write C H^T to PHt (n).

    Args:
        C: covariance (n, n).
        where: indices of the row's entries.
        row: the entries.
        m: how many of them count.
        PHt: written to.
    """
    for i in range(C.shape[0]):
        total = 0.0
        for k in range(m):
            total += C[where[k], i] * row[k]
        PHt[i] = total
    S = 0.0
    for k in range(m):
        S += row[k] * PHt[where[k]]
    return S


@njit(cache=True)
def correct(x: np.ndarray, C: np.ndarray, PHt: np.ndarray, S: float, e: float, core: int) -> None:
    """Correct nominal state and covariance by an innovation e of variance S.

    Args:
        x: nominal state; changed.
        C: covariance (n, n); changed.
        PHt: C H^T (n).
        S: H C H^T + r.
        e: innovation.
        core: numbers of the error state without clones.
    """
    n, s = C.shape[0], 1.0 / S
    for i in range(n):
        k = PHt[i] * s
        for j in range(n):
            C[i, j] -= k * PHt[j]
    inject(x, (e * s) * PHt, core)


@njit(cache=True)
def update(
    x: np.ndarray,
    C: np.ndarray,
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
    """Take one row; return e^2 / S, negative if the gate refused it.

    Args:
        x: nominal state; changed.
        C: covariance (n, n); changed.
        where: indices of the row's entries.
        row: the entries.
        m: how many of them count.
        e: innovation.
        r: variance of its noise.
        gate: largest e^2 / S.
        huber: c; inf weighs all innovations alike.
        core: numbers of the error state without clones.
        PHt: of the caller's (n).
    """
    own = innovation_variance(C, where, row, m, PHt)
    S = own + r
    squared = e * e / S
    if not squared <= gate:  # so that NaN is refused too
        return -squared
    if squared > huber * huber:
        S = own + r * np.sqrt(squared) / huber
    correct(x, C, PHt, S, e, core)
    return squared
