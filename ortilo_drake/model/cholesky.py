"""Linear equations of small positive definite matrices, in place, for compiled loops: S = L L^T (Cholesky)."""

import numpy as np
from numba.extending import register_jitable


@register_jitable(error_model="numpy")
def forward_in_place(S: np.ndarray, Y: np.ndarray, size: int) -> None:
    """Overwrite the first `size` rows of Y by L^-1 Y; L overwrites S's lower half.

    Both become NaN if S is not positive definite.
    """
    n = Y.shape[1]
    for i in range(size):
        for j in range(i):
            s = S[i, j]
            for k in range(j):
                s -= S[i, k] * S[j, k]
            s /= S[j, j]
            S[i, j] = s
            S[i, i] -= s * s
            for c in range(n):
                Y[i, c] -= s * Y[j, c]
        S[i, i] = np.sqrt(S[i, i])
        root = 1.0 / S[i, i]
        for c in range(n):
            Y[i, c] *= root


@register_jitable(error_model="numpy")
def solve_in_place(S: np.ndarray, X: np.ndarray) -> None:
    """Overwrite X (m, n) by S^-1 X; L overwrites S's lower half."""
    m, n = X.shape
    forward_in_place(S, X, m)
    for i in range(m - 1, -1, -1):
        for k in range(i + 1, m):
            for c in range(n):
                X[i, c] -= S[k, i] * X[k, c]
        for c in range(n):
            X[i, c] /= S[i, i]


@register_jitable(error_model="numpy")
def squared_norm_in_place(S: np.ndarray, e: np.ndarray) -> float:
    """Return e^T S^-1 e = |L^-1 e|^2 of e (n); L overwrites S's lower half and L^-1 e overwrites e.

    NaN if S is not positive definite. The operations are those of forward_in_place.
    """
    squared = 0.0
    for i in range(e.size):
        for j in range(i):
            s = S[i, j]
            for k in range(j):
                s -= S[i, k] * S[j, k]
            s /= S[j, j]
            S[i, j] = s
            S[i, i] -= s * s
            e[i] -= s * e[j]
        S[i, i] = np.sqrt(S[i, i])
        root = 1.0 / S[i, i]
        e[i] *= root
        squared += e[i] * e[i]
    return squared
