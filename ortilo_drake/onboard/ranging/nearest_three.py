"""Position from the three nearest anchors, as the authors solve it: three spheres meet in two points.

The solver takes the point nearer to the last estimate. Three spheres that do not meet give no fix: the position nearest
to all three lies in the plane of their anchors, where J has no information perpendicular to the plane.
"""

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.model.placing import fill
from ortilo_drake.model.triples import Triple, cross, dot, minus, plus, times, triple
from ortilo_drake.onboard.ranging.range_equations import NONE, Symmetric, fix_with_covariance, matrix

COLLINEAR = 1e-3  # sine of the angle between two anchors seen from a third, below which the three are on one line


@register_jitable
def next_nearest(ranges: np.ndarray, there: np.ndarray, used: np.ndarray) -> int:
    """Return the index of the smallest range that is there and not used yet, -1 for none; marks it as used."""
    best = -1
    for i in range(ranges.size):
        if there[i] != 0.0 and used[i] == 0.0 and (best < 0 or ranges[i] < ranges[best]):
            best = i
    if best >= 0:
        used[best] = 1.0
    return best


@cached_njit(_nrt=False)
def three_spheres(
    ranges: np.ndarray, there: np.ndarray, anchors: np.ndarray, noise: np.ndarray, p_last: Triple, used: np.ndarray
) -> tuple[bool, Triple, Symmetric]:
    """Intersect the spheres around the three nearest anchors (the authors' method), in closed form.

    In the frame of the anchors, a_1 at the origin, a_2 = (b, 0, 0), a_3 = (c, e, 0):
    x = (r_1^2 - r_2^2 + b^2) / 2b, y = (r_1^2 - r_3^2 + c^2 + e^2 - 2 c x) / 2e,
    z = +-sqrt(r_1^2 - x^2 - y^2).

    Nearest means the smallest range; the last estimate of p_WB selects one of the two points. Arguments as in
    range_equations.py; `used` (n) becomes 1 for used ranges and 0 for the others. Returns whether there is a fix, p_WB,
    and its covariance C [m^2].
    """
    fill(used, 0.0)
    no_fix = (False, p_last, NONE)
    first = next_nearest(ranges, there, used)
    second = next_nearest(ranges, there, used)
    third = next_nearest(ranges, there, used)
    if third < 0:
        return no_fix
    r_1, r_2, r_3 = ranges[first], ranges[second], ranges[third]
    a_1 = triple(anchors[first])
    to_2, to_3 = minus(triple(anchors[second]), a_1), minus(triple(anchors[third]), a_1)
    b = np.sqrt(dot(to_2, to_2))
    if not b > 0.0:
        return no_fix
    e_x = times(1.0 / b, to_2)
    c = dot(e_x, to_3)
    e_y = minus(to_3, times(c, e_x))
    e = np.sqrt(dot(e_y, e_y))
    if not e > COLLINEAR * np.sqrt(dot(to_3, to_3)):
        return no_fix
    e_y = times(1.0 / e, e_y)
    x = (r_1**2 - r_2**2 + b**2) / (2.0 * b)
    y = (r_1**2 - r_3**2 + c**2 + e**2 - 2.0 * c * x) / (2.0 * e)
    z_squared = r_1**2 - x**2 - y**2
    if not z_squared > 0.0:
        return no_fix
    foot = plus(a_1, plus(times(x, e_x), times(y, e_y)))
    up, z = cross(e_x, e_y), np.sqrt(z_squared)
    side = z if dot(minus(p_last, foot), up) >= 0.0 else -z
    return fix_with_covariance(plus(foot, times(side, up)), ranges, used, anchors, noise)


@cached_njit
def nearest_three(
    ranges: np.ndarray, there: np.ndarray, anchors: np.ndarray, noise: np.ndarray, p_last: np.ndarray
) -> tuple[bool, np.ndarray, np.ndarray]:
    """Return the result of three_spheres with position (3) and covariance (3, 3) as arrays."""
    found, p, C = three_spheres(ranges, there, anchors, noise, triple(p_last), np.zeros(ranges.size))
    return found, np.array(p), matrix(C)
