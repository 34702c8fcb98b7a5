"""The pinhole camera on the vehicle, with which the world draws and the onboard half predicts.

The camera frame C is at p_BC and looks along B's x axis: C's z is B's x, C's x is -B's y, C's y is -B's z. A point L
has

    p_BL_B = R_WB^T (p_WL - p_WB),  q = p_BL_B - p_BC,  u = c_u - f q_y / q_x,  v = c_v - f q_z / q_x

through a lens without distortion and with square pixels. For other lenses see model/lens.py, with x = -q_y / q_x and
y = -q_z / q_x.

A small rotation e of the body (in B, R_WB -> R_WB exp([e]x)) moves the point by d p_BL_B = p_BL_B x e, where
e = E(rpy) d(rpy) with the E of the Euler-angle rates (model/equations.py). A pixel's centre has integer coordinates, so
the image extends from -1/2 to its size - 1/2.

A landmark's box in an image is the box of its outline, points that span its convex hull. They are offsets from the
landmark's surveyed position p_WL in the axes of W (m, 3), see Room.landmark_outlines.

Points and pixels are numbers and tuples inside: arrays would cost more than the arithmetic, and so would reference
counting of arrays passed to a helper that is called for every derivative.
"""

from typing import NamedTuple

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.model.elementary import sin_cos
from ortilo_drake.model.lens import STRAIGHT, Lens, bent, straightened

Point = tuple[float, float, float]
Sines = tuple[float, float, float, float]
Pair = tuple[float, float]
View = tuple[Point, Pair, Pair, float]  # p_BC, f along u and v, c, and the lens' `farthest`, see Camera

R_BC = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])

NEAR = 0.1  # points nearer than this in front of the camera have no projection [m]


class Camera(NamedTuple):
    """The camera, for compiled functions."""

    p_BC: np.ndarray
    """origin of C in B [m] (3)."""
    f: float
    """focal length along u [px]."""
    c: np.ndarray
    """principal point [px] (2)."""
    image: np.ndarray
    """width and height of the image [px] (2)."""
    lens: Lens = STRAIGHT
    """distortion of the lens and aspect of the pixels."""


@register_jitable
def in_body_frame(x: float, y: float, z: float, p_WB: np.ndarray, R_WB: np.ndarray) -> Point:
    """Return p_BL_B = R_WB^T (p_WL - p_WB), given p_WL = (x, y, z)."""
    x, y, z = x - p_WB[0], y - p_WB[1], z - p_WB[2]
    return (
        R_WB[0, 0] * x + R_WB[1, 0] * y + R_WB[2, 0] * z,
        R_WB[0, 1] * x + R_WB[1, 1] * y + R_WB[2, 1] * z,
        R_WB[0, 2] * x + R_WB[1, 2] * y + R_WB[2, 2] * z,
    )


@register_jitable(error_model="numpy", _nrt=False)
def _view_of(camera: Camera) -> View:
    """Return the camera's numbers without the lens' coefficients, read once for all points."""
    p_BC, c, f = camera.p_BC, camera.c, camera.f
    return (p_BC[0], p_BC[1], p_BC[2]), (f, f * camera.lens.aspect), (c[0], c[1]), camera.lens.farthest


@register_jitable(error_model="numpy", _nrt=False)
def _pixel(p_BL: Point, view: View, bend: np.ndarray) -> Point:
    """Return u, v and the depth q_x; without a projection u, v are NaN, beyond the lens' turning point also q_x."""
    p_BC, f, c, farthest = view
    depth = p_BL[0] - p_BC[0]
    if not depth >= NEAR:  # also true for NaN
        return np.nan, np.nan, depth
    if bend.size > 0:
        x, y = (p_BC[1] - p_BL[1]) / depth, (p_BC[2] - p_BL[2]) / depth
        if not x * x + y * y < farthest:
            return np.nan, np.nan, np.nan
        x, y, _, _, _ = bent(x, y, bend)
        return c[0] + f[0] * x, c[1] + f[1] * y, depth
    u = c[0] - f[0] * (p_BL[1] - p_BC[1]) / depth
    v = c[1] - f[1] * (p_BL[2] - p_BC[2]) / depth
    return u, v, depth


@cached_njit
def project(p_WL: np.ndarray, p_WB: np.ndarray, R_WB: np.ndarray, camera: Camera) -> Point:
    """Return u, v [px] and the depth q_x [m] of a point; u and v are NaN if it is nearer than NEAR.

    All three are NaN beyond the lens' turning point. The point p_WL and the body's origin p_WB are in W (3), R_WB is
    the body's attitude (3 x 3).
    """
    return _pixel(in_body_frame(p_WL[0], p_WL[1], p_WL[2], p_WB, R_WB), _view_of(camera), camera.lens.bend)


@register_jitable
def _outline_point(k: int, p_WL: np.ndarray, outline: np.ndarray, p_WB: np.ndarray, R_WB: np.ndarray) -> Point:
    """Return point k of an outline in B [m]."""
    x, y, z = p_WL[0] + outline[k, 0], p_WL[1] + outline[k, 1], p_WL[2] + outline[k, 2]
    return in_body_frame(x, y, z, p_WB, R_WB)


@cached_njit(error_model="numpy", _nrt=False)
def extent_box(
    p_WL: np.ndarray, outline: np.ndarray, p_WB: np.ndarray, R_WB: np.ndarray, camera: Camera, box: np.ndarray
) -> bool:
    """Write (u_min, v_min, u_max, v_max) [px] of an outline, not cut at the image border, to box (4).

    False if a point has no projection. Arguments as in project, and outline (m, 3) [m].
    """
    u_low = v_low = np.inf
    u_high = v_high = -np.inf
    view, bend = _view_of(camera), camera.lens.bend
    for k in range(outline.shape[0]):
        u, v, depth = _pixel(_outline_point(k, p_WL, outline, p_WB, R_WB), view, bend)
        if not depth >= NEAR:
            return False
        u_low, v_low, u_high, v_high = min(u_low, u), min(v_low, v), max(u_high, u), max(v_high, v)
    box[0], box[1], box[2], box[3] = u_low, v_low, u_high, v_high
    return True


@register_jitable(error_model="numpy", _nrt=False)
def _gradient(p: Point, p_BC: Point, f: float, axis: int) -> tuple[float, float, float, float, float, float]:
    """Return g = d u / d p_BL_B (axis 0) or d v / d p_BL_B (axis 1) at p, and g x p."""
    depth = p[0] - p_BC[0]
    scale = -f / depth
    if axis == 0:
        g_x = -scale * (p[1] - p_BC[1]) / depth
        return g_x, scale, 0.0, scale * p[2], -g_x * p[2], g_x * p[1] - scale * p[0]
    g_x = -scale * (p[2] - p_BC[2]) / depth
    return g_x, 0.0, scale, -scale * p[1], scale * p[0] - g_x * p[2], g_x * p[1]


@register_jitable(error_model="numpy", _nrt=False)
def _bent_gradient(p: Point, p_BC: Point, camera: Camera, axis: int) -> tuple[float, float, float, float, float, float]:
    """Return g and g x p as _gradient does, for a lens with distortion."""
    depth = p[0] - p_BC[0]
    _, _, d_xx, d_xy, d_yy = bent((p_BC[1] - p[1]) / depth, (p_BC[2] - p[2]) / depth, camera.lens.bend)
    of_x, of_y = _gradient(p, p_BC, camera.f, 0), _gradient(p, p_BC, camera.f, 1)
    along_x, along_y = (d_xx, d_xy) if axis == 0 else (camera.lens.aspect * d_xy, camera.lens.aspect * d_yy)
    return (
        along_x * of_x[0] + along_y * of_y[0],
        along_x * of_x[1] + along_y * of_y[1],
        along_x * of_x[2] + along_y * of_y[2],
        along_x * of_x[3] + along_y * of_y[3],
        along_x * of_x[4] + along_y * of_y[4],
        along_x * of_x[5] + along_y * of_y[5],
    )


@register_jitable
def sines(rpy: np.ndarray) -> Sines:
    """Return sin phi, cos phi, sin theta, cos theta, given roll, pitch, yaw (3) [rad]."""
    return *sin_cos(rpy[0]), *sin_cos(rpy[1])


@cached_njit(error_model="numpy", _nrt=False)
def box_and_jacobian(
    p_WL: np.ndarray,
    outline: np.ndarray,
    p_WB: np.ndarray,
    of_rpy: Sines,
    R_WB: np.ndarray,
    camera: Camera,
    box: np.ndarray,
    J: np.ndarray,
) -> bool:
    """Write an outline's box to box (4), see extent_box, and its centre's d z / d(p_WB, rpy) to J (2 x 6).

    Each coordinate of the centre is the mean of the projections of two points, and so is its derivative. For a near
    outline, the centre of the box is not the projection of the centre in space.

    False if a point has no projection. of_rpy comes from `sines`; other arguments as in extent_box.
    """
    u_low = v_low = np.inf
    u_high = v_high = -np.inf
    left = right = top = bottom = 0
    view, bend = _view_of(camera), camera.lens.bend
    for k in range(outline.shape[0]):
        u, v, depth = _pixel(_outline_point(k, p_WL, outline, p_WB, R_WB), view, bend)
        if not depth >= NEAR:
            return False
        if u < u_low:
            u_low, left = u, k
        if u > u_high:
            u_high, right = u, k
        if v < v_low:
            v_low, top = v, k
        if v > v_high:
            v_high, bottom = v, k
    box[0], box[1], box[2], box[3] = u_low, v_low, u_high, v_high
    # d p_BL_B = -R_WB^T d p_WB + p_BL_B x E d rpy, and g . (p x e) = (g x p) . e; E(rpy) column by column.
    s_phi, c_phi, s_theta, c_theta = of_rpy
    p_BC = view[0]
    for axis, low, high in ((0, left, right), (1, top, bottom)):
        p, q = _outline_point(low, p_WL, outline, p_WB, R_WB), _outline_point(high, p_WL, outline, p_WB, R_WB)
        if bend.size > 0:
            a, b = _bent_gradient(p, p_BC, camera, axis), _bent_gradient(q, p_BC, camera, axis)
        else:
            f = camera.f if axis == 0 else camera.f * camera.lens.aspect
            a, b = _gradient(p, p_BC, f, axis), _gradient(q, p_BC, f, axis)
        g_x, g_y, g_z = 0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1]), 0.5 * (a[2] + b[2])
        h_x, h_y, h_z = 0.5 * (a[3] + b[3]), 0.5 * (a[4] + b[4]), 0.5 * (a[5] + b[5])
        for j in range(3):
            J[axis, j] = -(R_WB[j, 0] * g_x + R_WB[j, 1] * g_y + R_WB[j, 2] * g_z)
        J[axis, 3] = h_x
        J[axis, 4] = c_phi * h_y - s_phi * h_z
        J[axis, 5] = -s_theta * h_x + s_phi * c_theta * h_y + c_phi * c_theta * h_z
    return True


@cached_njit
def box_center(
    p_WL: np.ndarray,
    outline: np.ndarray,
    p_WB: np.ndarray,
    rpy: np.ndarray,
    R_WB: np.ndarray,
    camera: Camera,
    z: np.ndarray,
    J: np.ndarray,
) -> bool:
    """Write the centre of an outline's box to z (2) and d z / d(p_WB, rpy) to J (2 x 6), see box_and_jacobian.

    False if a point has no projection. rpy (3) [rad] is the attitude; other arguments as in extent_box.
    """
    box = np.empty(4)
    if not box_and_jacobian(p_WL, outline, p_WB, sines(rpy), R_WB, camera, box, J):
        return False
    z[0], z[1] = 0.5 * (box[0] + box[2]), 0.5 * (box[1] + box[3])
    return True


@cached_njit
def point_pixels(
    centers: np.ndarray,
    positions: np.ndarray,
    outlines: np.ndarray,
    p_WB: np.ndarray,
    R_WB: np.ndarray,
    camera: Camera,
) -> np.ndarray:
    """Return the pixels of the landmarks' positions in space (n, 2), given the centres of their boxes (n, 2).

    The difference of the two is computed at the pose p_WB, R_WB; NaN if a landmark has no projection at this pose.
    """
    pixels, box = np.empty_like(centers), np.empty(4)
    for i in range(centers.shape[0]):
        u, v, _ = project(positions[i], p_WB, R_WB, camera)
        if not extent_box(positions[i], outlines[i], p_WB, R_WB, camera, box):
            u = v = np.nan
        pixels[i, 0] = centers[i, 0] - 0.5 * (box[0] + box[2]) + u
        pixels[i, 1] = centers[i, 1] - 0.5 * (box[1] + box[3]) + v
    return pixels


@cached_njit
def straight_pixels(pixels: np.ndarray, camera: Camera) -> np.ndarray:
    """Return pixels (n, 2) without distortion, for square pixels of focal length f; NaN if a pixel has no ray."""
    lens = camera.lens
    if lens.bend.size == 0 and lens.aspect == 1.0:
        return pixels
    found = np.empty_like(pixels)
    for i in range(pixels.shape[0]):
        x, y = (pixels[i, 0] - camera.c[0]) / camera.f, (pixels[i, 1] - camera.c[1]) / (camera.f * lens.aspect)
        x, y = straightened(x, y, lens)
        found[i, 0], found[i, 1] = camera.c[0] + camera.f * x, camera.c[1] + camera.f * y
    return found
