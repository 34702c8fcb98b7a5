"""Position from two or more landmarks, the attitude taken from the filter.

With the attitude known each box centre gives two equations for p_WB. Least squares on the pixels by
Gauss-Newton,

    p <- p + N^-1 sum_i J_i^T (z_i - h_i(p)),   N = sum_i J_i^T J_i,   J_i = d h_i / d p_WB,

from the filter's position. The attitude's error is common to all boxes and goes straight into the position:

    cov(p) = sd^2 N^-1 + G P_a G^T,   G = N^-1 sum_i J_i^T A_i,   A_i = d h_i / d rpy.

A box's residual r_i has the covariance

    S_i = sd^2 (I - J_i N^-1 J_i^T) + (A_i - J_i G) P_a (A_i - J_i G)^T = sd^2 I + [J_i A_i] Q [J_i A_i]^T,
    Q = [G P_a G^T - sd^2 N^-1, -G P_a; -P_a G^T, P_a].

A box centre has kinks where another point of the outline becomes the outermost, and Gauss-Newton may step to
and fro across one (by a millimetre, say); so steps shrink after the first few.
"""

import numpy as np
from numba import njit

from ortilo_drake.model.equations import rotation_matrix
from ortilo_drake.model.pinhole import Camera, box_center
from ortilo_drake.onboard.landmarks.landmark_association import innovation_covariance, pose_covariance, squared_distance

_ITERATIONS = 30
_CONVERGED = 1e-7  # [m]


@njit(cache=True)
def inverse_3x3(N: np.ndarray) -> tuple[bool, np.ndarray]:
    """Return whether a symmetric N >= 0 (3 x 3) is far enough from singular, and N^-1."""
    a, b = N[1, 1] * N[2, 2] - N[1, 2] ** 2, N[0, 2] * N[1, 2] - N[0, 1] * N[2, 2]
    c = N[0, 1] * N[1, 2] - N[0, 2] * N[1, 1]
    determinant = N[0, 0] * a + N[0, 1] * b + N[0, 2] * c
    trace = N[0, 0] + N[1, 1] + N[2, 2]
    if not determinant > 1e-12 * trace**3:
        return False, np.zeros((3, 3))
    d, e = N[0, 0] * N[2, 2] - N[0, 2] ** 2, N[0, 1] * N[0, 2] - N[0, 0] * N[1, 2]
    g = N[0, 0] * N[1, 1] - N[0, 1] ** 2
    return True, np.array([[a, b, c], [b, d, e], [c, e, g]]) / determinant


@njit(cache=True)
def known_attitude(
    centers: np.ndarray,
    positions: np.ndarray,
    outlines: np.ndarray,
    xhat: np.ndarray,
    P: np.ndarray,
    camera: Camera,
    sd: float,
    max_residual: float,
) -> tuple[bool, np.ndarray, np.ndarray]:
    """Return whether there is a fix, p_WB (3) and its covariance (3 x 3).

    The box that disagrees most with the rest is dropped, and the position solved again, as long as it disagrees by
    more than max_residual: r_i^T S_i^-1 r_i > max_residual^2.

    Args:
        centers: centres of the boxes [px] (n, 2).
        positions: p_W of the landmarks they are of (n, 3).
        outlines: the landmarks' outlines, see pinhole.py (n, m, 3).
        xhat: estimate; position and attitude come first.
        P: its covariance (225).
        camera: the camera.
        sd: error of a box centre [px].
        max_residual: in standard deviations.
    """
    n = centers.shape[0]
    p, rpy, P_a = xhat[0:3].copy(), xhat[3:6], np.ascontiguousarray(pose_covariance(P)[3:6, 3:6])
    R_WB = rotation_matrix(rpy)
    kept, n_kept = np.ones(n, dtype=np.bool_), n
    z, J, J_of, r = np.empty(2), np.empty((2, 6)), np.empty((n, 2, 6)), np.empty((n, 2))
    Q = np.empty((6, 6))
    nothing = (False, p, np.zeros((3, 3)))
    while n_kept >= 2:
        converged, N_inverse, B = False, np.zeros((3, 3)), np.zeros((3, 3))
        for iteration in range(_ITERATIONS):
            N, B, b = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros(3)
            for i in range(n):
                if not kept[i]:
                    continue
                if not box_center(positions[i], outlines[i], p, rpy, R_WB, camera, z, J):
                    return nothing
                J_of[i] = J
                for axis in range(2):
                    r[i, axis] = centers[i, axis] - z[axis]
                    for j in range(3):
                        b[j] += J[axis, j] * r[i, axis]
                        for k in range(3):
                            N[j, k] += J[axis, j] * J[axis, k]
                            B[j, k] += J[axis, j] * J[axis, 3 + k]
            regular, N_inverse = inverse_3x3(N)
            if not regular:
                return nothing
            if converged:
                break
            step = min(1.0, 2.0 ** (5 - iteration)) * (N_inverse @ b)
            p = p + step
            converged = np.sqrt(step[0] ** 2 + step[1] ** 2 + step[2] ** 2) < _CONVERGED
        if not converged:
            return nothing
        G = N_inverse @ B
        G_P_a = G @ P_a
        G_P_a_G = G_P_a @ np.ascontiguousarray(G.T)
        Q[0:3, 0:3], Q[0:3, 3:6] = G_P_a_G - sd**2 * N_inverse, -G_P_a
        Q[3:6, 0:3], Q[3:6, 3:6] = -G_P_a.T, P_a
        worst, farthest = -1, max_residual**2
        for i in range(n):
            if kept[i]:
                S_uu, S_uv, S_vv = innovation_covariance(J_of[i], Q, sd)
                # Two boxes leave a residual in one direction only; the last digits keep S regular.
                d2 = squared_distance(r[i, 0], r[i, 1], S_uu + 1e-6 * sd**2, S_uv, S_vv + 1e-6 * sd**2)
                if d2 > farthest:
                    worst, farthest = i, d2
        if worst < 0:
            return True, p, sd**2 * N_inverse + G_P_a_G
        kept[worst] = False
        n_kept -= 1
    return nothing
