"""Position from three or more landmarks by the law of cosines and trilateration (paper, section III).

The rays b_i (unit vectors) to the landmarks make angles with each other; with the surveyed distances L_ij
between the landmarks every pair gives an equation for the distances d_i from the camera,

    b_i . b_j = (d_i^2 + d_j^2 - L_ij^2) / (2 d_i d_j),

solved by Gauss-Newton from the distances that the filter predicts. Then p_WC follows from |p_WC - p_WL_i| = d_i, again
by Gauss-Newton. Angles and distances do not depend on the attitude. The attitude is needed only for p_WB =
p_WC - R_WB p_BC, and for the difference between a box's centre and the landmark's projection.

The distances have little information across the line of sight. With landmarks at nearly one height the camera's height
is poorly known, and with landmarks in nearly one direction all but the distance is. The covariance shows this.
"""

import numpy as np

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.model.equations import rotation_matrix
from ortilo_drake.model.lens import bent
from ortilo_drake.model.pinhole import Camera, point_pixels, straight_pixels
from ortilo_drake.onboard.landmarks.known_attitude import inverse_3x3

_ITERATIONS = 30
_CONVERGED = 1e-9  # [m]


@cached_njit
def rays(pixels: np.ndarray, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Return unit vectors towards pixels (n, 2) in the axes of B (n, 3), and their derivatives (n, 3, 2) [1/px].

    The vector of a pixel without a ray through the lens is NaN.
    """
    n, f, c, lens = pixels.shape[0], camera.f, camera.c, camera.lens
    b, db = np.empty((n, 3)), np.empty((n, 3, 2))
    pixels = straight_pixels(pixels, camera)
    for i in range(n):
        y, z = -(pixels[i, 0] - c[0]) / f, -(pixels[i, 1] - c[1]) / f
        length = np.sqrt(1.0 + y**2 + z**2)
        b[i, 0], b[i, 1], b[i, 2] = 1.0 / length, y / length, z / length
        for axis in range(2):
            # d b = (I - b b^T) d(1, y, z) / |(1, y, z)|
            for j in range(3):
                unit = 1.0 if j == 1 + axis else 0.0
                db[i, j, axis] = -(unit - b[i, j] * b[i, 1 + axis]) / (length * f)
        if lens.bend.size > 0 or lens.aspect != 1.0:
            # db so far is with respect to the straight pixel. Multiply by the inverse of the lens' derivative.
            d_xx, d_xy, d_yy = 1.0, 0.0, 1.0
            if lens.bend.size > 0:
                _, _, d_xx, d_xy, d_yy = bent(-y, -z, lens.bend)
            determinant = d_xx * d_yy - d_xy * d_xy
            for j in range(3):
                u, v = db[i, j, 0], db[i, j, 1]
                db[i, j, 0] = (d_yy * u - d_xy * v) / determinant
                db[i, j, 1] = (d_xx * v - d_xy * u) / (determinant * lens.aspect)
    return b, db


@cached_njit
def distances_from_cosines(b: np.ndarray, positions: np.ndarray, d: np.ndarray) -> tuple[bool, np.ndarray, np.ndarray]:
    """Return whether the solver converged, the distances (n) [m], and d(b_j . b_k) / d d_i (pairs, n) at its last step.

    b are unit vectors to the landmarks (n, 3), `positions` the landmarks' p_WL (n, 3) [m], d the start distances (n).
    """
    n = b.shape[0]
    pairs = n * (n - 1) // 2
    A, e, d = np.zeros((pairs, n)), np.empty(pairs), d.copy()
    for _ in range(_ITERATIONS):
        k = 0
        for i in range(n):
            for j in range(i):
                L2 = np.sum((positions[i] - positions[j]) ** 2)
                cosine = (d[i] ** 2 + d[j] ** 2 - L2) / (2.0 * d[i] * d[j])
                e[k] = np.sum(b[i] * b[j]) - cosine
                A[k, i], A[k, j] = 1.0 / d[j] - cosine / d[i], 1.0 / d[i] - cosine / d[j]
                k += 1
        step, _, rank, _ = np.linalg.lstsq(A, e, 1e-9)
        if rank < n:
            break
        d += step
        if not np.min(d) > 0.0:
            break
        if np.max(np.abs(step)) < _CONVERGED:
            return True, d, A
    return False, d, A


@cached_njit
def trilaterate(d: np.ndarray, positions: np.ndarray, p: np.ndarray) -> tuple[bool, np.ndarray, np.ndarray]:
    """Return whether the solver converged, the point (3) at distances d (n) from positions (n, 3), and d point / d d.

    If two mirrored points solve the equations, the result is the one on the side of the start p (3).
    """
    n = d.size
    U, r, p = np.empty((n, 3)), np.empty(n), p.copy()
    for _ in range(_ITERATIONS):
        for i in range(n):
            away = p - positions[i]
            length = np.sqrt(np.sum(away**2))
            U[i], r[i] = away / length, d[i] - length
        regular, N_inverse = inverse_3x3(U.T @ U)
        if not regular:
            break
        M = N_inverse @ U.T
        step = M @ r
        p += step
        if np.sqrt(np.sum(step**2)) < _CONVERGED:
            return True, p, M
    return False, p, np.zeros((3, n))


@cached_njit
def cosine_law(
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

    The covariance is M diag(sd^2) M^T, M = d p / d pixels by the chain pixels -> cosines -> distances -> position. The
    attitude's error is neglected, because it only turns p_BC, a few centimetres. Arguments as in pose_from_boxes; P and
    max_residual are not used.
    """
    n = centers.shape[0]
    R_WB, p_BC = rotation_matrix(xhat[3:6]), camera.p_BC
    p_WB, nothing = xhat[0:3].copy(), (False, xhat[0:3].copy(), np.zeros((3, 3)))
    if n < 3:
        return nothing
    for _ in range(_ITERATIONS):
        # The step from box centres to points needs the position itself: repeat until the position is constant.
        pixels = point_pixels(centers, positions, outlines, p_WB, R_WB, camera)
        if not np.all(np.isfinite(pixels)):
            return nothing
        b, db = rays(pixels, camera)
        if not np.all(np.isfinite(b)):
            return nothing
        p_WC = p_WB + R_WB @ p_BC
        d = np.sqrt(np.sum((positions - p_WC) ** 2, axis=1))
        solved, d, A = distances_from_cosines(b, positions, d)
        if not solved:
            return nothing
        solved, p_WC, T = trilaterate(d, positions, p_WC)
        if not solved:
            return nothing
        moved = np.sqrt(np.sum((p_WC - R_WB @ p_BC - p_WB) ** 2))
        p_WB = p_WC - R_WB @ p_BC
        if moved < 1e-8:
            C, k = np.zeros((A.shape[0], 2 * n)), 0
            for i in range(n):
                for j in range(i):
                    C[k, 2 * i : 2 * i + 2] = b[j] @ db[i]
                    C[k, 2 * j : 2 * j + 2] = b[i] @ db[j]
                    k += 1
            M = T @ np.ascontiguousarray(np.linalg.pinv(A)) @ C
            least = np.min(sd)
            for i in range(n):
                for axis in range(2):
                    M[:, 2 * i + axis] *= sd[i, axis] / least
            return True, p_WB, least**2 * (M @ M.T)
    return nothing
