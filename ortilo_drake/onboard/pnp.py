"""Position and attitude from four or more landmarks: SQPNP in RANSAC, then least squares on the boxes.

SQPNP: Terzakis and Lourakis, "A consistently fast and globally optimal solution to the perspective-n-point
problem", ECCV 2020. The attitude found is used for p_WB and then forgotten: the fix is a position.
"""

import cv2
import numpy as np
from numba import njit

from ortilo_drake.model.equations import rotation_matrix
from ortilo_drake.model.pinhole import R_BC, box_center, point_pixels

_ITERATIONS = 30
_CONVERGED = 1e-7  # [m], [rad]


@njit(cache=True)
def refine_pose(
    centers: np.ndarray,
    positions: np.ndarray,
    sizes: np.ndarray,
    p_WB: np.ndarray,
    rpy: np.ndarray,
    p_BC: np.ndarray,
    f: float,
    c: np.ndarray,
) -> tuple[bool, np.ndarray, np.ndarray]:
    """Return whether Gauss-Newton converged, the pose [p_WB, rpy] (6) and (sum_i J_i^T J_i)^-1 (6 x 6).

    Args:
        centers: centres of the boxes [px] (n, 2).
        positions: p_W of the landmarks (n, 3).
        sizes: their extents along W's axes (n, 3).
        p_WB: position to start from (3).
        rpy: attitude to start from (3).
        p_BC: camera in B (3).
        f: focal length [px].
        c: principal point [px] (2).
    """
    n = centers.shape[0]
    pose = np.concatenate((p_WB, rpy))
    z, J, r = np.empty(2), np.zeros((2 * n, 6)), np.empty(2 * n)
    for iteration in range(_ITERATIONS):
        R_WB = rotation_matrix(pose[3:6])
        for i in range(n):
            rows = slice(2 * i, 2 * i + 2)
            if not box_center(positions[i], sizes[i], pose[0:3], pose[3:6], R_WB, p_BC, f, c, z, J[2 * i : 2 * i + 2]):
                return False, pose, np.zeros((6, 6))
            r[rows] = centers[i] - z
        step, _, rank, _ = np.linalg.lstsq(J, r, 1e-9)
        if rank < 6:
            break
        step *= min(1.0, 2.0 ** (5 - iteration))  # box centres have kinks, see known_attitude.py
        pose = pose + step
        if np.max(np.abs(step)) < _CONVERGED:
            J_inverse = np.linalg.pinv(J)
            return True, pose, J_inverse @ J_inverse.T
    return False, pose, np.zeros((6, 6))


def pnp(
    centers: np.ndarray,
    positions: np.ndarray,
    sizes: np.ndarray,
    xhat: np.ndarray,
    P: np.ndarray,
    p_BC: np.ndarray,
    f: float,
    c: np.ndarray,
    sd: float,
    max_residual: float,
) -> tuple[bool, np.ndarray, np.ndarray]:
    """Return whether there is a fix, p_WB (3) and its covariance (3 x 3).

    RANSAC counts a box in if it lies within max_residual * sd of its place. Arguments as in known_attitude;
    xhat serves only for the difference between a box's centre and the landmark's, P is not used.
    """
    nothing = (False, xhat[0:3].copy(), np.zeros((3, 3)))
    if len(centers) < 4:
        return nothing
    p_WB, rpy = xhat[0:3], xhat[3:6]
    pixels = point_pixels(centers, positions, sizes, p_WB, rpy, rotation_matrix(rpy), p_BC, f, c)
    if not np.all(np.isfinite(pixels)):
        return nothing
    K = np.array([[f, 0.0, c[0]], [0.0, f, c[1]], [0.0, 0.0, 1.0]])
    cv2.setRNGSeed(0)  # OpenCV's generator is global: the same boxes shall give the same fix
    try:
        found, rvec, t, inliers = cv2.solvePnPRansac(
            positions, pixels, K, None, flags=cv2.SOLVEPNP_SQPNP, reprojectionError=max_residual * sd
        )
    except cv2.error:  # raised where a minimal set is degenerate
        return nothing
    if not found or inliers is None or len(inliers) < 4:
        return nothing
    R_WC = cv2.Rodrigues(rvec)[0].T
    R_WB = R_WC @ R_BC.T
    p_WB = -R_WC @ t[:, 0] - R_WB @ p_BC
    roll, pitch = np.arctan2(R_WB[2, 1], R_WB[2, 2]), np.arcsin(np.clip(-R_WB[2, 0], -1.0, 1.0))
    rpy = np.array([roll, pitch, np.arctan2(R_WB[1, 0], R_WB[0, 0])])
    kept = np.sort(inliers[:, 0])
    refined, pose, covariance = refine_pose(centers[kept], positions[kept], sizes[kept], p_WB, rpy, p_BC, f, c)
    return bool(refined), pose[0:3], sd**2 * covariance[0:3, 0:3]
