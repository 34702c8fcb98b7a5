"""Products of matrices of many cases side by side, compiled: the last axis of an array counts the cases."""

import numpy as np
from numba.extending import register_jitable


@register_jitable
def copy(M: np.ndarray, out: np.ndarray) -> None:
    """Write M to out, both of the same shape and contiguous."""
    x, y = M.reshape(-1), out.reshape(-1)
    for j in range(x.shape[0]):
        y[j] = x[j]


@register_jitable
def sandwich(
    D: np.ndarray, rows: np.ndarray, columns: np.ndarray, M: np.ndarray, AM: np.ndarray, MA: np.ndarray, out: np.ndarray
) -> None:
    """Write A M to AM, its transpose to MA and A M A^T to out, A = I + D.

    Args:
        D: (n, n), the same in all cases.
        rows: of D's entries that are not zero, ascending.
        columns: likewise.
        M: symmetric (n, n, B).
        AM: (n, n, B).
        MA: (n, n, B).
        out: exactly symmetric (n, n, B).
    """
    add_product(D, rows, columns, M, AM, False)
    for i in range(M.shape[0]):
        for j in range(M.shape[0]):
            for q in range(M.shape[2]):
                MA[j, i, q] = AM[i, j, q]
    add_product(D, rows, columns, MA, out, True)
    for i in range(M.shape[0]):
        for j in range(i):
            for q in range(M.shape[2]):
                out[i, j, q] = out[j, i, q]


@register_jitable
def add_product(
    D: np.ndarray, rows: np.ndarray, columns: np.ndarray, M: np.ndarray, out: np.ndarray, upper: bool
) -> None:
    """Write M + D M, or its upper half, to out (n, n, B), or all of it to out (n, B). Arguments as in sandwich."""
    e = 0
    for i in range(M.shape[0]):
        first = i if upper else 0
        y = out[i, first:].reshape(-1)
        copy(M[i, first:], y)
        while e < rows.shape[0] and rows[e] == i:  # two entries at a time, in long loops that become wide instructions
            x, a = M[columns[e], first:].reshape(-1), D[i, columns[e]]
            if e + 1 < rows.shape[0] and rows[e + 1] == i:
                z, b = M[columns[e + 1], first:].reshape(-1), D[i, columns[e + 1]]
                for j in range(y.shape[0]):
                    y[j] += a * x[j] + b * z[j]
                e += 2
            else:
                for j in range(y.shape[0]):
                    y[j] += a * x[j]
                e += 1
