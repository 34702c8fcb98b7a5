"""The belief of the filter, [xhat, P row by row], and its parts.

A filter of xbar = [x; e; i], e the states between (extra_states.py), shows the others what it has of [x; i].
"""

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.model.signals import N_I, N_X, N_XBAR


@register_jitable
def put_vehicle_part(out: np.ndarray, belief: np.ndarray, n: int) -> None:
    """Write [xhat, P row by row] of [x; i] alone to out (240), from that of [x; e; i] (n + n^2)."""
    for i in range(N_XBAR):
        row = i if i < N_X else n - N_XBAR + i
        out[i] = belief[row]
        for j in range(N_XBAR):
            out[N_XBAR * (i + 1) + j] = belief[n * (row + 1) + (j if j < N_X else n - N_XBAR + j)]


def with_vehicle_part(belief: np.ndarray, n: int, xbar: np.ndarray, P: np.ndarray) -> np.ndarray:
    """Return [xhat, P row by row] of [x; e; i] with this [x; i] (15), of covariance P (15 x 15).

    The states between keep their values and covariance, uncorrelated with the new ones.
    """
    known = np.concatenate((np.arange(N_X), np.arange(n - N_I, n)))
    x, P_whole = belief[:n].copy(), belief[n:].reshape(n, n).copy()
    x[known] = xbar
    P_whole[known], P_whole[:, known] = 0.0, 0.0
    P_whole[np.ix_(known, known)] = P
    return np.concatenate((x, P_whole.ravel()))
