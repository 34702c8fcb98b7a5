"""The Riccati recursion averaged over arrival patterns, compiled.

    g(X) = A X A^T + W - sum_p Pr(p) A X C_p^T (C_p X C_p^T + V_p)^-1 C_p X A^T

computed as A (X - sum_p Pr(p) Y_p^T Y_p) A^T + W with S_p = L_p L_p^T (Cholesky) and Y_p = L_p^-1 C_p X, symmetric to
the last bit.
"""

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.model.cholesky import forward_in_place


@register_jitable
def averaged_update(
    X: np.ndarray, C: np.ndarray, V: np.ndarray, rows: np.ndarray, probabilities: np.ndarray
) -> np.ndarray:
    """Return X - sum_p Pr(p) X C_p^T (C_p X C_p^T + V_p)^-1 C_p X; the lower half is left as in X.

    Args:
        X: covariance (n, n), symmetric.
        C: output (m, n).
        V: measurement noise (m, m).
        rows: rows of each pattern (P, m).
        probabilities: of the patterns (P).
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
    """Return A M A^T + W, exactly symmetric, of a symmetric M of which the upper half is read."""
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
