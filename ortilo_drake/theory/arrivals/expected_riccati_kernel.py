"""The Riccati recursion averaged over arrival patterns, compiled.

    g(X) = A X A^T + W - sum_p Pr(p) A X C_p^T (C_p X C_p^T + V_p)^-1 C_p X A^T

computed as A (X - sum_p Pr(p) Y_p^T Y_p) A^T + W with S_p = L_p L_p^T (Cholesky) and Y_p = L_p^-1 C_p X, symmetric to
the last bit.
"""

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.model.cholesky import forward_in_place


@register_jitable
def averaged_update(
    X: np.ndarray, C: np.ndarray, V: np.ndarray, rows: np.ndarray, probabilities: np.ndarray
) -> np.ndarray:
    """Return X - sum_p Pr(p) X C_p^T (C_p X C_p^T + V_p)^-1 C_p X; only its upper half is updated.

    X (n, n) is symmetric. C (m, n), V (m, m) and rows (P, m) are those of arrivals.Model, with probabilities (P).
    """
    m, n = C.shape
    CX = np.zeros((m, n))
    CXC = V.copy()
    for a in range(m):
        for i in range(n):
            if C[a, i] != 0.0:
                for j in range(n):
                    CX[a, j] += C[a, i] * X[i, j]
    for a in range(m):
        for b in range(a + 1):
            for i in range(n):
                if C[b, i] != 0.0:
                    CXC[a, b] += CX[a, i] * C[b, i]
    M = X.copy()
    S, Y = np.empty((m, m)), np.empty((m, n))
    for p in range(rows.shape[0]):
        if probabilities[p] == 0.0:
            continue
        k = 0
        for a in range(m):
            if rows[p, a]:
                Y[k] = CX[a]
                col = 0
                for b in range(a + 1):
                    if rows[p, b]:
                        S[k, col] = CXC[a, b]
                        col += 1
                k += 1
        forward_in_place(S, Y, k)
        for a in range(k):
            for i in range(n):
                y = probabilities[p] * Y[a, i]
                for j in range(i, n):
                    M[i, j] -= y * Y[a, j]
    return M


@register_jitable
def predicted(M: np.ndarray, A: np.ndarray, W: np.ndarray) -> np.ndarray:
    """Return A M A^T + W, exactly symmetric; only the upper half of the symmetric M is read."""
    n = A.shape[0]
    for i in range(n):
        for j in range(i):
            M[i, j] = M[j, i]
    AM = np.zeros((n, n))
    X = np.empty((n, n))
    for i in range(n):
        for k in range(n):
            if A[i, k] != 0.0:
                for j in range(n):
                    AM[i, j] += A[i, k] * M[k, j]
    for i in range(n):
        for j in range(i, n):
            x = W[i, j]
            for k in range(n):
                x += AM[i, k] * A[j, k]
            X[i, j] = x
            X[j, i] = x
    return X


CHECK_EVERY = 30  # iterations between checks; a multiple of the periods of sensors that send every 2nd or 3rd tick
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


@cached_njit(nogil=True)
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

    g is monotone: where it has a fixed point the iteration converges to it from every start. The slowest part of the
    error shrinks by a factor rho per iteration (0.93 with all sensors, 0.985 at a rate of 0.05), so a small last step
    alone does not mean that the fixed point is near. With d_k the largest change of iteration k relative to the
    variances, and rho = (d_k / d_{k-30})^(1/30), the change still to come is d_k rho / (1 - rho). The iteration has
    settled when this is below the tolerance, or when rounding ends the progress of d_k.

    A, C, W, V and rows are those of arrivals.Model. The start X (M, n, n) is symmetric positive semidefinite; warm
    starts are welcome. The probabilities (M, P) are those of the patterns in each mode; backward (M, M) is Pr(mode
    before = i | mode now = j), [[1]] for independent arrivals. The iteration ends after `most` steps.

    Returns:
        X (M, n, n), iterations, SETTLED or STILL_MOVING or DIVERGED, and the estimate of what was still to come.
    """
    modes = X.shape[0]
    G = np.empty_like(X)
    start = np.trace(W)
    for m in range(modes):
        start += np.trace(X[m])
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
                size += np.trace(after[m])
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
