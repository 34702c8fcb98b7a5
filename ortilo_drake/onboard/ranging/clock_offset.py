"""Position and clock offset b from ranges that are all longer by b, r_i = |p - a_i| + b + v_i.

A prior b_0 of b with variance P_b, if there is one, counts as one more measurement, so that

    cost = e^T R^-1 e + (b - b_0)^2 / P_b,   N = J^T R^-1 J + e_4 e_4^T / P_b,   J = [u_i, 1].

C is the block of p in N^-1, for the new part of the ranges' errors as in range_equations.py. The model of the clock is
a random walk with the sd WALK from one message to the next.
"""

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.model.cholesky import scaled_inverse
from ortilo_drake.model.products import product, times
from ortilo_drake.model.scalars import solve, values_of
from ortilo_drake.onboard.ranging.range_equations import MAX_SD, MIN_SD, STEP

REGULAR = 1e-9  # if the scaled N has a smaller determinant, the four unknowns cannot be separated
STEPS, HALVINGS = 20, 8  # largest numbers of steps of a fit and of halvings of a step; a fit that needs more diverges
NO_RISE = 1.0 + 1e-12  # largest ratio of the new cost to the old one, 1 up to rounding
WALK = 2e-3  # sd of the change of the offset from message to message [m]
NONE_SD = 0.1  # an offset with a smaller sd than this [m] ...
NONE = 2.0  # ... and within this many sds of 0 counts as none


@register_jitable
def offset_equations(
    z: np.ndarray, ranges: np.ndarray, used: np.ndarray, anchors: np.ndarray, noise: np.ndarray, clock: np.ndarray
) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
    """Return the cost at z = [p, b] (4), N (4, 4), minus half the cost's gradient (4), and J^T R^-1 R_v R^-1 J (4, 4).

    Arguments as in range_equations.normal_equations; `clock` is [1 if b_0 is known, b_0, P_b]; the last matrix includes
    the prior, as N does.
    """
    lasts = noise[2] if noise.size > 2 else 0.0
    cost, N, g, new = 0.0 * z[3], np.zeros((4, 4), z.dtype), np.zeros(4, z.dtype), np.zeros((4, 4), z.dtype)
    if clock[0] != 0.0:
        g[3] += (clock[1] - z[3]) / clock[2]
        cost += g[3] * (clock[1] - z[3])
        N[3, 3] += 1.0 / clock[2]
        new[3, 3] += 1.0 / clock[2]
    row = np.ones(4, z.dtype)
    for i in range(anchors.shape[0]):
        if used[i] == 0.0:
            continue
        row[:3] = z[:3] - anchors[i]
        d = np.sqrt(row[0] * row[0] + row[1] * row[1] + row[2] * row[2]) + 1e-30
        row[:3] /= d
        e = ranges[i] - d - z[3]
        variance = max(noise[0] + noise[1] * ranges[i], MIN_SD) ** 2
        w = 1.0 / (variance + lasts**2)
        cost += w * e * e
        for j in range(4):
            g[j] += w * e * row[j]
            for k in range(4):
                N[j, k] += w * row[j] * row[k]
                new[j, k] += variance * w * w * row[j] * row[k]
    return cost, N, g, new


@register_jitable
def fit_with_offset(
    ranges: np.ndarray, used: np.ndarray, anchors: np.ndarray, noise: np.ndarray, p_start: np.ndarray, clock: np.ndarray
) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
    """Return the least cost, p_WB (3) [m], its covariance (3, 3) [m^2] and the clock's new prior (3), see Consistent.

    Gauss-Newton from p_start; a step that would raise the cost is halved. The cost is inf if the fit does not converge,
    if the ranges do not determine four unknowns, or if the position's sd exceeds MAX_SD.
    """
    z = np.append(p_start, clock[1])
    cost, N, g, new = offset_equations(z, ranges, used, anchors, noise, clock)
    nothing = (np.inf, p_start.copy(), np.zeros((3, 3)), clock)
    for _ in range(STEPS):
        regular, inverse = scaled_inverse(N, REGULAR)
        if not regular:
            return nothing
        step = times(inverse, g)
        short = np.sum(step**2) < STEP**2
        tried = offset_equations(z + step, ranges, used, anchors, noise, clock)
        for _ in range(HALVINGS):
            if tried[0] <= cost * NO_RISE or short:
                break
            step = 0.5 * step
            tried = offset_equations(z + step, ranges, used, anchors, noise, clock)
        if not (tried[0] <= cost * NO_RISE or short):
            return nothing
        z = z + step
        cost, N, g, new = tried
        if short:
            inverse = scaled_inverse(N, 0.0)[1]
            C = product(product(inverse, new), inverse)[:3, :3]
            if not C[0, 0] + C[1, 1] + C[2, 2] <= MAX_SD**2:
                return nothing
            sd = np.sqrt(inverse[3, 3])
            is_none = sd < NONE_SD and abs(z[3]) < NONE * sd and clock[0] != 0.0
            after = np.zeros(3) if is_none else np.array([1.0, z[3], sd**2 + WALK**2])
            return cost, z[:3].copy(), np.ascontiguousarray(0.5 * (C + C.T)), after
    return nothing


def differentiable_offset_fix(
    p: np.ndarray, ranges: np.ndarray, used: np.ndarray, anchors: np.ndarray, noise: np.ndarray, clock: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return p (3) and C (3, 3) of a fit with their derivatives with respect to ranges of AutoDiffXd.

    As in multilateration.py, one step from the fit has the derivative of the fit. The cost is quadratic in b, so b
    follows from p.
    """
    z = np.append(p, 0.0) + 0.0 * ranges[0]
    _, N, g, _ = offset_equations(z, ranges, used, anchors, noise, clock)
    z[3] = g[3] / N[3, 3]
    _, N, g, _ = offset_equations(z, ranges, used, anchors, noise, clock)
    z = z + solve(values_of(N), g[:, None])[:, 0]
    _, N, _, new = offset_equations(z, ranges, used, anchors, noise, clock)
    inverse = solve(N, np.eye(4) + 0.0 * N)
    return z[:3], (inverse @ new @ inverse)[:3, :3]
