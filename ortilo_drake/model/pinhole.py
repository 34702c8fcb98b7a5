"""The pinhole camera on the vehicle, as the world draws with it and as the onboard half predicts with it.

C is at p_BC and looks along B's x axis: its z is B's x, its x is -B's y, its y is -B's z. A point L has

    p_BL_B = R_WB^T (p_WL - p_WB),  q = p_BL_B - p_BC,  u = c_u - f q_y / q_x,  v = c_v - f q_z / q_x

and a small turn of the body e (in B, R_WB -> R_WB exp([e]x)) moves it by d p_BL_B = p_BL_B x e, where
e = E(rpy) d(rpy) with the E of the Euler-angle rates (model/equations.py). A pixel's centre has integer
coordinates, so the image reaches from -1/2 to its size - 1/2.

Points and pixels are plain numbers and tuples inside: an array each would cost more than the arithmetic.
"""

import numpy as np
from numba import njit
from numba.extending import register_jitable

Point = tuple[float, float, float]

R_BC = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])

NEAR = 0.1  # points nearer than this in front of the camera have no projection [m]


@register_jitable
def in_body_frame(x: float, y: float, z: float, p_WB: np.ndarray, R_WB: np.ndarray) -> Point:
    """Return p_BL_B = R_WB^T (p_WL - p_WB) of p_WL = (x, y, z)."""
    x, y, z = x - p_WB[0], y - p_WB[1], z - p_WB[2]
    return (
        R_WB[0, 0] * x + R_WB[1, 0] * y + R_WB[2, 0] * z,
        R_WB[0, 1] * x + R_WB[1, 1] * y + R_WB[2, 1] * z,
        R_WB[0, 2] * x + R_WB[1, 2] * y + R_WB[2, 2] * z,
    )


@register_jitable
def _pixel(p_BL: Point, p_BC: np.ndarray, f: float, c: np.ndarray) -> Point:
    """Return u, v and the depth q_x; u and v NaN without a projection."""
    depth = p_BL[0] - p_BC[0]
    if depth < NEAR:
        return np.nan, np.nan, depth
    return c[0] - f * (p_BL[1] - p_BC[1]) / depth, c[1] - f * (p_BL[2] - p_BC[2]) / depth, depth


@njit(cache=True)
def project(p_WL: np.ndarray, p_WB: np.ndarray, R_WB: np.ndarray, p_BC: np.ndarray, f: float, c: np.ndarray) -> Point:
    """Return u, v [px] and the depth q_x [m] of a point; u and v are NaN if it is nearer than NEAR.

    Args:
        p_WL: the point in W (3).
        p_WB: the body's origin in W (3).
        R_WB: the body's attitude (3 x 3).
        p_BC: the camera's origin in B (3).
        f: focal length [px].
        c: principal point [px] (2).
    """
    return _pixel(in_body_frame(p_WL[0], p_WL[1], p_WL[2], p_WB, R_WB), p_BC, f, c)


@register_jitable
def _add_row(row: np.ndarray, share: float, p_BL: Point, g: Point, rpy: np.ndarray, R_WB: np.ndarray) -> None:
    """Add share * g^T d p_BL_B / d(p_WB, rpy) to a row (6); d p_BL_B = -R_WB^T d p_WB + p_BL_B x E d rpy."""
    # g . (p x e) = (g x p) . e = h . e, and E(rpy) column by column.
    h_x = g[1] * p_BL[2] - g[2] * p_BL[1]
    h_y = g[2] * p_BL[0] - g[0] * p_BL[2]
    h_z = g[0] * p_BL[1] - g[1] * p_BL[0]
    s_phi, c_phi, s_theta, c_theta = np.sin(rpy[0]), np.cos(rpy[0]), np.sin(rpy[1]), np.cos(rpy[1])
    for j in range(3):
        row[j] -= share * (R_WB[j, 0] * g[0] + R_WB[j, 1] * g[1] + R_WB[j, 2] * g[2])
    row[3] += share * h_x
    row[4] += share * (c_phi * h_y - s_phi * h_z)
    row[5] += share * (-s_theta * h_x + s_phi * c_theta * h_y + c_phi * c_theta * h_z)


@register_jitable
def _gradient(p_BL: Point, p_BC: np.ndarray, f: float, axis: int) -> Point:
    """Return d u / d p_BL_B (axis 0) or d v / d p_BL_B (axis 1)."""
    depth = p_BL[0] - p_BC[0]
    if axis == 0:
        return f * (p_BL[1] - p_BC[1]) / depth**2, -f / depth, 0.0
    return f * (p_BL[2] - p_BC[2]) / depth**2, 0.0, -f / depth


@njit(cache=True)
def projection_jacobian(
    p_WL: np.ndarray, p_WB: np.ndarray, rpy: np.ndarray, R_WB: np.ndarray, p_BC: np.ndarray, f: float
) -> np.ndarray:
    """Return d(u, v) / d(p_WB, rpy) (2 x 6) of a point in front; arguments as in project, and rpy (3)."""
    J = np.zeros((2, 6))
    p_BL = in_body_frame(p_WL[0], p_WL[1], p_WL[2], p_WB, R_WB)
    for axis in range(2):
        _add_row(J[axis], 1.0, p_BL, _gradient(p_BL, p_BC, f, axis), rpy, R_WB)
    return J


@register_jitable
def extent_corner(k: int, p_WL: np.ndarray, size: np.ndarray) -> Point:
    """Return corner k (0 to 7) in W of a box of that size along W's axes about p_WL."""
    return (
        p_WL[0] + (0.5 if k & 1 else -0.5) * size[0],
        p_WL[1] + (0.5 if k & 2 else -0.5) * size[1],
        p_WL[2] + (0.5 if k & 4 else -0.5) * size[2],
    )


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
    box[0] = box[1] = np.inf
    box[2] = box[3] = -np.inf
    for k in range(8):
        x, y, z = extent_corner(k, p_WL, size)
        u, v, depth = _pixel(in_body_frame(x, y, z, p_WB, R_WB), p_BC, f, c)
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
    extent's centre in the image is not where its centre in space is seen.
    False if a corner has no projection. Arguments as in extent_box, and rpy (3).
    """
    u_low = v_low = np.inf
    u_high = v_high = -np.inf
    left = right = top = bottom = 0
    for k in range(8):
        x, y, height = extent_corner(k, p_WL, size)
        u, v, depth = _pixel(in_body_frame(x, y, height, p_WB, R_WB), p_BC, f, c)
        if depth < NEAR:
            return False
        if u < u_low:
            u_low, left = u, k
        if u > u_high:
            u_high, right = u, k
        if v < v_low:
            v_low, top = v, k
        if v > v_high:
            v_high, bottom = v, k
    z[0], z[1] = 0.5 * (u_low + u_high), 0.5 * (v_low + v_high)
    J[:, :] = 0.0
    for axis, k in ((0, left), (0, right), (1, top), (1, bottom)):
        x, y, height = extent_corner(k, p_WL, size)
        p_BL = in_body_frame(x, y, height, p_WB, R_WB)
        _add_row(J[axis], 0.5, p_BL, _gradient(p_BL, p_BC, f, axis), rpy, R_WB)
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
    """Return where landmarks' centres in space are seen (n, 2), given their boxes' centres (n, 2).

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
