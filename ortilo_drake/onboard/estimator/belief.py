"""The belief of the filter, [xhat, P row by row], and its parts.

A filter of xbar = [x; e; i], e the states between (extra_states.py), shows the others what it has of [x; i].
"""

import numpy as np
from numba import njit
from numba.extending import register_jitable

from ortilo_drake.model.signals import N_I, N_X, N_XBAR


@register_jitable
def put_known_part(out: np.ndarray, belief: np.ndarray, n: int) -> None:
    """Write [xhat, P row by row] of [x; i] alone to out (240), from that of [x; e; i] (n + n^2)."""
    for i in range(N_XBAR):
        row = i if i < N_X else n - N_XBAR + i
        out[i] = belief[row]
        for j in range(N_XBAR):
            out[N_XBAR * (i + 1) + j] = belief[n * (row + 1) + (j if j < N_X else n - N_XBAR + j)]


@njit(cache=True)
def known_part(belief: np.ndarray, n: int) -> np.ndarray:
    """Return [xhat, P row by row] (240) of [x; i] alone from that of [x; e; i] (n + n^2)."""
    out = np.empty(N_XBAR + N_XBAR * N_XBAR, belief.dtype)
    put_known_part(out, belief, n)
    return out


@njit(cache=True)
def extra_part(belief: np.ndarray, n: int) -> np.ndarray:
    """Return [e_hat, standard deviations] (2 e) of the states between x and i, from [x; e; i] (n + n^2)."""
    e = n - N_XBAR
    out = np.empty(2 * e, belief.dtype)
    for i in range(e):
        out[i] = belief[N_X + i]
        out[e + i] = np.sqrt(belief[n + (n + 1) * (N_X + i)])
    return out


def diagonal_of_P(belief: np.ndarray, n: int) -> np.ndarray:
    """Return a view of the diagonal of P (..., n) in [xhat, P row by row] (..., n + n^2)."""
    return belief[..., n :: n + 1]


def with_known_part(belief: np.ndarray, n: int, xbar: np.ndarray, P: np.ndarray) -> np.ndarray:
    """Return [xhat, P row by row] of [x; e; i] with this [x; i] (15), of covariance P (15 x 15).

    The states between keep their values and covariance, uncorrelated with the new ones.
    """
    known = np.concatenate((np.arange(N_X), np.arange(n - N_I, n)))
    x, P_whole = belief[:n].copy(), belief[n:].reshape(n, n).copy()
    x[known] = xbar
    P_whole[known], P_whole[:, known] = 0.0, 0.0
    P_whole[np.ix_(known, known)] = P
    return np.concatenate((x, P_whole.ravel()))
