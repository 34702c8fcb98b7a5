"""Position and attitude from four or more landmarks: SQPNP in RANSAC, then least squares on the boxes.

SQPNP: Terzakis and Lourakis, "A consistently fast and globally optimal solution to the perspective-n-point
problem", ECCV 2020. The attitude found is used for p_WB and then forgotten: the fix is a position.
"""

import numpy as np
from numba import njit

from ortilo_drake.model.equations import rotation_matrix
from ortilo_drake.model.optional import later
from ortilo_drake.model.pinhole import R_BC, Camera, box_center, point_pixels, straight_pixels

cv2 = later("cv2")

_ITERATIONS = 30
_CONVERGED = 1e-7  # [m], [rad]


@njit(cache=True)
def refine_pose(
    centers: np.ndarray,
    positions: np.ndarray,
    outlines: np.ndarray,
    p_WB: np.ndarray,
    rpy: np.ndarray,
    camera: Camera,
    sd: np.ndarray,
) -> tuple[bool, np.ndarray, np.ndarray]:
    """Return whether Gauss-Newton converged, the pose [p_WB, rpy] (6) and its covariance (6 x 6).

    Args:
        centers: centres of the boxes [px] (n, 2).
        positions: p_W of the landmarks (n, 3).
        outlines: their outlines, see pinhole.py (n, m, 3).
        p_WB: position to start from (3).
        rpy: attitude to start from (3).
        camera: the camera.
        sd: error of each box centre [px] (n, 2).
    """
    n = centers.shape[0]
    least = np.min(sd)
    pose = np.concatenate((p_WB, rpy))
    z, J, r = np.empty(2), np.zeros((2 * n, 6)), np.empty(2 * n)
    for iteration in range(_ITERATIONS):
        R_WB = rotation_matrix(pose[3:6])
        for i in range(n):
            rows = slice(2 * i, 2 * i + 2)
            if not box_center(positions[i], outlines[i], pose[0:3], pose[3:6], R_WB, camera, z, J[rows]):
                return False, pose, np.zeros((6, 6))
            r[rows] = centers[i] - z
            for axis in range(2):
                r[2 * i + axis] *= least / sd[i, axis]
                J[2 * i + axis] *= least / sd[i, axis]
        step, _, rank, _ = np.linalg.lstsq(J, r, 1e-9)
        if rank < 6:
            break
        step *= min(1.0, 2.0 ** (5 - iteration))  # box centres have kinks, see known_attitude.py
        pose = pose + step
        if np.max(np.abs(step)) < _CONVERGED:
            J_inverse = np.linalg.pinv(J)
            return True, pose, least**2 * (J_inverse @ J_inverse.T)
    return False, pose, np.zeros((6, 6))


def pnp(
    centers: np.ndarray,
    positions: np.ndarray,
    outlines: np.ndarray,
    xhat: np.ndarray,
    P: np.ndarray,
    camera: Camera,
    sd: np.ndarray,
    max_residual: float,
) -> tuple[bool, np.ndarray, np.ndarray]:
    """Return whether there is a fix, p_WB (3) and its covariance (3 x 3).

    RANSAC counts a box in if it lies within max_residual times the median sd of its place. Arguments as in
    pose_from_boxes; xhat serves only for the difference between a box's centre and the landmark's, P is not used.
    """
    nothing = (False, xhat[0:3].copy(), np.zeros((3, 3)))
    if len(centers) < 4:
        return nothing
    pixels = point_pixels(centers, positions, outlines, xhat[0:3], rotation_matrix(xhat[3:6]), camera)
    pixels = straight_pixels(pixels, camera)
    if not np.all(np.isfinite(pixels)):
        return nothing
    K = np.array([[camera.f, 0.0, camera.c[0]], [0.0, camera.f, camera.c[1]], [0.0, 0.0, 1.0]])
    cv2.setRNGSeed(0)  # OpenCV's generator is global: the same boxes shall give the same fix
    try:
        found, rvec, t, inliers = cv2.solvePnPRansac(
            positions, pixels, K, None, flags=cv2.SOLVEPNP_SQPNP, reprojectionError=max_residual * float(np.median(sd))
        )
    except cv2.error:  # raised where a minimal set is degenerate
        return nothing
    if not found or inliers is None or len(inliers) < 4:
        return nothing
    R_WC = cv2.Rodrigues(rvec)[0].T
    R_WB = R_WC @ R_BC.T
    p_WB = -R_WC @ t[:, 0] - R_WB @ camera.p_BC
    roll, pitch = np.arctan2(R_WB[2, 1], R_WB[2, 2]), np.arcsin(np.clip(-R_WB[2, 0], -1.0, 1.0))
    rpy = np.array([roll, pitch, np.arctan2(R_WB[1, 0], R_WB[0, 0])])
    kept = np.sort(inliers[:, 0])
    refined, pose, covariance = refine_pose(centers[kept], positions[kept], outlines[kept], p_WB, rpy, camera, sd[kept])
    return bool(refined), pose[0:3], covariance[0:3, 0:3]
