"""Ranges that do not fit the others are left out before they make a fix.

The residuals e_i of a fit of n ranges to three unknowns are Gaussian if the ranges are what they are believed to be;
their cost e^T R^-1 e is then distributed as chi-square with n - 3 degrees of freedom. A cost beyond a quantile of it says
that a range is wrong, and of the fits with one range less the one of least cost says which (receiver autonomous
integrity monitoring; B. Parkinson and P. Axelrad, "Autonomous GPS integrity monitoring using the pseudorange residual",
Navigation 35, 1988). Several wrong ranges are left out one after the other. Where what is left cannot be tested any
more, or too much would have to go, there is no fix: a wrong one is worse.

A clock that is off lengthens all ranges alike, r_i = |p - a_i| + b + v_i, so that none of them is the odd one. Its
offset b is a fourth unknown, as in satellite navigation, and costs one degree of freedom, as a range left out does. It is
one more fit beside those with a range less. With b known to be there, C is the part of p of the four unknowns' covariance.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numba.extending import register_jitable

from ortilo_drake.model.scalars import solve, values_of
from ortilo_drake.onboard.gate import squared_gate
from ortilo_drake.onboard.ranging.range_equations import MAX_SD, MIN_SD, normal_equations
from ortilo_drake.onboard.ranging.range_least_squares import MAX_STEPS, STEP, least_squares
from ortilo_drake.scenario import Exclusion

UNKNOWNS = 3  # of a fit, one more with the clock's offset


class Consistency(NamedTuple):
    """What ranges must fulfil to make a fix, as compiled functions take it.

    Attributes:
        quantiles: largest cost by degrees of freedom; inf where there are none.
        least: fewest ranges of which one may be left out.
        share: of the ranges that may be left out at most [1].
        clock: whether an offset common to all ranges is looked for.
    """

    quantiles: np.ndarray
    least: int
    share: float
    clock: bool


class Consistent(NamedTuple):
    """Ranges that fit one position, and the position.

    Attributes:
        found: whether there is a fix; nothing else counts if not.
        used: 1 for each range that made it (n).
        p: p_WB [m] (3).
        C: its covariance [m^2] (3, 3).
        has_offset: whether an offset of the clock was fitted too.
        b: the offset [m], 0 without.
    """

    found: bool
    used: np.ndarray
    p: np.ndarray
    C: np.ndarray
    has_offset: bool
    b: float


def consistency_of(settings: Exclusion, anchors: int) -> Consistency:
    """Return what ranges to so many anchors must fulfil."""
    quantiles = [squared_gate(settings.probability, m) for m in range(1, anchors + 1)]
    return Consistency(np.array([np.inf, *quantiles]), settings.least_ranges, settings.share, settings.clock)


@register_jitable
def offset_equations(
    p: np.ndarray, b: float, ranges: np.ndarray, used: np.ndarray, anchors: np.ndarray, noise: np.ndarray
) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
    """Return cost, N = J^T R^-1 J (4, 4), g = J^T R^-1 e (4) and J^T R^-1 R_v R^-1 J (4, 4) at [p, b].

    J has the rows [u_i, 1]; arguments as range_equations.normal_equations.
    """
    lasts = noise[2] if noise.size > 2 else 0.0
    cost, N, g, new = 0.0 * b, np.zeros((4, 4), p.dtype), np.zeros(4, p.dtype), np.zeros((4, 4), p.dtype)
    row = np.ones(4, p.dtype)
    for i in range(anchors.shape[0]):
        if used[i] == 0.0:
            continue
        row[:3] = p - anchors[i]
        d = np.sqrt(row[0] * row[0] + row[1] * row[1] + row[2] * row[2]) + 1e-300
        row[:3] /= d
        e = ranges[i] - d - b
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
    ranges: np.ndarray, used: np.ndarray, anchors: np.ndarray, noise: np.ndarray, p_start: np.ndarray
) -> tuple[float, np.ndarray, float, np.ndarray]:
    """Return the least cost, p_WB (3), the clock's offset b [m] and the covariance of p (3, 3).

    Gauss-Newton from p_start; a step that would raise the cost is halved. The cost is inf if that does not converge, or
    if the ranges do not tell four unknowns.
    """
    p, b = p_start.copy(), 0.0
    cost, N, g, new = offset_equations(p, b, ranges, used, anchors, noise)
    nothing = (np.inf, p_start.copy(), 0.0, np.zeros((3, 3)))
    for _ in range(MAX_STEPS):
        scale = np.sqrt(np.diag(N))
        if not (np.all(scale > 0.0) and np.linalg.det(N / np.outer(scale, scale)) > 1e-9):
            return nothing
        step = np.linalg.solve(N, g)
        short = np.sum(step**2) < STEP**2
        for _ in range(20):
            tried = offset_equations(p + step[:3], b + step[3], ranges, used, anchors, noise)
            if tried[0] <= cost or short:
                break
            step = 0.5 * step
        p, b = p + step[:3], b + step[3]
        cost, N, g, new = tried
        if short:
            inverse = np.linalg.inv(N)
            C = inverse @ new @ inverse
            return cost, p, b, np.ascontiguousarray(0.5 * (C + C.T)[:3, :3])
    return nothing


@njit(cache=True)
def consistent_fix(
    ranges: np.ndarray, there: np.ndarray, anchors: np.ndarray, noise: np.ndarray, p_last: np.ndarray, test: Consistency
) -> Consistent:
    """Return the fix of those ranges that fit one position, and which those are.

    Where all fit, it is range_least_squares' fix of all of them, bit for bit.

    Args:
        ranges: r_i [m] (n).
        there: 1 where a range is there, else 0 (n).
        anchors: a_i in W (n, 3).
        noise: s_0 [m] and s_1, and s_2 [m] where it is not 0 (2 or 3), see range_equations.py.
        p_last: the last estimate of p_WB, from which fits begin (3).
        test: what they must fulfil.
    """
    quantiles, least, share, clock = test
    used = (there != 0.0).astype(np.float64)
    count = int(np.sum(used))
    fewest = max(count - int(share * count), least - 1)
    found, p, C = least_squares(ranges, used, anchors, noise, p_last)
    if count <= UNKNOWNS:
        return Consistent(found, used, p, C, False, 0.0)
    if found and normal_equations(p, ranges, used, anchors, noise)[0] <= quantiles[count - UNKNOWNS]:
        return Consistent(True, used, p, C, False, 0.0)
    while count > fewest and count >= least:
        worst, least_cost, p_best, C_best = -1, np.inf, p, C
        for i in range(ranges.size):
            if used[i] != 0.0:
                used[i] = 0.0
                there_is, p_i, C_i = least_squares(ranges, used, anchors, noise, p_last)
                cost = normal_equations(p_i, ranges, used, anchors, noise)[0]
                if there_is and cost < least_cost:
                    worst, least_cost, p_best, C_best = i, cost, p_i, C_i
                used[i] = 1.0
        largest = quantiles[count - UNKNOWNS - 1]
        if clock:
            cost, p_b, b, C_b = fit_with_offset(ranges, used, anchors, noise, p_last)
            if cost <= largest and cost < least_cost and np.trace(C_b) <= MAX_SD**2:
                return Consistent(True, used, p_b, C_b, True, b)
        if worst < 0:
            break
        used[worst] = 0.0
        count -= 1
        if least_cost <= largest:
            return Consistent(True, used, p_best, C_best, False, 0.0)
    return Consistent(False, used, p, np.zeros((3, 3)), False, 0.0)


def differentiable_offset_fix(
    p: np.ndarray, b: float, ranges: np.ndarray, used: np.ndarray, anchors: np.ndarray, noise: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return p (3) and C (3, 3) of a fit with an offset, with their derivatives by ranges of AutoDiffXd.

    As in multilateration.py a step from the fit has the fit's derivative.
    """
    z = np.append(np.asarray(p, dtype=ranges.dtype), b + 0.0 * ranges[0])
    _, N, g, _ = offset_equations(z[:3], z[3], ranges, used, anchors, noise)
    z = z + solve(values_of(N), g[:, None])[:, 0]
    _, N, _, new = offset_equations(z[:3], z[3], ranges, used, anchors, noise)
    inverse = solve(N, np.eye(4, dtype=object) + 0.0 * N)
    return z[:3], (inverse @ new @ inverse)[:3, :3]
