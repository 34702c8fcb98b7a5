"""The range equations shared by all methods of multilateration, and the position from all ranges.

The range model is r_i = |p - a_i| + v_i, v_i of standard deviation s_0 + s_1 r_i. With the unit vectors
u_i = (p - a_i) / |p - a_i| as the rows of J and R = diag(sd_i^2), the covariance of a position is

    C = (J^T R^-1 J)^-1,

which for three ranges is J^-1 R J^-T.

A range also has a lasting error of standard deviation s_2: the bias and the survey error of its anchor. The weights of
a fit have both errors in R. C covers only the part of the fit's error that is new in every fix, with R_v of v_i alone:
N^-1 (J^T R^-1 R_v R^-1 J) N^-1, N = J^T R^-1 J. The filter models the lasting part (estimator.biases.uwb_sd).

In all functions of ranging `ranges` are r_i [m] (n), `there` (or `used`) is 1 for a range that is there (or used), else
0 (n), `anchors` are a_i in W (n, 3) [m], and `noise` is s_0 [m], s_1 and, if it is not 0, s_2 [m] (2 or 3).

The position is the solution of weighted nonlinear least squares. With anchors in one plane, a position and its mirror
image fit equally well: the solver takes the one nearer to the last estimate.
"""

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.model.triples import Triple, dot, minus, plus, times, triple

MAX_SD = 10.0  # largest sqrt(tr C) of a fix [m]; a worse fix has no information in a room
REGULAR = 1e-15  # a symmetric matrix with a smaller scaled determinant is singular to rounding
MIN_SD = 1e-3  # smallest noise sd of a range [m]: otherwise r -> 0 would get infinite weight

Symmetric = tuple[float, float, float, float, float, float]  # xx, xy, xz, yy, yz, zz
NONE: Symmetric = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)  # the covariance of no fix


@cached_njit(error_model="numpy", _nrt=False)
def normal_equations(
    p: Triple | np.ndarray, ranges: np.ndarray, there: np.ndarray, anchors: np.ndarray, noise: np.ndarray
) -> tuple[float, Symmetric, Triple]:
    """Return the cost e^T R^-1 e, N = J^T R^-1 J (6) and g = J^T R^-1 e (3) at p, with e_i = r_i - |p - a_i|."""
    lasts = noise[2] if noise.size > 2 else 0.0
    cost = gx = gy = gz = xx = xy = xz = yy = yz = zz = 0.0
    for i in range(anchors.shape[0]):
        if there[i] == 0.0:
            continue
        x, y, z = p[0] - anchors[i, 0], p[1] - anchors[i, 1], p[2] - anchors[i, 2]
        d = np.sqrt(x * x + y * y + z * z) + 1e-30  # at an anchor u = 0, not 0 / 0
        w = 1.0 / (max(noise[0] + noise[1] * ranges[i], MIN_SD) ** 2 + lasts**2)
        e = ranges[i] - d
        x, y, z = x / d, y / d, z / d
        cost += w * e * e
        gx, gy, gz = gx + w * e * x, gy + w * e * y, gz + w * e * z
        xx, xy, xz = xx + w * x * x, xy + w * x * y, xz + w * x * z
        yy, yz, zz = yy + w * y * y, yz + w * y * z, zz + w * z * z
    return cost, (xx, xy, xz, yy, yz, zz), (gx, gy, gz)


@cached_njit(error_model="numpy")
def inverse(N: Symmetric) -> tuple[bool, Symmetric]:
    """Return whether a symmetric 3x3 matrix is positive definite to rounding, and its inverse (cofactors)."""
    xx, xy, xz, yy, yz, zz = N
    a, b, c = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
    determinant = xx * a + xy * b + xz * c
    if not (zz > 0.0 and a > 0.0 and determinant > REGULAR * xx * yy * zz):
        return False, N
    s = 1.0 / determinant
    return True, (a * s, b * s, c * s, (xx * zz - xz * xz) * s, (xy * xz - xx * yz) * s, (xx * yy - xy * xy) * s)


@cached_njit
def product(C: Symmetric, g: Triple | np.ndarray) -> Triple:
    """Return the product C g (3) of a symmetric 3x3 matrix C and a vector g (3)."""
    return (
        C[0] * g[0] + C[1] * g[1] + C[2] * g[2],
        C[1] * g[0] + C[3] * g[1] + C[4] * g[2],
        C[2] * g[0] + C[4] * g[1] + C[5] * g[2],
    )


@cached_njit(error_model="numpy", _nrt=False)
def covariance_of_the_new(
    p: Triple | np.ndarray, ranges: np.ndarray, there: np.ndarray, anchors: np.ndarray, noise: np.ndarray, C: Symmetric
) -> Symmetric:
    """Return the covariance of the new part of a fix's error, N^-1 (J^T R^-1 R_v R^-1 J) N^-1 at p, given C = N^-1."""
    xx = xy = xz = yy = yz = zz = 0.0
    for i in range(anchors.shape[0]):
        if there[i] == 0.0:
            continue
        x, y, z = p[0] - anchors[i, 0], p[1] - anchors[i, 1], p[2] - anchors[i, 2]
        d = np.sqrt(x * x + y * y + z * z) + 1e-30
        new = max(noise[0] + noise[1] * ranges[i], MIN_SD) ** 2
        w = new / ((new + noise[2] ** 2) * d) ** 2
        x, y, z = C[0] * x + C[1] * y + C[2] * z, C[1] * x + C[3] * y + C[4] * z, C[2] * x + C[4] * y + C[5] * z
        xx, xy, xz = xx + w * x * x, xy + w * x * y, xz + w * x * z
        yy, yz, zz = yy + w * y * y, yz + w * y * z, zz + w * z * z
    return xx, xy, xz, yy, yz, zz


@register_jitable(_nrt=False)
def fix_with_covariance(
    p: Triple, ranges: np.ndarray, there: np.ndarray, anchors: np.ndarray, noise: np.ndarray
) -> tuple[bool, Triple, Symmetric]:
    """Return whether p is a fix (N is definite and sqrt(tr C) is at most MAX_SD), p, and its covariance C."""
    definite, C = inverse(normal_equations(p, ranges, there, anchors, noise)[1])
    if definite and noise.size > 2 and noise[2] > 0.0:
        C = covariance_of_the_new(p, ranges, there, anchors, noise, C)
    if not (definite and C[0] + C[3] + C[5] <= MAX_SD**2):
        return False, p, NONE
    return True, p, C


@register_jitable
def matrix(C: Symmetric) -> np.ndarray:
    """Return a symmetric matrix as an array (3, 3)."""
    return np.array(((C[0], C[1], C[2]), (C[1], C[3], C[4]), (C[2], C[4], C[5])))


STEP = 1e-9  # a fit has converged when its last step is shorter [m]
MAX_STEPS = 100
POOR = 2.0  # a fit with a larger mean of (e_i / sd_i)^2 may be in a wrong minimum
FLAT = 0.01  # anchors within about this distance of one plane count as in one plane [m]


@cached_njit(_nrt=False)
def linear_start(ranges: np.ndarray, there: np.ndarray, anchors: np.ndarray) -> tuple[bool, Triple]:
    """Return whether a start value of p exists without an estimate (not with anchors in one plane), and this value.

    The squared ranges are linear in p and |p|^2. Subtracting the mean over the anchors removes |p|^2:
    2 (a_i - a_mean)^T p = b_i - b_mean with b_i = |a_i|^2 - r_i^2, solved by unweighted least squares.
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


@cached_njit(_nrt=False)
def descend(
    ranges: np.ndarray, there: np.ndarray, anchors: np.ndarray, noise: np.ndarray, p: Triple
) -> tuple[float, Triple]:
    """Return the least cost reached from p, and the position with this cost; cost inf without convergence.

    Gauss-Newton, damped (Levenberg) only if a step would raise the cost or N is singular. The cost never rises, so the
    descent cannot diverge.
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


@cached_njit(_nrt=False)
def fit_all(
    ranges: np.ndarray, there: np.ndarray, anchors: np.ndarray, noise: np.ndarray, p_last: Triple
) -> tuple[bool, Triple, Symmetric]:
    """Fit p to all ranges that are there: minimise sum_i (r_i - |p - a_i|)^2 / sd_i^2 from the last estimate.

    The cost has other minima, near mirror images of p. A fit worse than POOR is repeated from linear_start; the second
    fit is used if its cost is less than half.

    Arguments and returned values as in three_spheres, but without `used`.
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


@cached_njit
def least_squares(
    ranges: np.ndarray, there: np.ndarray, anchors: np.ndarray, noise: np.ndarray, p_last: np.ndarray
) -> tuple[bool, np.ndarray, np.ndarray]:
    """Return the result of fit_all with position (3) and covariance (3, 3) as arrays."""
    found, p, C = fit_all(ranges, there, anchors, noise, triple(p_last))
    return found, np.array(p), matrix(C)
