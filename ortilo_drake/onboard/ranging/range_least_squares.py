"""Position from all ranges by weighted nonlinear least squares.

Anchors in one plane cannot tell a position from its mirror image: the one nearer to the last estimate is taken.
"""

import numpy as np
from numba import njit

from ortilo_drake.model.triples import Triple, dot, minus, plus, times, triple
from ortilo_drake.onboard.ranging.range_equations import (
    NONE,
    Symmetric,
    fix_with_covariance,
    inverse,
    matrix,
    normal_equations,
    product,
)

STEP = 1e-9  # a fit has converged when its last step is shorter [m]
MAX_STEPS = 100
POOR = 2.0  # a fit with a greater mean of (e_i / sd_i)^2 may sit in a wrong minimum
FLAT = 0.01  # anchors within about this of one plane count as in one plane [m]


@njit(cache=True, _nrt=False)
def linear_start(ranges: np.ndarray, there: np.ndarray, anchors: np.ndarray) -> tuple[bool, Triple]:
    """Return whether there is a first guess of p without an estimate (not with anchors in one plane), and it.

    The squared ranges are linear in p and |p|^2. Less their mean over the anchors, b_i for a_i, |p|^2 is
    gone: 2 (a_i - a_mean)^T p = |a_i|^2 - r_i^2 - b_mean, solved by unweighted least squares.
    """
    count, a_mean, b_mean = 0, (0.0, 0.0, 0.0), 0.0
    for i in range(len(ranges)):
        if there[i] != 0.0:
            a = triple(anchors[i])
            count, a_mean, b_mean = count + 1, plus(a_mean, a), b_mean + dot(a, a) - ranges[i] ** 2
    a_mean = times(1.0 / count, a_mean)
    b_mean /= count
    g = (0.0, 0.0, 0.0)
    xx = xy = xz = yy = yz = zz = 0.0
    for i in range(len(ranges)):
        if there[i] != 0.0:
            a = triple(anchors[i])
            x, y, z = minus(a, a_mean)
            g = plus(g, times((dot(a, a) - ranges[i] ** 2 - b_mean) / 2.0, (x, y, z)))
            xx, xy, xz = xx + x * x, xy + x * y, xz + x * z
            yy, yz, zz = yy + y * y, yz + y * z, zz + z * z
    definite, C = inverse((xx, xy, xz, yy, yz, zz))
    return definite and C[0] + C[3] + C[5] < 1.0 / FLAT**2, product(C, g)


@njit(cache=True, _nrt=False)
def descend(
    ranges: np.ndarray, there: np.ndarray, anchors: np.ndarray, noise: np.ndarray, p: Triple
) -> tuple[float, Triple]:
    """Return the least cost reached from p, and where; cost inf without convergence.

    Gauss-Newton, damped (Levenberg) only where a step would raise the cost or N is singular; the cost never
    rises, so the descent cannot run away.
    """
    cost, N, g = normal_equations(p, ranges, there, anchors, noise)
    damping = 0.0
    for _ in range(MAX_STEPS):
        k = damping * (N[0] + N[3] + N[5])
        definite, C = inverse((N[0] + k, N[1], N[2], N[3] + k, N[4], N[5] + k))
        if definite:
            s = product(C, g)
            new_p = plus(p, s)
            new_cost, new_N, new_g = normal_equations(new_p, ranges, there, anchors, noise)
            short = dot(s, s) < STEP**2
            if new_cost <= cost or short:
                p, cost, N, g = new_p, new_cost, new_N, new_g
                if short:
                    return cost, p
                damping = damping / 10.0 if damping > 1e-6 else 0.0
                continue
        damping = max(10.0 * damping, 1e-3)
    return np.inf, p


@njit(cache=True, _nrt=False)
def fit_all(
    ranges: np.ndarray, there: np.ndarray, anchors: np.ndarray, noise: np.ndarray, p_last: Triple
) -> tuple[bool, Triple, Symmetric]:
    """Fit p to all ranges there are, minimising sum_i (r_i - |p - a_i|)^2 / sd_i^2, from the last estimate.

    The cost has other minima, near mirror images of p. A fit worse than POOR is tried again from
    linear_start, and that second fit is taken if it has less than half the cost.

    Arguments and returns as three_spheres, but for its room to work in.
    """
    count = np.sum(there)
    if count < 3.0:
        return False, p_last, NONE
    cost, p = descend(ranges, there, anchors, noise, p_last)
    if not cost <= POOR * count:
        possible, p_start = linear_start(ranges, there, anchors)
        if possible:
            new_cost, new_p = descend(ranges, there, anchors, noise, p_start)
            if new_cost < cost / 2.0:
                cost, p = new_cost, new_p
    if not cost < np.inf:
        return False, p_last, NONE
    return fix_with_covariance(p, ranges, there, anchors, noise)


@njit(cache=True)
def least_squares(
    ranges: np.ndarray, there: np.ndarray, anchors: np.ndarray, noise: np.ndarray, p_last: np.ndarray
) -> tuple[bool, np.ndarray, np.ndarray]:
    """Return fit_all with position (3) and covariance (3, 3) as arrays."""
    found, p, C = fit_all(ranges, there, anchors, noise, triple(p_last))
    return found, np.array(p), matrix(C)
