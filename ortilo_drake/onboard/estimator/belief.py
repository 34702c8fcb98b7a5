"""The belief of the filter, [xhat, P row by row], and the parts of it.

A filter of xbar = [x; e; i], with extra states e (extra_states.py), gives other parts its belief of [x; i] only. The
elements below make the belief of [x; i] from an estimator with separate outputs for estimate and covariance.
"""

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.loop.element import Box, Element, Values
from ortilo_drake.model.placing import fill, put
from ortilo_drake.model.signals import N_I, N_X, N_XBAR


@register_jitable
def put_vehicle_part(out: np.ndarray, belief: np.ndarray, n: int) -> None:
    """Write the belief [xhat, P row by row] of [x; i] to out (240), given the belief of [x; e; i] (n + n^2)."""
    for i in range(N_XBAR):
        row = i if i < N_X else n - N_XBAR + i
        out[i] = belief[row]
        for j in range(N_XBAR):
            out[N_XBAR * (i + 1) + j] = belief[n * (row + 1) + (j if j < N_X else n - N_XBAR + j)]


def with_vehicle_part(belief: np.ndarray, n: int, xbar: np.ndarray, P: np.ndarray) -> np.ndarray:
    """Return the belief of [x; e; i] (n + n^2) after [x; i] is replaced by xbar (15) with covariance P (15 x 15).

    The states e keep their values and covariance; their correlation with [x; i] becomes 0.
    """
    known = np.concatenate((np.arange(N_X), np.arange(n - N_I, n)))
    x, P_whole = belief[:n].copy(), belief[n:].reshape(n, n).copy()
    x[known] = xbar
    P_whole[known], P_whole[:, known] = 0.0, 0.0
    P_whole[np.ix_(known, known)] = P
    return np.concatenate((x, P_whole.ravel()))


SIZE = N_XBAR + N_XBAR * N_XBAR


def together_out(estimate: np.ndarray, covariance: np.ndarray, out: np.ndarray) -> None:
    """Output the belief [xhat, P row by row] (240) of an estimate (15) and its covariance, row by row (225)."""
    put(estimate, out)
    put(covariance, out, N_XBAR)


def widened_out(estimate: np.ndarray, covariance: np.ndarray, i: np.ndarray, out: np.ndarray) -> None:
    """Output the belief of [x; i] (240) from an estimate of x (12, 144); the integral i has covariance 0."""
    fill(out, 0.0)
    put(estimate, out)
    put(i, out, N_X)
    for row in range(N_X):
        put(covariance[N_X * row : N_X * (row + 1)], out, N_XBAR * (row + 1))


def widened_step(estimate: np.ndarray, reference: np.ndarray, i: np.ndarray) -> None:
    """Advance the integral by one tick: i_{k+1} = i_k + r_k - p_hat_k, as in the authors' code."""
    for axis in range(N_I):
        i[axis] += reference[axis] - estimate[axis]


TOGETHER = Element("belief_together", out=together_out)
WIDENED = Element("belief_widened", out=widened_out, step=widened_step)


def together_box(name: str = "filter") -> Box:
    """Return the box that makes the belief from the outputs of an estimator of [x; i]."""
    return Box(name, TOGETHER, SIZE)


def widened_box() -> Box:
    """Return the box that makes the belief from the outputs of an estimator of x; the box also reads the reference."""
    return Box("filter", WIDENED, SIZE, Values(start={"i": np.zeros(N_I)}))
