"""The probability of a rare event with its 95 % interval, from repetitions of subset simulation and from a count.

If one interval misses with the chance a and another with the chance b, both hold with probability 1 - (a + b) at least,
whether or not they are independent (Bonferroni). The repetitions have a 96 % interval, the count has a 99 % interval,
and the answer is the intersection. The repetitions get most of the 5 %, because a count seldom narrows the interval of
ten repetitions, but narrows the interval of three repetitions very much.
"""

from dataclasses import dataclass

import numpy as np
from scipy import stats

from ortilo_drake.flight.intervals import LEVEL, Interval, share_interval
from ortilo_drake.studies.rare.subset import Climb, Plan

OF_COUNT = 0.99  # confidence of the count's interval beside the repetitions' interval [1]
OF_REPETITIONS = LEVEL + (1.0 - OF_COUNT)  # confidence of the repetitions' interval [1]
FEWEST = 2  # fewest estimates above 0 for an interval


@dataclass(frozen=True)
class Counted:
    """A plain count over flights with independent noise: the number of flights, and the number with the event.

    low, high: the ends of Wilson's 95 % interval of the share [1].
    """

    flights: int
    events: int
    low: float
    high: float


@dataclass(frozen=True)
class Joined:
    """The separate results of repetitions and count: the repetitions' mean, and the ends of both intervals [1].

    The intervals have the confidences OF_REPETITIONS and OF_COUNT; the count's is Clopper and Pearson's, which holds
    with this confidence at least.
    """

    mean: float
    by_repetitions: Interval
    by_count: Interval

    @property
    def agree(self) -> bool:
        """Whether the two intervals overlap."""
        return max(self.by_repetitions[0], self.by_count[0]) <= min(self.by_repetitions[1], self.by_count[1])


@dataclass(frozen=True)
class Estimate:
    """A probability with its 95 % interval [1].

    probability: None if only a count of `independent` gives it; joined: None if only a count gives the interval.
    """

    probability: float | None
    low: float
    high: float
    joined: Joined | None


def counted_of(flights: int, events: int) -> Counted:
    """Return a count with Wilson's interval.

    Without an event in n >= 20 flights, its upper end is 16 to 28 % above the exact one-sided limit, 1 - 0.05^(1/n).
    """
    return Counted(flights, events, *share_interval(events, flights))


def estimate(plan: Plan, found: list[Climb], paths: int, independent: Counted, counted: int, events: int) -> Estimate:
    """Return the probability and its 95 % interval.

    Without levels, they come from a count of all flights of the repetitions and those counted beside them. The plan's
    flights are left out: they decided that there is no level. With fewer than two repetitions above 0, and if a count
    without any event contradicts the repetitions, they come from `independent`, the count of all flights not in chains.
    plan: the levels, with `paths` each; found: the repetitions; counted, events: the flights counted beside them, and
    the events among these.
    """
    met = events + sum(one.met for one in found)
    if found and met and not plan.levels:
        often = counted_of(paths * len(found) + counted, met)
        return Estimate(often.events / often.flights, often.low, often.high, None)
    joined = _joined(found, paths, independent)
    if joined is None:
        return Estimate(None, independent.low, independent.high, None)
    share = independent.events / independent.flights
    if not joined.agree:
        return Estimate(share or None, *joined.by_count, joined)
    (low, high), of_count = joined.by_repetitions, joined.by_count
    low, high, width = max(low, of_count[0]), min(high, of_count[1]), high / low
    figures = (share, joined.mean) if of_count[1] < width * of_count[0] else (joined.mean, share)
    middle = float(np.sqrt(low * high))  # for the rare case that neither is in both intervals
    return Estimate(next((p for p in figures if low <= p <= high), middle), low, high, joined)


def _joined(found: list[Climb], paths: int, independent: Counted) -> Joined | None:
    """Return the results of repetitions and count; None with fewer than two repetitions above 0."""
    p = np.array([one.probability for one in found])
    if not (ends := log_interval(p, OF_REPETITIONS)):
        return None
    mean, least = float(p.mean()), float(np.exp(least_half_width(found, paths, OF_REPETITIONS)))
    of_count = stats.binomtest(independent.events, independent.flights).proportion_ci(OF_COUNT, method="exact")
    by_repetitions = min(ends[0], mean / least), min(max(ends[1], mean * least), 1.0)
    return Joined(mean, by_repetitions, (float(of_count.low), float(of_count.high)))


def least_half_width(found: list[Climb], paths: int, level: float) -> float:
    """Return half the width of the logarithm's interval for repetitions of independent paths.

    The logarithm of a share k of N independent paths has the variance (1 - k) / (k N), and the variances of all levels
    add up (Au and Beck 2001, for paths without correlation). Paths of a chain are correlated, which only widens the
    interval; repetitions that agree better do so by chance.
    """
    reached = [[one.kept[j] for one in found if len(one.kept) > j] for j in range(max(len(one.kept) for one in found))]
    shares = np.array([np.mean(at_level) for at_level in reached])
    variance = float(np.sum((1.0 - shares) / (shares * paths))) / len(found)
    return float(stats.norm.ppf(0.5 + level / 2.0)) * float(np.sqrt(variance))


def log_interval(estimates: np.ndarray, level: float) -> Interval | None:
    """Return the ends of the interval of the mean of estimates (N), None if fewer than FEWEST are above 0.

    Estimates that are a product of many shares tend to a lognormal law (J. Bérard, P. Del Moral, A. Doucet, "A
    lognormal central limit theorem for particle approximations of normalizing constants", Electronic Journal of
    Probability 19, 2014). The logarithm of this law's mean is mu + s^2 / 2. From n logarithms of variance s^2 it is
    estimated with the variance s^2 / n + s^4 / (2 (n - 1)), and Student's t gives its interval (D. R. Cox's, in U.
    Olsson, "Confidence intervals for the mean of a log-normal distribution", Journal of Statistics Education 13, 2005).
    Here the interval is laid about the arithmetic mean, which has no bias. If n of N estimates are not 0, the logarithm
    of the share n / N adds the variance (N - n) / (n N).
    """
    logs = np.log(estimates[estimates > 0.0])
    n, N = len(logs), len(estimates)
    if n < FEWEST:
        return None
    s2 = float(logs.var(ddof=1))
    of_logs = s2 / n + s2**2 / (2.0 * (n - 1)) + (N - n) / (n * N)
    half = float(stats.t.ppf(0.5 + level / 2.0, n - 1)) * np.sqrt(of_logs)
    mean = float(estimates.mean())
    return mean * float(np.exp(-half)), min(mean * float(np.exp(half)), 1.0)
