"""Subset simulation: the probability that a random path ever goes as high as a goal, however small it is.

S. K. Au, J. L. Beck, "Estimation of small failure probabilities in high dimensions by subset simulation", Probabilistic
Engineering Mechanics 16 (2001). Levels L_1 < L_2 < ... lie below the goal. Of N paths those at L_j or above are kept.
Each starts a Markov chain that leaves the law of paths above L_j unchanged, and the chains' paths are the next N. With
the share that reaches the next level in each round,

    p = share at L_1 x share at L_2 of those above L_1 x ... x share at the goal of those above the last.

A path is a row of standard normal numbers z, those of its start and of every tick. A step of a chain changes a little
of it, by 0 < b <= 1, and is taken if the new path is at the level or above. Two steps of three move all of z,

    z' = (1 - b) z + sqrt(1 - (1 - b)^2) v,   v standard normal,

and the third draws each number anew with the probability b. Both are reversible for the law of z, whatever its size
(pCN: S. L. Cotter et al., "MCMC methods for functions", Statistical Science 28, 2013, and as conditional sampling:
I. Papaioannou et al., "MCMC algorithms for subset simulation", Probabilistic Engineering Mechanics 41, 2015; Gibbs).
The first goes up where one or two ticks decide, for it moves within them; the second where many numbers must each stay
within bounds, as in a burst of losses. A path runs from its start to its end, so a cause may be long before its effect.

A first climb chooses levels and steps; its own estimate is thrown away. The climbs that follow take them as given, so
that their estimates are without bias (waste-free sequential Monte Carlo: H.-D. Dau, N. Chopin, Journal of the Royal
Statistical Society B 84, 2022, proposition 1), and independent of each other.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ortilo_drake.flight.store import Amount, Count, Share

KEPT = 0.1  # share of the paths that a chosen level keeps [1]
MOST_KEPT = 0.5  # share above which too many are equally high for a level [1]
CHAIN = 10  # paths of a chain, its start among them
ACCEPTED = 0.4  # share of steps that are to be taken [1]
SPREAD = 2.0  # steps are up to so many times smaller or larger than the level's own, to suit late and early causes
AT_ONCE = 2**21  # numbers of the paths that are run together
_GAIN = 2.0  # of the logarithm of a step, for what is taken too often or too seldom
FIRST = (0.5, 0.1, 0.01, 1e-3)  # shares of the first paths, of which a plan keeps how high they came [1]
LEAST = 1e-9  # the climb that chooses levels goes no further down than to such a probability [1]

Heights = Callable[[np.ndarray], np.ndarray]  # how high each path (n, size) comes (n)


@dataclass(frozen=True)
class Plan:
    """The levels below the goal, going up, and steps that the first climb chose: b of each kind of step, in (0, 1].

    It ran so many flights, of the first, independent ones of which so many met the goal, and says whether a path above
    the last level reached it. The shares FIRST of the first ones came as high as `first` says, as far as the paths are
    so many and the heights finite.
    """

    levels: tuple[Amount, ...]
    steps: tuple[tuple[Share, Share], ...]
    flights: Count
    met: Count
    reached: bool
    first: tuple[Amount, ...] = ()


@dataclass(frozen=True)
class Climb:
    """The result of one climb: the probability of reaching the goal [1].

    The paths that were at each level, then at the goal, were a share `kept` of all, the steps that were taken at each
    level a share `accepted` [1]. So many flights ran, of the first, independent ones of which so many met the goal.
    """

    probability: Share
    kept: tuple[Share, ...]
    accepted: tuple[Share, ...]
    flights: Count
    met: Count


def independent_paths(n: int, size: int, random: np.random.Generator) -> np.ndarray:
    """Return n paths of so many numbers (n, size)."""
    return random.standard_normal((n, size), dtype=np.float32)


def propose(paths: np.ndarray, step: np.ndarray, few: bool, random: np.random.Generator) -> np.ndarray:
    """Return paths a step away, b of each (n): a few of their numbers are new, or all are moved."""
    new, kept = independent_paths(len(paths), paths.shape[1], random), (1.0 - step[:, np.newaxis]).astype(np.float32)
    if few:
        return np.where(random.random(paths.shape, dtype=np.float32) < kept, paths, new)
    new *= np.sqrt(1.0 - kept**2)
    new += kept * paths
    return new


class _Best:
    """Paths of the highest keys among all that it is offered, so many at most: a level's paths need not all be held."""

    def __init__(self, most: int, size: int):
        self._paths, self._heights = np.empty((most, size), np.float32), np.empty(most)
        self._keys = np.full(most, -np.inf)  # of none

    def offer(self, paths: np.ndarray, heights: np.ndarray, keys: np.ndarray) -> None:
        """Take the paths whose keys are among the highest (n); those of -infinity are not offered."""
        there, most = np.flatnonzero(keys > -np.inf), len(self._keys)
        best = np.argsort(-np.concatenate((self._keys, keys[there])), kind="stable")[:most]
        goes = np.ones(most, dtype=bool)
        goes[best[best < most]] = False
        comes = there[best[best >= most] - most]
        self._paths[goes], self._heights[goes], self._keys[goes] = paths[comes], heights[comes], keys[comes]

    def starts(self, level: float, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Return paths at a level from which chains go on, and their heights: each as often as any, on average."""
        there = np.flatnonzero((self._keys > -np.inf) & (self._heights >= level))
        chosen = np.resize(random.permutation(there), len(self._keys))
        return self._paths[chosen], self._heights[chosen]


Keep = Callable[[np.ndarray, np.ndarray], None]  # is given paths (n, size) and how high they come (n)


def _parts(n: int, size: int) -> list[slice]:
    """Return the parts of n paths that are run together."""
    at_once = max(AT_ONCE // max(size, 1), 1)
    return [slice(at, min(at + at_once, n)) for at in range(0, n, at_once)]


def _first(run: Heights, paths: int, size: int, keep: Keep, random: np.random.Generator) -> np.ndarray:
    """Run so many new paths; return how high they come (n)."""
    heights = np.empty(paths)
    for part in _parts(paths, size):
        new = independent_paths(part.stop - part.start, size, random)
        heights[part] = run(new)
        keep(new, heights[part])
    return heights


class _Above(NamedTuple):
    """The paths' heights (n), the share of each step that was taken, and b of each kind of step."""

    heights: np.ndarray
    accepted: list[float]
    b: tuple[float, float]


def _chains(
    run: Heights,
    starts: tuple[np.ndarray, np.ndarray],
    level: float,
    b: tuple[float, float],
    fixed: bool,
    keep: Keep,
    random: np.random.Generator,
) -> _Above:
    """Run a chain from each start, at a level or above; unless it is fixed, b is adapted on the way and averaged."""
    (paths, heights), accepted = starts, list[float]()
    used: tuple[list[float], list[float]] = [b[0]], [b[1]]
    keep(paths, heights)
    found = [heights.copy()]
    for i in range(CHAIN - 1):
        its = used[few := i % 3 == 2]
        step = np.minimum(its[-1] * SPREAD ** random.uniform(-1.0, 1.0, len(heights)), 1.0)
        count = 0
        for part in _parts(*paths.shape):
            proposed = propose(paths[part], step[part], few, random)
            high = run(proposed)
            taken = high >= level
            paths[part][taken], heights[part][taken] = proposed[taken], high[taken]
            count += int(taken.sum())
        keep(paths, heights)
        found.append(heights.copy())
        accepted.append(count / len(heights))
        if not fixed:
            its.append(min(its[-1] * float(np.exp(_GAIN * (accepted[-1] - ACCEPTED))), 1.0))
    late = [float(np.exp(np.mean(np.log(its[len(its) // 2 :])))) for its in used]
    return _Above(np.concatenate(found), accepted, (late[0], late[1]))


def most_levels(least: float) -> int:
    """Return the number of levels that lead to a probability [1]."""
    return math.ceil(math.log(least) / math.log(KEPT) - 1e-9)


def flights_of(levels: int, paths: int) -> int:
    """Return the number of paths that a climb over a number of levels runs."""
    return paths + levels * (paths - paths // CHAIN)


def plan_climb(
    run: Heights,
    size: int,
    goal: float,
    paths: int,
    seed: int,
    least: float = LEAST,
    progress: Callable[[int], None] = lambda flights: None,
) -> Plan:
    """Return levels that each keep a share KEPT of the paths, and step sizes of which a share ACCEPTED is taken.

    It ends at the goal, how high a path must come at least, where no path comes higher any more, and where the next
    level would be rarer than `least`, the smallest probability that is sought [1]. A path is made of `size` numbers;
    `run` says how high each comes. There are N paths, a multiple of CHAIN; the seed is of all that is drawn, and the
    progress is told as how many paths have run.
    """
    random, b, flights = np.random.default_rng((seed, 0)), (ACCEPTED, ACCEPTED), 0

    def counted(some: np.ndarray) -> np.ndarray:
        nonlocal flights
        its = run(some)
        flights += len(its)
        progress(flights)
        return its

    best = _Best(paths // CHAIN, size)

    def keep(its: np.ndarray, heights: np.ndarray) -> None:
        best.offer(its, heights, heights)

    heights = _first(counted, paths, size, keep, random)
    met, first = int(np.sum(heights >= goal)), _quantiles(heights)
    levels: list[float] = []
    steps: list[tuple[float, float]] = []
    while len(levels) < most_levels(least):
        level = _next_level(heights, levels[-1] if levels else -np.inf)
        if level is None or level >= goal:  # no path comes higher any more, or there
            break
        starts, best = best.starts(level, random), _Best(paths // CHAIN, size)
        above = _chains(counted, starts, level, b, False, keep, random)
        b = above.b
        levels.append(level)
        steps.append(b)
        heights = above.heights
    return Plan(tuple(levels), tuple(steps), flights, met, bool(np.any(heights >= goal)), first)


def _quantiles(heights: np.ndarray) -> tuple[float, ...]:
    """Return the heights that shares FIRST of the paths reach, as far as there are so many and they are finite."""
    ordered = np.sort(heights)
    found = [float(ordered[-int(share * len(heights))]) for share in FIRST if share * len(heights) >= 1.0]
    return tuple(height for height in found if np.isfinite(height))


def _next_level(heights: np.ndarray, last: float) -> float | None:
    """Return the height that KEPT of the paths reach, above the last level; None if no path is above that.

    Where many paths are equally high it is the next height above them, which fewer reach.
    """
    level = float(np.sort(heights)[-max(int(KEPT * len(heights)), 1)])
    if level > last and np.mean(heights >= level) <= MOST_KEPT:
        return level
    higher = heights[heights > max(level, last)]
    if higher.size:
        return float(higher.min())
    return level if level > last else None


def climb(run: Heights, size: int, goal: float, plan: Plan, paths: int, seed: int, repetition: int) -> Climb:
    """Return one estimate of the probability that a path reaches the goal, without bias; arguments as plan_climb's.

    Each repetition of each seed has noise of its own.
    """
    random = np.random.default_rng((seed, 1 + repetition))
    best, next_levels = _Best(paths // CHAIN, size), iter((*plan.levels, np.nan))  # after the last none goes on
    next_level = next(next_levels)

    def keep(its: np.ndarray, heights: np.ndarray) -> None:
        best.offer(its, heights, np.where(heights >= next_level, random.random(len(heights)), -np.inf))

    heights, flights = _first(run, paths, size, keep, random), paths
    met = int(np.sum(heights >= goal))
    kept: list[float] = []
    accepted: list[float] = []
    for level, b in zip(plan.levels, plan.steps, strict=True):
        kept.append(float(np.mean(heights >= level)))
        if not kept[-1]:
            return Climb(0.0, tuple(kept), tuple(accepted), flights, met)
        starts, best, next_level = best.starts(level, random), _Best(paths // CHAIN, size), next(next_levels)
        above = _chains(run, starts, level, b, True, keep, random)
        heights, flights = above.heights, flights + paths - paths // CHAIN
        accepted.append(float(np.mean(above.accepted)))
    kept.append(float(np.mean(heights >= goal)))
    return Climb(float(np.prod(kept)), tuple(kept), tuple(accepted), flights, met)
