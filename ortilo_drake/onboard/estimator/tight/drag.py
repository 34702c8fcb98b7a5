"""Drag in place of an accelerometer's axis: along an axis i of B the specific force is -k v_B,i.

To first order the error of v_B is R^T dv + [v_B]x theta, so that over a step

    dv' = dv - dt k R e_i e_i^T (R^T dv + [v_B]x theta)

Source: Leishman et al., "Quadrotors and accelerometers", IEEE Control Systems 34, 2014, with k = lambda / m.
"""

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.onboard.estimator.tight.layout import THETA, V


@register_jitable
def along_body(R: np.ndarray, v: np.ndarray, i: int) -> float:
    """Return the component v_B,i along axis i of B of a vector v in W (3), R = R_WB."""
    return R[0, i] * v[0] + R[1, i] * v[1] + R[2, i] * v[2]


@register_jitable
def drag_step(
    A: np.ndarray, N: np.ndarray, R: np.ndarray, v: np.ndarray, i: int, k: float, dt: float, density: float
) -> None:
    """Add the effect of drag k [1/s] along axis i (0 or 1) over a step dt [s] to the transition A and the noise N.

    A is the transition of (dp, dv, theta) since the start of the tick (9, m), N the covariance of their noise (9, 9),
    R = R_WB, v = v_WB. `density` is the spectral density of the drag's white error [m²/s³].
    """
    turned = np.zeros(3)  # row i of [v_B]x
    a, b = (i + 1) % 3, (i + 2) % 3
    turned[a], turned[b] = -along_body(R, v, b), along_body(R, v, a)
    _act(A, R, turned, i, k * dt)
    _act(N, R, turned, i, k * dt)
    _act(N.T, R, turned, i, k * dt)
    for j in range(3):
        for m in range(3):
            N[V + j, V + m] += dt * density * R[j, i] * R[m, i]


@register_jitable
def _act(M: np.ndarray, R: np.ndarray, turned: np.ndarray, i: int, kdt: float) -> None:
    for c in range(M.shape[1]):
        along = 0.0
        for a in range(3):
            along += R[a, i] * M[V + a, c] + turned[a] * M[THETA + a, c]
        for a in range(3):
            M[V + a, c] -= kdt * R[a, i] * along
