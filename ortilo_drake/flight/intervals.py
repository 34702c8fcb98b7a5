"""Intervals over flights that hold for any distribution: of a share by counting, of a median by ranks.

The errors of a lost flight end at its loss, so they do not compare with the errors of other flights. A lost flight is
worse than any other, so its error counts as infinite. A median is finite while fewer than half of all flights are lost.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import scipy  # not scipy.stats: that takes a second to import, and loads by itself when it is used

LEVEL = 0.95  # confidence level

Interval = tuple[float, float]


def share_interval(events: int, trials: int) -> Interval:
    """Return the Wilson interval of a share, `events` out of `trials` [1]."""
    found = scipy.stats.binomtest(events, trials).proportion_ci(LEVEL, method="wilson")
    return float(found.low), float(found.high)


def quantile(values: Sequence[float], q: float = 0.5) -> float | None:
    """Return a quantile, linear between order statistics; inf if it touches an infinite value, None without values."""
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
    """Return the interval of a quantile between two order statistics; None if there are too few values.

    B ~ Bin(n, q) of n values lie below the quantile. The quantile is below the r-th value with probability P(B < r),
    above the s-th with P(B >= s). Each is at most (1 - level) / 2, so the interval holds the quantile of any continuous
    distribution with probability `level` or more (H. A. David and H. N. Nagaraja, Order Statistics, 2003, section 7.1).
    An end is infinite where the value is the one of a lost flight. A median needs 6 values, a quartile 13.
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
    """The median of a figure over flights: with lost flights counted as worst, and without them."""

    median: float | None
    """median of all flights; infinite (null in JSON) if it is a lost flight's value, None without flights."""
    interval: Interval | None
    """95 % interval of `median`, infinite at an end that is a lost flight's value; None for too few flights."""
    kept: float | None
    """median of the flights that were not lost; None if there are none."""
    kept_interval: Interval | None
    """95 % interval of `kept`; None for too few flights."""


def middle_of(kept: Sequence[float], lost: int) -> Middle:
    """Return the median of a figure, given its values of the flights not lost and the number of lost flights."""
    every = [*kept, *[math.inf] * lost]
    return Middle(quantile(every), quantile_interval(every), quantile(kept), quantile_interval(kept))
