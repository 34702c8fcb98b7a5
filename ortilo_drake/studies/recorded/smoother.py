"""The Rauch-Tung-Striebel smoother of a run: every estimate by all ranges, those to come as well.

    C_k = P_k Phi_k+1' (P_k+1|k)^-1,   dx_k = C_k dx_k+1,   P_k|N = P_k + C_k (P_k+1|N - P_k+1|k) C_k'

with dx_k+1 the smoothed state less its prediction, as an error state.

Source: Rauch, Tung and Striebel, AIAA Journal 3, 1965.
"""

import numpy as np
from numba import njit
from numba.extending import register_jitable

from ortilo_drake.studies.recorded.filter_types import Run
from ortilo_drake.studies.recorded.propagation import turn

TINY = 1e-12  # keeps P_k+1|k regular where a state has no variance [squared units of the state]


@register_jitable
def _rotation_vector(R: np.ndarray) -> np.ndarray:
    """Return the rotation vector of a small turn."""
    a = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / 2.0
    sine = np.sqrt(np.sum(a * a))
    if sine < 1e-9:
        return a
    return a * (np.arctan2(sine, (R[0, 0] + R[1, 1] + R[2, 2] - 1.0) / 2.0) / sine)


@njit(cache=True)
def smooth(run: Run) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return smoothed positions (m, 3), attitudes (m, 3, 3) and covariances of the position (m, 3, 3).

    Args:
        run: of run_filter with `whole`.
    """
    m, N = len(run.t), run.P_after.shape[1]
    p, R_out, P_out = np.empty((m, 3)), np.empty((m, 3, 3)), np.empty((m, 3, 3))
    x, R, P = run.x[m - 1].copy(), run.R[m - 1].copy(), run.P_after[m - 1].copy()
    p[m - 1], R_out[m - 1], P_out[m - 1] = x[:3], R, P[:3, :3]
    tiny = TINY * np.eye(N)
    for k in range(m - 2, -1, -1):
        before = run.P_before[k + 1]
        C = np.ascontiguousarray(np.linalg.solve(before + tiny, run.Phi[k + 1] @ run.P_after[k]).T)
        gap = x - run.x_before[k + 1]
        dx = np.empty(N)
        dx[:6], dx[6:9] = gap[:6], _rotation_vector(R @ run.R_before[k + 1].T)
        dx[9:] = gap[6:]
        dx = C @ dx
        x, R = run.x[k].copy(), turn(dx[6:9]) @ run.R[k]
        x[:6] += dx[:6]
        x[6:] += dx[9:]
        P = run.P_after[k] + C @ (P - before) @ C.T
        P = (P + P.T) / 2.0
        p[k], R_out[k], P_out[k] = x[:3], R, P[:3, :3]
    return p, R_out, P_out
