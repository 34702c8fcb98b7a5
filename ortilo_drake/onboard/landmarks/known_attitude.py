"""Position, position and yaw, or the whole pose from two or more landmarks; the filter gives the rest of the pose.

Each box centre gives two equations for the unknown part q of the pose, which is p_WB, [p_WB, psi] or [p_WB, rpy]. The
held part a is rpy, [phi, theta] or empty. Gauss-Newton solves the least squares on the pixels, weighted by the
covariance R_i of the pixels' errors,

    q <- q + N^-1 sum_i J_i^T R_i^-1 (z_i - h_i(q)),   N = sum_i J_i^T R_i^-1 J_i,   J_i = d h_i / d q,

from the filter's pose. The error of the held part is common to all boxes and enters the solution directly:

    cov(q) = N^-1 + G P_a G^T,   G = N^-1 sum_i J_i^T R_i^-1 A_i,   A_i = d h_i / d a.

A box's residual r_i has the covariance

    S_i = R_i - J_i N^-1 J_i^T + (A_i - J_i G) P_a (A_i - J_i G)^T = R_i + [J_i A_i] Q [J_i A_i]^T,
    Q = [G P_a G^T - N^-1, -G P_a; -P_a G^T, P_a].

A fix with held attitude feeds the filter's attitude error into the filter, as if the error were new in every fix. A fix
of the whole pose does not: the attitude has its own rows, and the covariance of the six numbers includes the covariance
of position and attitude, so that the filter weighs them as it would weigh the pixels. Two landmarks do not determine
six unknowns. So the filter's angles, with the sd FREE_SD each, are added as measurements; FREE_SD is so large that they
have no weight beside the filter's own angles.

A box centre has a kink where another point of the outline becomes the outermost one. Gauss-Newton may oscillate across
a kink (by a millimetre, say), so the steps shrink after the first few.
"""

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.model.cholesky import scaled_inverse
from ortilo_drake.model.elementary import power_of_two
from ortilo_drake.model.equations import rotation_matrix
from ortilo_drake.model.pinhole import Camera, Sines, box_and_jacobian, sines
from ortilo_drake.model.placing import fill
from ortilo_drake.model.products import product, times
from ortilo_drake.onboard.landmarks.landmark_association import innovation_covariance, pose_covariance, squared_distance

_ITERATIONS = 30
_CONVERGED = 1e-7  # [m], [rad]
_REGULAR = 1e-12  # a scaled determinant below this is singular
FREE_SD = 0.05  # sd of the filter's angles in a fix of the whole pose [rad]
# Indices of the pose [p_WB, rpy], first the unknown and then the held ones.
ATTITUDE_HELD = np.array([0, 1, 2, 3, 4, 5])
TILT_HELD = np.array([0, 1, 2, 5, 3, 4])


@cached_njit
def inverse_3x3(N: np.ndarray) -> tuple[bool, np.ndarray]:
    """Return whether a symmetric N >= 0 (3 x 3) is far enough from singular, and N^-1 (3 x 3)."""
    a, b = N[1, 1] * N[2, 2] - N[1, 2] ** 2, N[0, 2] * N[1, 2] - N[0, 1] * N[2, 2]
    c = N[0, 1] * N[1, 2] - N[0, 2] * N[1, 1]
    determinant = N[0, 0] * a + N[0, 1] * b + N[0, 2] * c
    trace = N[0, 0] + N[1, 1] + N[2, 2]
    if not determinant > _REGULAR * trace**3:
        return False, np.zeros((3, 3))
    d, e = N[0, 0] * N[2, 2] - N[0, 2] ** 2, N[0, 1] * N[0, 2] - N[0, 0] * N[1, 2]
    g = N[0, 0] * N[1, 1] - N[0, 1] ** 2
    return True, np.array(((a, b, c), (b, d, e), (c, e, g))) / determinant


@register_jitable(error_model="numpy", _nrt=False)
def add_boxes(
    kept: np.ndarray,
    centers: np.ndarray,
    positions: np.ndarray,
    outlines: np.ndarray,
    sd: np.ndarray,
    p_WB: np.ndarray,
    of_rpy: Sines,
    R_WB: np.ndarray,
    camera: Camera,
    order: np.ndarray,
    least: float,
    box: np.ndarray,
    J: np.ndarray,
    J_of: np.ndarray,
    r: np.ndarray,
    N: np.ndarray,
    B: np.ndarray,
    b: np.ndarray,
) -> bool:
    """Add the kept boxes to N (m, m), B = sum J^T R^-1 A (m, h) and b (m); False if a box has no projection.

    This is a function of its own, because here views of a box cost no reference counting. [J_i A_i] go to J_of (n, 2,
    6), residuals to r (n, 2) [px]. Other arguments as in pose_from_boxes.
    """
    m, h = B.shape
    for i in range(kept.size):
        if not kept[i]:
            continue
        if not box_and_jacobian(positions[i], outlines[i], p_WB, of_rpy, R_WB, camera, box, J):
            return False
        for axis in range(2):
            r[i, axis] = centers[i, axis] - 0.5 * (box[axis] + box[2 + axis])
            weight = (least / sd[i, axis]) ** 2
            for j in range(6):
                J_of[i, axis, j] = J[axis, order[j]]
            for j in range(m):
                weighted = weight * J_of[i, axis, j]
                b[j] += weighted * r[i, axis]
                for k in range(m):
                    N[j, k] += weighted * J_of[i, axis, k]
                for k in range(h):
                    B[j, k] += weighted * J_of[i, axis, m + k]
    return True


@cached_njit
def pose_from_boxes(
    centers: np.ndarray,
    positions: np.ndarray,
    outlines: np.ndarray,
    xhat: np.ndarray,
    P: np.ndarray,
    camera: Camera,
    sd: np.ndarray,
    max_residual: float,
    m: int,
    free_sd: float = FREE_SD,
) -> tuple[bool, np.ndarray, np.ndarray, np.ndarray]:
    """Return whether there is a fix, the unknown part of the pose (m), its covariance (m x m), and the kept boxes (n).

    The unknowns are p_WB (m = 3), [p_WB, psi] (4), so that a compass error does not turn the position about the
    vehicle, or [p_WB, rpy] (6). With 6, the filter's angles are measurements with the sd free_sd [rad]; inf leaves them
    out. While r_i^T S_i^-1 r_i > max_residual^2 for a box, the box with the largest value is dropped and the rest is
    solved again.

    The boxes have centres (n, 2) [px] with sds sd (n, 2), and belong to landmarks at p_WL (n, 3) with outlines (n, m,
    3), see pinhole.py. Position and attitude come first in the estimate xhat (15); its covariance P (225) is not used
    with 6 unknowns.
    """
    # The sums use R_i divided by the smallest variance `least`^2, so that N here is least^2 times N of the equations.
    order = TILT_HELD if m == 4 else ATTITUDE_HELD
    n = centers.shape[0]
    pose, h = xhat[0:6].copy(), 6 - m
    P_pose = pose_covariance(P)
    P_a = np.empty((h, h))
    for j in range(h):
        for k in range(h):
            P_a[j, k] = P_pose[order[m + j], order[m + k]]
    kept, n_kept = np.ones(n, dtype=np.bool_), n
    least = np.min(sd) if n > 0 else 1.0
    box, J, J_of, r = np.empty(4), np.empty((2, 6)), np.empty((n, 2, 6)), np.empty((n, 2))
    N, B, b, Q = np.empty((m, m)), np.empty((m, h)), np.empty(m), np.empty((6, 6))
    p_WB, rpy = pose[0:3], pose[3:6]
    nothing = (False, pose[order[:m]], np.zeros((m, m)), kept)
    while n_kept >= 2:
        converged, N_inverse = False, N
        for iteration in range(_ITERATIONS):
            fill(b, 0.0)
            fill(N.ravel(), 0.0)
            fill(B.ravel(), 0.0)
            seen_from = p_WB, sines(rpy), rotation_matrix(rpy), camera
            if not add_boxes(
                kept, centers, positions, outlines, sd, *seen_from, order, least, box, J, J_of, r, N, B, b
            ):
                return nothing
            for j in range(3, m):
                weight = (least / free_sd) ** 2 if m == 6 else 0.0
                N[j, j] += weight
                b[j] += weight * (xhat[order[j]] - pose[order[j]])
            regular, N_inverse = inverse_3x3(N) if m == 3 else scaled_inverse(N, _REGULAR)
            if not regular:
                return nothing
            if converged:
                break
            step, shrunk, length = times(N_inverse, b), min(1.0, power_of_two(5 - iteration)), 0.0
            for j in range(m):
                pose[order[j]] += shrunk * step[j]
                length += (shrunk * step[j]) ** 2
            converged = np.sqrt(length) < _CONVERGED
        if not converged:
            return nothing
        G = product(N_inverse, B)
        G_P_a = product(G, P_a)
        G_P_a_G = product(G_P_a, G.T)
        for j in range(m):
            for k in range(m):
                Q[j, k] = G_P_a_G[j, k] - least**2 * N_inverse[j, k]
            for k in range(h):
                Q[j, m + k] = Q[m + k, j] = -G_P_a[j, k]
        for j in range(h):
            for k in range(h):
                Q[m + j, m + k] = P_a[j, k]
        worst, farthest = -1, max_residual**2
        for i in range(n):
            if kept[i]:
                S_uu, S_uv, S_vv = innovation_covariance(J_of[i], Q, sd[i])
                # Two boxes leave a residual in one direction only; the small added variance keeps S regular.
                d2 = squared_distance(r[i, 0], r[i, 1], S_uu + 1e-6 * least**2, S_uv, S_vv + 1e-6 * least**2)
                if d2 > farthest:
                    worst, farthest = i, d2
        if worst < 0:
            return True, pose[order[:m]], least**2 * N_inverse + G_P_a_G, kept
        kept[worst] = False
        n_kept -= 1
    return nothing
