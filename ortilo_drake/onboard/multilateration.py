"""Position from ranges to surveyed anchors (paper, section III-A).

The range model is r_i = |p - a_i| + v_i, v_i of standard deviation s_0 + s_1 r_i. Either the spheres of the
three nearest anchors are met, as the authors do, or all ranges are fitted by weighted least squares. Both
covariances come from the geometry: with the unit vectors u_i = (p - a_i) / |p - a_i| as the rows of J
and R = diag(sd_i^2),

    C = (J^T R^-1 J)^-1,

which for three ranges is J^-1 R J^-T. Anchors in one plane cannot tell a position from its mirror image:
the one nearer to the last estimate is taken.

There is *no fix* with fewer than three ranges, from anchors on one line, where C is worse than MAX_SD, or if
the fit does not converge. Three spheres that do not meet give none either: the position nearest to all three
lies in the plane of their anchors, and across that plane J says nothing.
"""

import numpy as np
from numba import njit
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from ortilo_drake.model.signals import ARRIVED, FIX_SIZE, N_XBAR, uwb_size
from ortilo_drake.scenario import Multilateration as MultilaterationSettings

MAX_SD = 10.0  # a fix less certain than this, sqrt(tr C) [m], says nothing in a room
MIN_SD = 1e-3  # no range is believed better than this [m]: r -> 0 would else get infinite weight
COLLINEAR = 1e-3  # sine of the angle between two anchors seen from a third, below which they are on one line
STEP = 1e-9  # a fit has converged when its last step is shorter [m]
MAX_STEPS = 100
POOR = 2.0  # a fit with a greater mean of (e_i / sd_i)^2 may sit in a wrong minimum
FLAT = 0.01  # anchors within about this of one plane count as in one plane [m]

Symmetric = tuple[float, float, float, float, float, float]  # xx, xy, xz, yy, yz, zz


@njit(cache=True)
def normal_equations(
    p: np.ndarray, ranges: np.ndarray, there: np.ndarray, anchors: np.ndarray, noise: np.ndarray
) -> tuple[float, Symmetric, np.ndarray]:
    """Return the cost e^T R^-1 e, N = J^T R^-1 J and g = J^T R^-1 e at p, with e_i = r_i - |p - a_i|."""
    cost = gx = gy = gz = xx = xy = xz = yy = yz = zz = 0.0
    for i in range(anchors.shape[0]):
        if there[i] == 0.0:
            continue
        x, y, z = p[0] - anchors[i, 0], p[1] - anchors[i, 1], p[2] - anchors[i, 2]
        d = np.sqrt(x * x + y * y + z * z) + 1e-300  # at an anchor u = 0, not 0 / 0
        w = 1.0 / max(noise[0] + noise[1] * ranges[i], MIN_SD) ** 2
        e = ranges[i] - d
        x, y, z = x / d, y / d, z / d
        cost += w * e * e
        gx, gy, gz = gx + w * e * x, gy + w * e * y, gz + w * e * z
        xx, xy, xz = xx + w * x * x, xy + w * x * y, xz + w * x * z
        yy, yz, zz = yy + w * y * y, yz + w * y * z, zz + w * z * z
    return cost, (xx, xy, xz, yy, yz, zz), np.array([gx, gy, gz])


@njit(cache=True)
def inverse(N: Symmetric) -> tuple[bool, Symmetric]:
    """Return whether a symmetric 3x3 matrix is positive definite to rounding, and its inverse (cofactors)."""
    xx, xy, xz, yy, yz, zz = N
    a, b, c = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
    determinant = xx * a + xy * b + xz * c
    if not (zz > 0.0 and a > 0.0 and determinant > 1e-15 * xx * yy * zz):
        return False, N
    s = 1.0 / determinant
    return True, (
        a * s,
        b * s,
        c * s,
        (xx * zz - xz * xz) * s,
        (xy * xz - xx * yz) * s,
        (xx * yy - xy * xy) * s,
    )


@njit(cache=True)
def product(C: Symmetric, g: np.ndarray) -> np.ndarray:
    """Return C g (3)."""
    return np.array(
        [
            C[0] * g[0] + C[1] * g[1] + C[2] * g[2],
            C[1] * g[0] + C[3] * g[1] + C[4] * g[2],
            C[2] * g[0] + C[4] * g[1] + C[5] * g[2],
        ]
    )


@njit(cache=True)
def _fix(p: np.ndarray, N: Symmetric) -> tuple[bool, np.ndarray, np.ndarray]:
    """Return whether N makes p a fix, p and C = N^-1 (3, 3)."""
    definite, C = inverse(N)
    if not (definite and C[0] + C[3] + C[5] <= MAX_SD**2):
        return False, p, np.zeros((3, 3))
    return True, p, np.array([[C[0], C[1], C[2]], [C[1], C[3], C[4]], [C[2], C[4], C[5]]])


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
        noise: s_0 [m] and s_1 (2).
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
    N = normal_equations(p, ranges, used, anchors, noise)[1]
    return _fix(p, N)


@njit(cache=True)
def linear_start(ranges: np.ndarray, there: np.ndarray, anchors: np.ndarray) -> tuple[bool, np.ndarray]:
    """Return whether there is a first guess of p without an estimate (not with anchors in one plane), and it.

    The squared ranges are linear in p and |p|^2. Less their mean over the anchors, b_i for a_i, |p|^2 is
    gone: 2 (a_i - a_mean)^T p = |a_i|^2 - r_i^2 - b_mean, solved by unweighted least squares.
    """
    count, a_mean, b_mean = 0, np.zeros(3), 0.0
    for i in range(len(ranges)):
        if there[i] != 0.0:
            count += 1
            a_mean += anchors[i]
            b_mean += np.sum(anchors[i] ** 2) - ranges[i] ** 2
    a_mean /= count
    b_mean /= count
    g = np.zeros(3)
    xx = xy = xz = yy = yz = zz = 0.0
    for i in range(len(ranges)):
        if there[i] != 0.0:
            x, y, z = anchors[i] - a_mean
            g += (anchors[i] - a_mean) * (np.sum(anchors[i] ** 2) - ranges[i] ** 2 - b_mean) / 2.0
            xx, xy, xz = xx + x * x, xy + x * y, xz + x * z
            yy, yz, zz = yy + y * y, yz + y * z, zz + z * z
    definite, C = inverse((xx, xy, xz, yy, yz, zz))
    return definite and C[0] + C[3] + C[5] < 1.0 / FLAT**2, product(C, g)


@njit(cache=True)
def descend(
    ranges: np.ndarray, there: np.ndarray, anchors: np.ndarray, noise: np.ndarray, p_start: np.ndarray
) -> tuple[float, np.ndarray, Symmetric]:
    """Return the least cost reached from p_start, where, and N there; cost inf without convergence.

    Gauss-Newton, damped (Levenberg) only where a step would raise the cost or N is singular; the cost never
    rises, so the descent cannot run away.
    """
    p = p_start.copy()
    cost, N, g = normal_equations(p, ranges, there, anchors, noise)
    damping = 0.0
    for _ in range(MAX_STEPS):
        k = damping * (N[0] + N[3] + N[5])
        definite, C = inverse((N[0] + k, N[1], N[2], N[3] + k, N[4], N[5] + k))
        if definite:
            s = product(C, g)
            new_cost, new_N, new_g = normal_equations(p + s, ranges, there, anchors, noise)
            short = np.sum(s**2) < STEP**2
            if new_cost <= cost or short:
                p, cost, N, g = p + s, new_cost, new_N, new_g
                if short:
                    return cost, p, N
                damping = damping / 10.0 if damping > 1e-6 else 0.0
                continue
        damping = max(10.0 * damping, 1e-3)
    return np.inf, p, N


@njit(cache=True)
def least_squares(
    ranges: np.ndarray, there: np.ndarray, anchors: np.ndarray, noise: np.ndarray, p_last: np.ndarray
) -> tuple[bool, np.ndarray, np.ndarray]:
    """Fit p to all ranges there are, minimising sum_i (r_i - |p - a_i|)^2 / sd_i^2, from the last estimate.

    The cost has other minima, near mirror images of p. A fit worse than POOR is tried again from
    linear_start, and that second fit is taken if it has less than half the cost. Arguments and returns as
    nearest_three.
    """
    count = np.sum(there)
    if count < 3.0:
        return False, p_last, np.zeros((3, 3))
    cost, p, N = descend(ranges, there, anchors, noise, p_last)
    if not cost <= POOR * count:
        possible, p_start = linear_start(ranges, there, anchors)
        if possible:
            new_cost, new_p, new_N = descend(ranges, there, anchors, noise, p_start)
            if new_cost < cost / 2.0:
                cost, p, N = new_cost, new_p, new_N
    if not cost < np.inf:
        return False, p_last, np.zeros((3, 3))
    return _fix(p, N)


@njit(cache=True)
def fix_message(uwb: np.ndarray, anchors: np.ndarray, noise: np.ndarray, xhat: np.ndarray, three: bool) -> np.ndarray:
    """Return the fix message (14) of a uwb message (2 + 2 n) that arrived; zeros if there is no fix."""
    message = np.zeros(14)
    n = anchors.shape[0]
    ranges, there, p_last = uwb[2 : 2 + n], uwb[2 + n :], xhat[:3]
    if three:
        found, p, C = nearest_three(ranges, there, anchors, noise, p_last)
    else:
        found, p, C = least_squares(ranges, there, anchors, noise, p_last)
    if found:
        message[0] = 1.0
        message[1] = uwb[1]
        message[2:5] = p
        for i in range(3):
            message[5 + 3 * i : 8 + 3 * i] = C[i]
    return message


class Multilateration(LeafSystem):
    """A memoryless solver for the position of the UWB antenna.

    Ports:
        uwb (2 + 2 n): the uwb message as it arrives, see model/signals.py.
        estimate (15): the filter's xhat; its first three are the last estimate of p_WB.
        fix (14, output): the fix message, stamped as the uwb message; zeros if nothing arrived or no fix.

    Args:
        settings: method, and the noise it believes of the ranges.
        anchors: a_i in W (n, 3).
    """

    def __init__(self, settings: MultilaterationSettings, anchors: np.ndarray):
        super().__init__()
        self.set_name("multilateration")
        noise = settings.noise
        self._noise = np.array([noise.sd, 0.0] if noise.kind == "constant" else [0.0, noise.fraction])
        self._anchors = np.ascontiguousarray(anchors, dtype=float)
        self._three = settings.method == "nearest_three"
        self._uwb = self.DeclareVectorInputPort("uwb", uwb_size(len(anchors)))
        self._estimate = self.DeclareVectorInputPort("estimate", N_XBAR)
        ports = {self._uwb.ticket(), self._estimate.ticket()}
        self.DeclareVectorOutputPort("fix", FIX_SIZE, self._calc_fix, prerequisites_of_calc=ports)

    def _calc_fix(self, context: Context, output: BasicVector) -> None:
        uwb = self._uwb.Eval(context)
        if uwb[ARRIVED]:
            xhat = self._estimate.Eval(context)
            output.SetFromVector(fix_message(uwb, self._anchors, self._noise, xhat, self._three))
        else:
            output.SetZero()
