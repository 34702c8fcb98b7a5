"""The fixed point of coupled expected Riccati equations by iteration, compiled, with a bound on the remaining error.

g is monotone. Where it has a fixed point the iteration converges to it from every start. The slowest part of the error
shrinks by a factor rho per iteration (0.93 with all sensors, 0.985 at a rate of 0.05), so a small last step alone does
not mean that the fixed point is near.
"""

import numpy as np
from numba import njit
from numba.extending import register_jitable

from ortilo_drake.theory.arrivals.expected_riccati_kernel import averaged_update, predicted

CHECK_EVERY = 30  # iterations between checks; a multiple of the phases of sensors that send every 2nd or 3rd tick
SETTLED, STILL_MOVING, DIVERGED = 0, 1, 2


@register_jitable
def largest_change(before: np.ndarray, after: np.ndarray) -> float:
    """Return max |after - before|_ij / sqrt(after_ii after_jj) over all modes (M, n, n)."""
    change = 0.0
    for m in range(after.shape[0]):
        for i in range(after.shape[1]):
            for j in range(i, after.shape[1]):
                d = abs(after[m, i, j] - before[m, i, j])
                if d > 0.0:
                    scale = np.sqrt(after[m, i, i] * after[m, j, j])
                    change = max(change, d / scale if scale > 0.0 else np.inf)
    return change


@njit(cache=True, nogil=True)
def coupled_fixed_point(
    X: np.ndarray,
    A: np.ndarray,
    C: np.ndarray,
    W: np.ndarray,
    V: np.ndarray,
    rows: np.ndarray,
    probabilities: np.ndarray,
    backward: np.ndarray,
    tolerance: float,
    most: int,
) -> tuple[np.ndarray, int, int, float]:
    """Iterate X_j <- sum_i backward[j, i] g_i(X_i) until it settles.

    With d_k the largest change of iteration k relative to the variances, and rho = (d_k / d_{k-30})^(1/30) the rate at
    which it shrinks, what is still to come is d_k rho / (1 - rho); it has settled when that is below the tolerance.

    Args:
        X: start (M, n, n), symmetric positive semidefinite; warm starts are welcome.
        A: dynamics (n, n).
        C: output (m, n).
        W: process noise (n, n).
        V: measurement noise (m, m).
        rows: rows of each pattern (P, m).
        probabilities: of the patterns in each mode (M, P).
        backward: Pr(mode before = i | mode now = j) (M, M); [[1]] for independent arrivals.
        tolerance: relative.
        most: largest number of iterations.

    Returns:
        X (M, n, n), iterations, SETTLED or STILL_MOVING or DIVERGED, and the estimate of what was still to come.
    """
    modes, n = X.shape[0], X.shape[1]
    G = np.empty_like(X)
    start = 0.0
    for i in range(n):
        start += W[i, i]
        for m in range(modes):
            start += X[m, i, i]
    earlier, to_come = np.inf, np.inf
    least, stalled = np.inf, 0
    for k in range(1, most + 1):
        for m in range(modes):
            G[m] = predicted(averaged_update(X[m], C, V, rows, probabilities[m]), A, W)
        after = np.zeros_like(X)
        for j in range(modes):
            for i in range(modes):
                if backward[j, i] != 0.0:
                    after[j] += backward[j, i] * G[i]
        if k % CHECK_EVERY == 0:
            d = largest_change(X, after)
            size = 0.0
            for m in range(modes):
                for i in range(n):
                    size += after[m, i, i]
            if not size < 1e18 * (1.0 + start):
                return after, k, DIVERGED, np.inf
            rho = (d / earlier) ** (1.0 / CHECK_EVERY) if earlier < np.inf else 1.0
            to_come = d * rho / (1.0 - rho) if rho < 1.0 else np.inf
            if d == 0.0 or to_come < tolerance:
                return after, k, SETTLED, to_come if d > 0.0 else 0.0
            stalled = 0 if d < least else stalled + 1
            if stalled == 3 and d < 0.01 * tolerance:
                return after, k, SETTLED, d
            earlier, least = d, min(d, least)
        X = after
    return X, most, STILL_MOVING, to_come
