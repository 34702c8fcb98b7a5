"""Position from the three nearest anchors, as the authors solve it: three spheres meet in two points.

The point nearer to the last estimate is taken. Three spheres that do not meet give no fix: the position nearest to
all three lies in the plane of their anchors, and across that plane J says nothing.
"""

import numpy as np
from numba import njit

from ortilo_drake.onboard.ranging.range_equations import fix_with_covariance

COLLINEAR = 1e-3  # sine of the angle between two anchors seen from a third, below which they are on one line


@njit(cache=True)
def nearest_three(
    ranges: np.ndarray, there: np.ndarray, anchors: np.ndarray, noise: np.ndarray, p_last: np.ndarray
) -> tuple[bool, np.ndarray, np.ndarray]:
    """Intersect the spheres around the three nearest anchors (the authors' method), in closed form.

    In the frame of the anchors, a_1 at the origin, a_2 = (b, 0, 0), a_3 = (c, e, 0):
    x = (r_1^2 - r_2^2 + b^2) / 2b, y = (r_1^2 - r_3^2 + c^2 + e^2 - 2 c x) / 2e,
    z = +-sqrt(r_1^2 - x^2 - y^2).

    Args:
        ranges: r_i [m] (n); nearest means the smallest.
        there: 1 where a range is there, else 0 (n).
        anchors: a_i in W (n, 3).
        noise: s_0 [m] and s_1, and s_2 [m] where it is not 0 (2 or 3), see range_equations.py.
        p_last: the last estimate of p_WB, which picks between the two points (3).

    Returns:
        Whether there is a fix; p_WB (3); its covariance C [m^2] (3, 3).
    """
    used = np.zeros(len(ranges))
    nearest = np.empty(3, dtype=np.int64)
    for j in range(3):
        best = -1
        for i in range(len(ranges)):
            if there[i] != 0.0 and used[i] == 0.0 and (best < 0 or ranges[i] < ranges[best]):
                best = i
        if best < 0:
            return False, p_last, np.zeros((3, 3))
        used[best] = 1.0
        nearest[j] = best
    r_1, r_2, r_3 = ranges[nearest[0]], ranges[nearest[1]], ranges[nearest[2]]
    a_1 = anchors[nearest[0]]
    to_2, to_3 = anchors[nearest[1]] - a_1, anchors[nearest[2]] - a_1
    b = np.sqrt(np.sum(to_2**2))
    if not b > 0.0:
        return False, p_last, np.zeros((3, 3))
    e_x = to_2 / b
    c = np.sum(e_x * to_3)
    e_y = to_3 - c * e_x
    e = np.sqrt(np.sum(e_y**2))
    if not e > COLLINEAR * np.sqrt(np.sum(to_3**2)):
        return False, p_last, np.zeros((3, 3))
    e_y = e_y / e
    x = (r_1**2 - r_2**2 + b**2) / (2.0 * b)
    y = (r_1**2 - r_3**2 + c**2 + e**2 - 2.0 * c * x) / (2.0 * e)
    z_squared = r_1**2 - x**2 - y**2
    if not z_squared > 0.0:
        return False, p_last, np.zeros((3, 3))
    foot = a_1 + x * e_x + y * e_y
    up = np.cross(e_x, e_y)
    z = np.sqrt(z_squared)
    p = foot + z * up if np.sum((p_last - foot) * up) >= 0.0 else foot - z * up
    return fix_with_covariance(p, ranges, used, anchors, noise)
