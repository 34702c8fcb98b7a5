"""Ranges that do not fit the others are left out before they make a fix.

The residuals e_i of a fit of n ranges to three unknowns are Gaussian if the ranges are what they are believed to be;
their cost e^T R^-1 e is then distributed as chi-square with n - 3 degrees of freedom. A cost beyond a quantile of it
says that a range is wrong, and of the fits with one range less the one of least cost says which (receiver autonomous
integrity monitoring; B. Parkinson and P. Axelrad, "Autonomous GPS integrity monitoring using the pseudorange residual",
Navigation 35, 1988). Several wrong ranges are left out one after the other. Where what is left cannot be tested any
more, or too much would have to go, there is no fix: a wrong one is worse.

A clock that is off lengthens all ranges alike, r_i = |p - a_i| + b + v_i, so that none of them is the odd one. Its
offset b is a fourth unknown, as in satellite navigation, and costs one degree of freedom, as a range left out does:
one more fit beside those with a range less (clock_offset.py). Once found it is kept: it is known before the next ranges
come, up to its variance, until it is none again.
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
UNKNOWNS = 3  # of a fit; with an offset of the clock one more


class Consistency(NamedTuple):
    """The conditions for ranges to make a fix, as compiled functions take them."""

    quantiles: np.ndarray
    """largest cost by degrees of freedom; inf where there are none."""
    least: int
    """fewest ranges of which one may be left out."""
    share: float
    """of the ranges that may be left out at most [1]."""
    clock: bool
    """whether an offset common to all ranges is looked for."""


class Consistent(NamedTuple):
    """Ranges that fit one position, and the position."""

    found: bool
    """whether there is a fix; nothing else counts if not."""
    used: np.ndarray
    """1 for each range that made it (n)."""
    p: np.ndarray
    """p_WB [m] (3)."""
    C: np.ndarray
    """its covariance [m^2] (3, 3)."""
    clock: np.ndarray
    """[1 if it is off, its offset b [m], b's variance [m^2]] (3), for the next ranges."""
    unknowns: int
    """PLAIN, KNOWN or AFRESH: whether b was fitted too, about what was known of it or without."""


def consistency_of(settings: Exclusion, anchors: int) -> Consistency:
    """Return the consistency test of ranges to a number of anchors."""
    quantiles = [squared_gate(settings.probability, m) for m in range(1, anchors + 1)]
    return Consistency(np.array([np.inf, *quantiles]), settings.least_ranges, settings.share, settings.clock)


@register_jitable
def fit(
    ranges: np.ndarray, used: np.ndarray, anchors: np.ndarray, noise: np.ndarray, p_last: np.ndarray, clock: np.ndarray
) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
    """Return cost, p_WB (3), its covariance (3, 3) and the clock (3) of some ranges; a cost of inf without a fix."""
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
    """Return the fix of those ranges that fit one position, and which those are; arguments as range_equations.py.

    Where all fit, and the clock is not known to be off, it is least_squares' fix of all of them, bit for bit.
    Fits begin from the last estimate of p_WB; the clock is what is known of it, as Consistent has it (3).
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
