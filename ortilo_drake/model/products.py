"""Products of small matrices, summed in a fixed order: BLAS's order and instructions depend on the processor."""

import numpy as np
from numba.extending import register_jitable


@register_jitable
def times(A: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the product A b (m) of a matrix A (m, n) and a vector b (n)."""
    c = np.zeros(A.shape[0])
    for i in range(A.shape[0]):
        for k in range(A.shape[1]):
            c[i] += A[i, k] * b[k]
    return c


@register_jitable
def product(A: np.ndarray, B: np.ndarray) -> np.ndarray:
    """Return the product A B (m, l) of two matrices A (m, n) and B (n, l)."""
    C = np.zeros((A.shape[0], B.shape[1]))
    for i in range(A.shape[0]):
        for j in range(B.shape[1]):
            for k in range(A.shape[1]):
                C[i, j] += A[i, k] * B[k, j]
    return C
