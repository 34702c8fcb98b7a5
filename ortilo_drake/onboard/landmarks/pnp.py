"""Position and attitude from four or more landmarks: SQPNP in RANSAC, then least squares on the boxes.

SQPNP: Terzakis and Lourakis, "A consistently fast and globally optimal solution to the perspective-n-point
problem", ECCV 2020. The attitude is used only to compute p_WB: the fix is a position.
"""

import numpy as np

from ortilo_drake.model.equations import rotation_matrix
from ortilo_drake.model.optional import later
from ortilo_drake.model.pinhole import R_BC, Camera, point_pixels, straight_pixels
from ortilo_drake.onboard.landmarks.known_attitude import pose_from_boxes

cv2 = later("cv2")


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

    A box is an inlier of RANSAC within max_residual times the median sd of its reprojection. Arguments as in
    pose_from_boxes; xhat is used only for the difference between a box's centre and the landmark's; P is not used.
    """
    nothing = (False, xhat[0:3].copy(), np.zeros((3, 3)))
    if len(centers) < 4:
        return nothing
    pixels = point_pixels(centers, positions, outlines, xhat[0:3], rotation_matrix(xhat[3:6]), camera)
    pixels = straight_pixels(pixels, camera)
    if not np.all(np.isfinite(pixels)):
        return nothing
    K = np.array([[camera.f, 0.0, camera.c[0]], [0.0, camera.f, camera.c[1]], [0.0, 0.0, 1.0]])
    cv2.setRNGSeed(0)  # OpenCV's generator is global; with a fixed seed the same boxes give the same fix
    try:
        found, rvec, t, inliers = cv2.solvePnPRansac(
            positions, pixels, K, None, flags=cv2.SOLVEPNP_SQPNP, reprojectionError=max_residual * float(np.median(sd))
        )
    except cv2.error:  # raised if a minimal set is degenerate
        return nothing
    if not found or inliers is None or len(inliers) < 4:
        return nothing
    R_WC = cv2.Rodrigues(rvec)[0].T
    R_WB = R_WC @ R_BC.T
    p_WB = -R_WC @ t[:, 0] - R_WB @ camera.p_BC
    roll, pitch = np.arctan2(R_WB[2, 1], R_WB[2, 2]), np.arcsin(np.clip(-R_WB[2, 0], -1.0, 1.0))
    rpy = np.array([roll, pitch, np.arctan2(R_WB[1, 0], R_WB[0, 0])])
    kept = np.sort(inliers[:, 0])
    start, boxes = np.concatenate((p_WB, rpy)), (centers[kept], positions[kept], outlines[kept])
    refined, pose, covariance, _ = pose_from_boxes(*boxes, start, P, camera, sd[kept], np.inf, 6, np.inf)
    return bool(refined), pose[0:3], covariance[0:3, 0:3]
