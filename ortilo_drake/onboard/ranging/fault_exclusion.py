"""Exclusion of faulty ranges: ranges that do not agree with the others are left out of the fix.

If the noise model is right, the residuals e_i of a fit of n ranges to three unknowns are Gaussian, and their cost
e^T R^-1 e is chi-square with n - 3 degrees of freedom. A cost above a quantile of chi-square shows that a range is
wrong. The wrong range is the one without which the fit has the least cost (receiver autonomous integrity monitoring; B.
Parkinson and P. Axelrad, "Autonomous GPS integrity monitoring using the pseudorange residual", Navigation 35, 1988).
Several wrong ranges are left out one after the other. If the remaining ranges can no longer be tested, or too many
would be left out, there is no fix: a wrong fix is worse.

A clock offset lengthens all ranges alike, r_i = |p - a_i| + b + v_i, so that no single range stands out. The offset b
is then a fourth unknown, as in satellite navigation, and costs one degree of freedom, as a range left out does. So its
fit competes with the fits without one range (clock_offset.py). Once found, b and its variance are the prior for the
next ranges, until b is 0 again.
"""

from typing import NamedTuple

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.onboard.gate import squared_gate
from ortilo_drake.onboard.ranging.clock_offset import fit_with_offset
from ortilo_drake.onboard.ranging.range_equations import least_squares, normal_equations
from ortilo_drake.scenario import Exclusion

PLAIN, KNOWN, AFRESH = range(3)
UNKNOWNS = 3  # number of unknowns of a fit without a clock offset


class Consistency(NamedTuple):
    """The settings of the consistency test of ranges, for compiled functions."""

    quantiles: np.ndarray
    """largest cost for each number of degrees of freedom; inf for 0 degrees of freedom."""
    least: int
    """smallest number of ranges of which one may be left out."""
    share: float
    """largest share of the ranges that may be left out [1]."""
    clock: bool
    """whether the test also tries an offset common to all ranges."""


class Consistent(NamedTuple):
    """A position and the ranges that agree with it."""

    found: bool
    """whether there is a fix; if not, the other fields are not valid."""
    used: np.ndarray
    """1 for each range in the fix, else 0 (n)."""
    p: np.ndarray
    """p_WB [m] (3)."""
    C: np.ndarray
    """covariance of p [m^2] (3, 3)."""
    clock: np.ndarray
    """prior of the clock for the next ranges: [1 if there is an offset, offset b [m], variance of b [m^2]] (3)."""
    unknowns: int
    """PLAIN: without b; KNOWN: b fitted with its prior; AFRESH: b fitted without a prior."""


def consistency_of(settings: Exclusion, anchors: int) -> Consistency:
    """Return the settings of the consistency test for ranges to this number of anchors."""
    quantiles = [squared_gate(settings.probability, m) for m in range(1, anchors + 1)]
    return Consistency(np.array([np.inf, *quantiles]), settings.least_ranges, settings.share, settings.clock)


@register_jitable
def fit(
    ranges: np.ndarray, used: np.ndarray, anchors: np.ndarray, noise: np.ndarray, p_last: np.ndarray, clock: np.ndarray
) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
    """Return cost, p_WB (3), its covariance (3, 3) and the clock (3) of the used ranges; cost inf without a fix."""
    if clock[0] != 0.0:
        return fit_with_offset(ranges, used, anchors, noise, p_last, clock)
    found, p, C = least_squares(ranges, used, anchors, noise, p_last)
    cost = normal_equations(p, ranges, used, anchors, noise)[0] if found else np.inf
    return cost, p, C, clock


@cached_njit
def consistent_fix(
    ranges: np.ndarray,
    there: np.ndarray,
    anchors: np.ndarray,
    noise: np.ndarray,
    p_last: np.ndarray,
    clock: np.ndarray,
    consistency: Consistency,
) -> Consistent:
    """Return the fix of the ranges that agree on one position, and these ranges; arguments as in range_equations.py.

    If all ranges agree and no clock offset is known, the fix has the bits of least_squares for all ranges. Fits start
    from the last estimate p_last of p_WB; `clock` is the prior of the clock (3), see Consistent.
    """
    quantiles, least, share, seeks_offset = consistency
    used = (there != 0.0).astype(np.float64)
    count, kind = int(np.sum(used)), PLAIN if clock[0] == 0.0 else KNOWN
    fewest = max(count - int(share * count), least - 1)
    if count < UNKNOWNS:
        return Consistent(False, used, p_last, np.zeros((3, 3)), clock, kind)
    cost, p, C, next_clock = fit(ranges, used, anchors, noise, p_last, clock)
    if cost <= quantiles[count - UNKNOWNS]:
        return Consistent(cost < np.inf, used, p, C, next_clock, kind)
    while count > fewest and count >= least:
        worst, cost, p, C, next_clock = -1, np.inf, p_last, np.zeros((3, 3)), clock
        for i in range(ranges.size):
            if used[i] != 0.0:
                used[i] = 0.0
                cost_i, p_i, C_i, clock_i = fit(ranges, used, anchors, noise, p_last, clock)
                if cost_i < cost:
                    worst, cost, p, C, next_clock = i, cost_i, p_i, C_i, clock_i
                used[i] = 1.0
        largest = quantiles[count - UNKNOWNS - 1]
        if seeks_offset:
            cost_b, p_b, C_b, clock_b = fit_with_offset(ranges, used, anchors, noise, p_last, np.zeros(3))
            if cost_b <= largest and cost_b < cost:
                return Consistent(True, used, p_b, C_b, clock_b, AFRESH)
        if worst < 0:
            break
        used[worst] = 0.0
        count -= 1
        if cost <= largest:
            return Consistent(True, used, p, C, next_clock, kind)
    return Consistent(False, used, p_last, np.zeros((3, 3)), clock, kind)
