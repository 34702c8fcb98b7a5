"""Intervals over flights that hold whatever the distribution: of a share by counting, of a median by ranks.

The errors of a lost flight are those up to its loss and compare with no other's; it is worse than any that was kept.
So it counts as infinite. A median goes by ranks alone: it is known while fewer than half of the flights are lost.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import scipy  # not scipy.stats: that takes a second to import, and loads by itself when it is used

LEVEL = 0.95

Interval = tuple[float, float]


def share_interval(events: int, trials: int) -> Interval:
    """Return Wilson's interval of a share [1]."""
    found = scipy.stats.binomtest(events, trials).proportion_ci(LEVEL, method="wilson")
    return float(found.low), float(found.high)


def quantile(values: Sequence[float], q: float = 0.5) -> float | None:
    """Return a quantile, linear between order statistics; infinite if it reaches a value that is, None of no values."""
    if not len(values):
        return None
    ordered = sorted(values)
    below = math.floor(q * (len(ordered) - 1))
    share = q * (len(ordered) - 1) - below
    if share == 0.0:
        return float(ordered[below])
    if math.isinf(ordered[below + 1]):
        return math.inf
    return float(ordered[below] + share * (ordered[below + 1] - ordered[below]))


def quantile_interval(values: Sequence[float], q: float = 0.5, level: float = LEVEL) -> Interval | None:
    """Return the interval of a quantile between two order statistics; None of too few values to have one.

    Of n values B ~ Bin(n, q) lie below the quantile. It is below the r-th with P(B < r) and above the s-th with
    P(B >= s): each is at most (1 - level) / 2, so the interval holds the quantile of any continuous distribution in at
    least that share of all cases (H. A. David and H. N. Nagaraja, Order Statistics, 2003, section 7.1). An end is
    infinite where a lost flight stands. A median takes 6 values, a quartile 13.
    """
    n, tail = len(values), 0.5 * (1.0 - level)
    r = int(scipy.stats.binom.ppf(tail, n, q))
    s = int(scipy.stats.binom.ppf(1.0 - tail, n, q)) + 1
    if r < 1 or s > n:
        return None
    ordered = sorted(values)
    return float(ordered[r - 1]), float(ordered[s - 1])


@dataclass(frozen=True)
class Middle:
    """The median of a figure over flights, with the lost ones as worst and without them."""

    median: float | None
    """of all flights; infinite (null in JSON) if a lost flight stands there, None of no flights."""
    interval: Interval | None
    """its 95 % interval, infinite at an end where a lost flight stands; None of too few flights."""
    kept: float | None
    """median of the flights that were not lost; None if there are none."""
    kept_interval: Interval | None
    """its 95 % interval; None of too few."""


def middle_of(kept: Sequence[float], lost: int) -> Middle:
    """Return the median of a figure, given for each flight that was not lost, and how many flights were lost."""
    every = [*kept, *[math.inf] * lost]
    return Middle(quantile(every), quantile_interval(every), quantile(kept), quantile_interval(kept))
