"""The probability of a rare event with its 95 % interval, from repetitions of subset simulation and from a count.

Two intervals hold together at least as often as 1 - (a + b), if one misses with the chance a and the other with b,
whether or not they are independent (Bonferroni). The repetitions have a 96 % interval, the count has a 99 % one, and
the answer is what both allow. Most of the 5 % is the repetitions', because a count seldom narrows their interval where
there are ten of them, and narrows it far where there are three.
"""

from dataclasses import dataclass

import numpy as np
from scipy import stats

from ortilo_drake.flight.intervals import LEVEL, Interval, share_interval
from ortilo_drake.studies.rare.subset import Climb, Plan

OF_COUNT = 0.99  # confidence of the count's interval where it stands beside the repetitions' [1]
OF_REPETITIONS = LEVEL + (1.0 - OF_COUNT)  # and of theirs [1]
FEWEST = 2  # estimates above 0, without which there is no interval


@dataclass(frozen=True)
class Counted:
    """Plain counting of flights whose noise is independent: how many flew, and in how many of them it happened.

    The ends of Wilson's 95 % interval of the share are low and high [1].
    """

    flights: int
    events: int
    low: float
    high: float


@dataclass(frozen=True)
class Joined:
    """What repetitions and a count say, each by itself: the repetitions' mean, and the ends of both intervals [1].

    They are of the confidences OF_REPETITIONS and OF_COUNT; the count's is Clopper and Pearson's, which holds at least
    as often as it says.
    """

    mean: float
    by_repetitions: Interval
    by_count: Interval

    @property
    def agree(self) -> bool:
        """Whether some probability is in both intervals."""
        return max(self.by_repetitions[0], self.by_count[0]) <= min(self.by_repetitions[1], self.by_count[1])


@dataclass(frozen=True)
class Estimate:
    """A probability with its 95 % interval [1].

    The probability is None where it is known only by a count of `independent`; joined is None where only a count gives
    it.
    """

    probability: float | None
    low: float
    high: float
    joined: Joined | None


def counted_of(flights: int, events: int) -> Counted:
    """Return a count with Wilson's interval.

    Of no event in n >= 20 flights its upper end is 16 to 28 % above the exact one-sided limit, 1 - 0.05^(1/n).
    """
    return Counted(flights, events, *share_interval(events, flights))


def estimate(plan: Plan, found: list[Climb], paths: int, independent: Counted, counted: int, events: int) -> Estimate:
    """Return the probability and its 95 % interval.

    Without levels it is a count of all flights of the repetitions and those counted beside them. The plan's are left
    out: they decided that there is no level. With fewer than two repetitions above 0, and where a count without any
    event contradicts the repetitions, it is that of `independent`, the count of all flights that belong to no chain.
    The plan has the levels, of so many paths each; beside the repetitions found so many flights were counted, and so
    many events in them.
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
    """Return what both say; None of fewer than two repetitions above 0."""
    p = np.array([one.probability for one in found])
    if not (ends := log_interval(p, OF_REPETITIONS)):
        return None
    mean, least = float(p.mean()), float(np.exp(least_half_width(found, paths, OF_REPETITIONS)))
    of_count = stats.binomtest(independent.events, independent.flights).proportion_ci(OF_COUNT, method="exact")
    by_repetitions = min(ends[0], mean / least), min(max(ends[1], mean * least), 1.0)
    return Joined(mean, by_repetitions, (float(of_count.low), float(of_count.high)))


def least_half_width(found: list[Climb], paths: int, level: float) -> float:
    """Return half the width of the interval of the logarithm that repetitions of independent paths would have.

    A share k of N independent paths has a logarithm of variance (1 - k) / (k N), and those of all levels add up (Au and
    Beck 2001, of paths without correlation). Paths of a chain are correlated, which only widens it; repetitions
    that agree better do so by chance.
    """
    reached = [[one.kept[j] for one in found if len(one.kept) > j] for j in range(max(len(one.kept) for one in found))]
    shares = np.array([np.mean(at_level) for at_level in reached])
    variance = float(np.sum((1.0 - shares) / (shares * paths))) / len(found)
    return float(stats.norm.ppf(0.5 + level / 2.0)) * float(np.sqrt(variance))


def log_interval(estimates: np.ndarray, level: float) -> Interval | None:
    """Return the ends of the interval of the mean of estimates (N), None if fewer than FEWEST are above 0.

    Estimates that are a product of many shares tend to a lognormal law (J. Bérard, P. Del Moral, A. Doucet, "A
    lognormal central limit theorem for particle approximations of normalizing constants", Electronic Journal of
    Probability 19, 2014). Its mean has the logarithm mu + s^2 / 2, of which n logarithms of variance s^2 give an
    estimate with the variance s^2 / n + s^4 / (2 (n - 1)); with Student's t that makes an interval (D. R. Cox's, in U.
    Olsson, "Confidence intervals for the mean of a log-normal distribution", Journal of Statistics Education 13, 2005).
    Here it is laid about the arithmetic mean, which has no bias. Of N estimates of which n are not 0 the share n / N
    adds the variance (N - n) / (n N) of its logarithm.
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
