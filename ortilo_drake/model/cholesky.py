"""Linear equations with small positive definite matrices S = L L^T (Cholesky), solved in place in compiled loops."""

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.compiled.cached import cached_njit


@register_jitable(error_model="numpy", _nrt=False)
def forward_in_place(S: np.ndarray, Y: np.ndarray, size: int) -> None:
    """Overwrite the first `size` rows of Y by L^-1 Y, and the lower half of S by L.

    Y and S become NaN if S is not positive definite.
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
    """Overwrite X (m, n) by S^-1 X, and the lower half of S (m, m) by L."""
    m, n = X.shape
    forward_in_place(S, X, m)
    for i in range(m - 1, -1, -1):
        for k in range(i + 1, m):
            for c in range(n):
                X[i, c] -= S[k, i] * X[k, c]
        for c in range(n):
            X[i, c] /= S[i, i]


@register_jitable(error_model="numpy", _nrt=False)
def squared_norm_in_place(S: np.ndarray, e: np.ndarray) -> float:
    """Return e^T S^-1 e = |L^-1 e|^2; overwrite e (n) by L^-1 e, and the lower half of S (n, n) by L.

    The result is NaN if S is not positive definite. The operations are the same as in forward_in_place.
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


@cached_njit
def scaled_inverse(N: np.ndarray, regular: float = 1e-12) -> tuple[bool, np.ndarray]:
    """Return whether a symmetric N >= 0 (n x n) is far enough from singular, and N^-1 (n x n).

    N is scaled to a diagonal of ones, because the unknowns may have different units. The determinant of the scaled N
    must exceed `regular`.
    """
    n = N.shape[0]
    scale, scaled = np.empty(n), np.empty((n, n))
    for i in range(n):
        if not N[i, i] > 0.0:
            return False, np.zeros((n, n))
        scale[i] = 1.0 / np.sqrt(N[i, i])
    for i in range(n):
        for j in range(n):
            scaled[i, j] = scale[i] * N[i, j] * scale[j]
    inverse = np.eye(n)
    solve_in_place(scaled, inverse)  # `scaled` now holds its own L
    determinant = 1.0
    for i in range(n):
        determinant *= scaled[i, i] ** 2
    if not determinant > regular:  # NaN if N is not positive definite
        return False, np.zeros((n, n))
    for i in range(n):
        for j in range(n):
            scaled[i, j] = scale[i] * 0.5 * (inverse[i, j] + inverse[j, i]) * scale[j]
    return True, scaled
