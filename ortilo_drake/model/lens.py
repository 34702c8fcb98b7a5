"""A lens with distortion, and pixels that are not square.

A point in the camera's frame C (x to the right, y down, z ahead) is at (x, y) = (x_C, y_C) / z_C in an undistorted
picture of focal length 1. The lens moves it to (x', y'). The pixel is u = c_u + f x', v = c_v + f a y', a the aspect.

Brown-Conrady (OpenCV's calib3d; plumb_bob and rational_polynomial of ROS, radtan of Kalibr), r^2 = x^2 + y^2:

    g = (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6)
    x' = g x + 2 p1 x y + p2 (r^2 + 2 x^2),   y' = g y + p1 (r^2 + 2 y^2) + 2 p2 x y

Fisheye (OpenCV's cv::fisheye, equidistant of ROS and Kalibr), theta = atan r:

    x' = s x,  y' = s y,  s = theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8) / r

Both polynomials may have a turning point, beyond which points far from the axis would appear in the picture again. A
point beyond the turning point has no pixel.
"""

from functools import lru_cache
from typing import Annotated, Final, Literal, NamedTuple

import numpy as np
from numba.extending import register_jitable
from numpy.polynomial import Polynomial
from pydantic import Field

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.model.elementary import arctan2, cos, sin

Distortion = Literal["none", "brown_conrady", "fisheye"]
Coefficients = Annotated[tuple[Annotated[float, Field(ge=-1e6, le=1e6)], ...], Field(max_length=8)]
_COUNTS = {"none": (0,), "brown_conrady": (4, 5, 8), "fisheye": (4,)}
FISHEYE, BROWN_CONRADY = 4, 8  # numbers of coefficients; a lens without distortion has 0
_ITERATIONS = 50
_CONVERGED = 1e-14
_WIDE = 1.05
QUARTER: Final = 0.5 * np.pi


class Lens(NamedTuple):
    """A lens, for compiled functions."""

    aspect: float
    """focal length along v divided by focal length along u [1]."""
    bend: np.ndarray
    """coefficients: none (0) without distortion; k1 ... k4 of a fisheye (4); k1, k2, p1, p2, k3, k4, k5, k6 of
    Brown-Conrady, in OpenCV's order (8)."""
    farthest: float
    """largest x^2 + y^2 that has a pixel."""
    reach: np.ndarray
    """largest |x| and |y| in the image (2)."""


STRAIGHT: Final = Lens(1.0, np.zeros(0), np.inf, np.full(2, np.inf))

Bent = tuple[float, float, float, float, float]


@register_jitable
def bent(x: float, y: float, bend: np.ndarray) -> Bent:
    """Return x', y', d x' / d x, d x' / d y = d y' / d x and d y' / d y of a lens with distortion.

    x and y are in the undistorted picture; `bend` are the coefficients (4) or (8) of Lens.
    """
    s = x * x + y * y
    if bend.size == FISHEYE:
        r = np.sqrt(s)
        if r < 1e-8:
            return x, y, 1.0, 0.0, 1.0
        theta = arctan2(r, 1.0)
        t = theta * theta
        scale = theta * (1.0 + t * (bend[0] + t * (bend[1] + t * (bend[2] + t * bend[3])))) / r
        slope = 1.0 + t * (3.0 * bend[0] + t * (5.0 * bend[1] + t * (7.0 * bend[2] + t * 9.0 * bend[3])))
        of_s = (slope / (1.0 + s) - scale) / s
        return scale * x, scale * y, scale + of_s * x * x, of_s * x * y, scale + of_s * y * y
    k_1, k_2, p_1, p_2, k_3, k_4, k_5, k_6 = bend[0], bend[1], bend[2], bend[3], bend[4], bend[5], bend[6], bend[7]
    above, below = 1.0 + s * (k_1 + s * (k_2 + s * k_3)), 1.0 + s * (k_4 + s * (k_5 + s * k_6))
    g = above / below
    of_s = (k_1 + s * (2.0 * k_2 + s * 3.0 * k_3) - g * (k_4 + s * (2.0 * k_5 + s * 3.0 * k_6))) / below
    return (
        g * x + 2.0 * p_1 * x * y + p_2 * (s + 2.0 * x * x),
        g * y + p_1 * (s + 2.0 * y * y) + 2.0 * p_2 * x * y,
        g + 2.0 * of_s * x * x + 2.0 * p_1 * y + 6.0 * p_2 * x,
        2.0 * of_s * x * y + 2.0 * p_1 * x + 2.0 * p_2 * y,
        g + 2.0 * of_s * y * y + 6.0 * p_1 * y + 2.0 * p_2 * x,
    )


@register_jitable
def _straight_of_fisheye(x: float, y: float, lens: Lens) -> tuple[float, float]:
    bend, r = lens.bend, np.sqrt(x * x + y * y)
    if r < 1e-8:
        return x, y
    most = arctan2(np.sqrt(lens.farthest), 1.0) if lens.farthest < np.inf else QUARTER
    low, high, theta = 0.0, most, min(r, most)
    for _ in range(_ITERATIONS):  # Newton's steps, with bisection if they leave the interval
        t = theta * theta
        e = theta * (1.0 + t * (bend[0] + t * (bend[1] + t * (bend[2] + t * bend[3])))) - r
        if e > 0.0:
            high = theta
        else:
            low = theta
        slope = 1.0 + t * (3.0 * bend[0] + t * (5.0 * bend[1] + t * (7.0 * bend[2] + t * 9.0 * bend[3])))
        following = theta - e / slope if slope > 0.0 else -1.0
        if not low <= following <= high:
            following = 0.5 * (low + high)
        done = abs(following - theta) <= _CONVERGED
        theta = following
        if done:
            break
    scale, t = sin(theta) / (cos(theta) * r), theta * theta
    reached = theta * (1.0 + t * (bend[0] + t * (bend[1] + t * (bend[2] + t * bend[3]))))
    if not (theta < most and scale > 0.0 and abs(reached - r) < 1e-9):
        return np.nan, np.nan
    return scale * x, scale * y


@cached_njit
def straightened(x: float, y: float, lens: Lens) -> tuple[float, float]:
    """Return the undistorted point that the lens moves to (x', y'), given here as x and y; NaN if there is none."""
    if lens.bend.size == 0:
        return x, y
    if lens.bend.size == FISHEYE:
        return _straight_of_fisheye(x, y, lens)
    a, b = x, y
    while a * a + b * b >= lens.farthest:
        a, b = 0.5 * a, 0.5 * b
    for _ in range(_ITERATIONS):
        u, v, d_xx, d_xy, d_yy = bent(a, b, lens.bend)
        e_u, e_v = x - u, y - v
        determinant = d_xx * d_yy - d_xy * d_xy
        if not determinant > 0.0:
            return np.nan, np.nan
        step_a, step_b = (d_yy * e_u - d_xy * e_v) / determinant, (d_xx * e_v - d_xy * e_u) / determinant
        for _ in range(_ITERATIONS):
            if (a + step_a) ** 2 + (b + step_b) ** 2 < lens.farthest:
                break
            step_a, step_b = 0.5 * step_a, 0.5 * step_b
        a, b = a + step_a, b + step_b
        if abs(step_a) + abs(step_b) <= _CONVERGED * (1.0 + abs(a) + abs(b)):
            u, v, _, _, _ = bent(a, b, lens.bend)
            return (a, b) if abs(u - x) + abs(v - y) < 1e-9 else (np.nan, np.nan)
    return np.nan, np.nan


def turning_point(bend: np.ndarray) -> float:
    """Return the smallest x^2 + y^2 of a turning point, without the tangential terms; inf if there is none."""

    def first_root(polynomial: Polynomial) -> float:
        roots = polynomial.trim().roots()
        real = roots.real[(np.abs(roots.imag) < 1e-9) & (roots.real > 0.0)]
        return float(real.min(initial=np.inf))

    if len(bend) == FISHEYE:
        theta = np.sqrt(first_root(Polynomial(np.array([1.0, *(np.array([3, 5, 7, 9]) * bend)]))))
        return float(np.tan(theta) ** 2) if theta < QUARTER else np.inf
    k_1, k_2, _, _, k_3, k_4, k_5, k_6 = bend
    s, above, below = Polynomial([0.0, 1.0]), Polynomial([1.0, k_1, k_2, k_3]), Polynomial([1.0, k_4, k_5, k_6])
    # d (r g) / d r as a function of s = r^2, times the square of the denominator of g.
    slope = (above + 2.0 * s * above.deriv()) * below - 2.0 * s * above * below.deriv()
    return min(first_root(slope), first_root(below))


Pair = tuple[float, float]


@lru_cache(maxsize=64)
def make_lens(
    coefficients: tuple[float, ...], aspect: float, focal_length: float, center: Pair, image: Pair
) -> tuple[Lens, bool]:
    """Return a camera's lens, and whether the points half way from the centre to each side of the image have rays.

    Coefficients and aspect as in Lens; focal_length (along u), center (the principal point) and image (width and
    height) are in [px].
    """
    if not coefficients:
        return STRAIGHT._replace(aspect=aspect), True
    bend = np.array(coefficients)
    lens = Lens(aspect, bend, turning_point(bend), np.zeros(2))
    f = focal_length * np.array([1.0, aspect])
    u, v = (np.linspace(-0.5, side - 0.5, 65) for side in image)
    border = np.array([*((a, b) for a in u for b in (v[0], v[-1])), *((a, b) for b in v for a in (u[0], u[-1]))])
    rays = np.array([straightened(*(border_point - center) / f, lens) for border_point in border])
    rays[np.isnan(rays)] = np.sqrt(lens.farthest)
    sides = np.array([[u[0], center[1]], [u[-1], center[1]], [center[0], v[0]], [center[0], v[-1]]])
    half = np.array([straightened(*(0.5 * (side - center) / f), lens) for side in sides])
    # A margin beyond the samples of the border.
    return lens._replace(reach=_WIDE * np.abs(rays).max(axis=0)), not bool(np.isnan(half).any())


def check_count(distortion: str, coefficients: tuple[float, ...]) -> None:
    """Raise ValueError, for a model's validator, if the distortion does not have this number of coefficients."""
    allowed = _COUNTS[distortion]
    if len(coefficients) not in allowed:
        counts = " or ".join(map(str, allowed))
        raise ValueError(f".coefficients: {len(coefficients)} of them: {distortion} has {counts}")
