"""Products of small matrices, summed in order: BLAS takes another order, and other instructions, on each processor."""

import numpy as np
from numba.extending import register_jitable


@register_jitable
def times(A: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return A b."""
    c = np.zeros(A.shape[0])
    for i in range(A.shape[0]):
        for k in range(A.shape[1]):
            c[i] += A[i, k] * b[k]
    return c


@register_jitable
def product(A: np.ndarray, B: np.ndarray) -> np.ndarray:
    """Return A B."""
    C = np.zeros((A.shape[0], B.shape[1]))
    for i in range(A.shape[0]):
        for j in range(B.shape[1]):
            for k in range(A.shape[1]):
                C[i, j] += A[i, k] * B[k, j]
    return C
