"""The pinhole camera on the vehicle, as the world draws with it and as the onboard half predicts with it.

C is at p_BC and looks along B's x axis: its z is B's x, its x is -B's y, its y is -B's z. A point L has

    p_BL_B = R_WB^T (p_WL - p_WB),   q = p_CL_B = p_BL_B - p_BC,   u = c_u - f q_y / q_x,   v = c_v - f q_z / q_x

and a small turn of the body e (in B, R_WB -> R_WB exp([e]x)) moves it by d p_BL_B = p_BL_B x e, where
e = E(rpy) d(rpy) with the E of the Euler-angle rates (model/equations.py). A pixel's centre has integer
coordinates, so the image reaches from -1/2 to its size - 1/2.
"""

import numpy as np
from numba import njit
from numba.extending import register_jitable

from ortilo_drake.model.equations import body_rates

R_BC = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])

NEAR = 0.1  # points nearer than this in front of the camera have no projection [m]


@register_jitable
def in_body_frame(p_WL: np.ndarray, p_WB: np.ndarray, R_WB: np.ndarray) -> np.ndarray:
    """Return p_BL_B = R_WB^T (p_WL - p_WB)."""
    x, y, z = p_WL[0] - p_WB[0], p_WL[1] - p_WB[1], p_WL[2] - p_WB[2]
    return np.array(
        [
            R_WB[0, 0] * x + R_WB[1, 0] * y + R_WB[2, 0] * z,
            R_WB[0, 1] * x + R_WB[1, 1] * y + R_WB[2, 1] * z,
            R_WB[0, 2] * x + R_WB[1, 2] * y + R_WB[2, 2] * z,
        ]
    )


@njit(cache=True)
def project(
    p_WL: np.ndarray, p_WB: np.ndarray, R_WB: np.ndarray, p_BC: np.ndarray, f: float, c: np.ndarray
) -> tuple[float, float, float]:
    """Return u, v [px] and the depth q_x [m] of a point; u and v are NaN unless it is NEAR or farther in front.

    Args:
        p_WL: the point in W (3).
        p_WB: the body's origin in W (3).
        R_WB: the body's attitude (3 x 3).
        p_BC: the camera's origin in B (3).
        f: focal length [px].
        c: principal point [px] (2).
    """
    p_BL = in_body_frame(p_WL, p_WB, R_WB)
    depth = p_BL[0] - p_BC[0]
    if depth < NEAR:
        return np.nan, np.nan, depth
    return c[0] - f * (p_BL[1] - p_BC[1]) / depth, c[1] - f * (p_BL[2] - p_BC[2]) / depth, depth


@register_jitable
def euler_rate_matrix(rpy: np.ndarray) -> np.ndarray:
    """Return E(rpy), w_WB_B = E(rpy) rpy_dot."""
    E = np.empty((3, 3))
    for j in range(3):
        unit = np.zeros(3)
        unit[j] = 1.0
        E[:, j] = body_rates(rpy, unit)
    return E


@register_jitable
def _add_row(
    J: np.ndarray, row: int, share: float, p_BL: np.ndarray, g: np.ndarray, R_WB: np.ndarray, E: np.ndarray
) -> None:
    """Add share * g^T d p_BL_B / d(p_WB, rpy) to a row of J; d p_BL_B = -R_WB^T d p_WB + p_BL_B x E d rpy."""
    # g . (p x e) = (g x p) . e
    h_0 = g[1] * p_BL[2] - g[2] * p_BL[1]
    h_1 = g[2] * p_BL[0] - g[0] * p_BL[2]
    h_2 = g[0] * p_BL[1] - g[1] * p_BL[0]
    for j in range(3):
        J[row, j] -= share * (R_WB[j, 0] * g[0] + R_WB[j, 1] * g[1] + R_WB[j, 2] * g[2])
        J[row, 3 + j] += share * (h_0 * E[0, j] + h_1 * E[1, j] + h_2 * E[2, j])


@register_jitable
def _gradient(p_BL: np.ndarray, p_BC: np.ndarray, f: float, axis: int) -> np.ndarray:
    """Return d u / d p_BL_B (axis 0) or d v / d p_BL_B (axis 1)."""
    g = np.zeros(3)
    depth = p_BL[0] - p_BC[0]
    g[0] = f * (p_BL[1 + axis] - p_BC[1 + axis]) / depth**2
    g[1 + axis] = -f / depth
    return g


@njit(cache=True)
def projection_jacobian(
    p_WL: np.ndarray, p_WB: np.ndarray, rpy: np.ndarray, R_WB: np.ndarray, p_BC: np.ndarray, f: float
) -> np.ndarray:
    """Return d(u, v) / d(p_WB, rpy) (2 x 6) of a point in front; arguments as in project, and rpy (3)."""
    J = np.zeros((2, 6))
    p_BL, E = in_body_frame(p_WL, p_WB, R_WB), euler_rate_matrix(rpy)
    for axis in range(2):
        _add_row(J, axis, 1.0, p_BL, _gradient(p_BL, p_BC, f, axis), R_WB, E)
    return J


@register_jitable
def extent_corners(p_WL: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Return the corners (8, 3) in W of a box of that size along W's axes about p_WL."""
    corners = np.empty((8, 3))
    for k in range(8):
        corners[k, 0] = p_WL[0] + (0.5 if k & 1 else -0.5) * size[0]
        corners[k, 1] = p_WL[1] + (0.5 if k & 2 else -0.5) * size[1]
        corners[k, 2] = p_WL[2] + (0.5 if k & 4 else -0.5) * size[2]
    return corners


@njit(cache=True)
def extent_box(
    p_WL: np.ndarray,
    size: np.ndarray,
    p_WB: np.ndarray,
    R_WB: np.ndarray,
    p_BC: np.ndarray,
    f: float,
    c: np.ndarray,
    box: np.ndarray,
) -> bool:
    """Write (u_min, v_min, u_max, v_max) [px] of an extent, not cut at the image border, to box (4).

    False if a corner has no projection. Arguments as in project, and size (3) [m] along W's axes.
    """
    corners = extent_corners(p_WL, size)
    box[0] = box[1] = np.inf
    box[2] = box[3] = -np.inf
    for k in range(8):
        u, v, depth = project(corners[k], p_WB, R_WB, p_BC, f, c)
        if depth < NEAR:
            return False
        box[0], box[1], box[2], box[3] = min(box[0], u), min(box[1], v), max(box[2], u), max(box[3], v)
    return True


@njit(cache=True)
def box_center(
    p_WL: np.ndarray,
    size: np.ndarray,
    p_WB: np.ndarray,
    rpy: np.ndarray,
    R_WB: np.ndarray,
    p_BC: np.ndarray,
    f: float,
    c: np.ndarray,
    z: np.ndarray,
    J: np.ndarray,
) -> bool:
    """Write the centre of an extent's box to z (2) and d z / d(p_WB, rpy) to J (2 x 6).

    Each coordinate of the centre is the mean of two corners' projections, and so is its derivative. A near
    extent's centre in the image is not where its centre in space is seen: 1.6 m of bicycle at 3 m are pixels off.
    False if a corner has no projection. Arguments as in extent_box, and rpy (3).
    """
    corners = extent_corners(p_WL, size)
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    k_low, k_high = np.zeros(2, dtype=np.int64), np.zeros(2, dtype=np.int64)
    for k in range(8):
        u, v, depth = project(corners[k], p_WB, R_WB, p_BC, f, c)
        if depth < NEAR:
            return False
        for axis in range(2):
            w = u if axis == 0 else v
            if w < low[axis]:
                low[axis], k_low[axis] = w, k
            if w > high[axis]:
                high[axis], k_high[axis] = w, k
    E = euler_rate_matrix(rpy)
    J[:, :] = 0.0
    for axis in range(2):
        z[axis] = 0.5 * (low[axis] + high[axis])
        for k in (k_low[axis], k_high[axis]):
            p_BL = in_body_frame(corners[k], p_WB, R_WB)
            _add_row(J, axis, 0.5, p_BL, _gradient(p_BL, p_BC, f, axis), R_WB, E)
    return True


@njit(cache=True)
def point_pixels(
    centers: np.ndarray,
    positions: np.ndarray,
    sizes: np.ndarray,
    p_WB: np.ndarray,
    rpy: np.ndarray,
    R_WB: np.ndarray,
    p_BC: np.ndarray,
    f: float,
    c: np.ndarray,
) -> np.ndarray:
    """Return where the centres in space of landmarks are seen (n, 2), given the centres of their boxes (n, 2).

    The difference of the two is taken at the pose p_WB, rpy; NaN where a landmark has no projection there.
    """
    pixels = np.empty_like(centers)
    z, J = np.empty(2), np.empty((2, 6))
    for i in range(centers.shape[0]):
        u, v, _ = project(positions[i], p_WB, R_WB, p_BC, f, c)
        if not box_center(positions[i], sizes[i], p_WB, rpy, R_WB, p_BC, f, c, z, J):
            u = v = np.nan
        pixels[i, 0], pixels[i, 1] = centers[i, 0] - z[0] + u, centers[i, 1] - z[1] + v
    return pixels
