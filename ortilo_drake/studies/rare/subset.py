"""Subset simulation: the probability, however small, that a random path ever goes as high as a goal.

S. K. Au, J. L. Beck, "Estimation of small failure probabilities in high dimensions by subset simulation", Probabilistic
Engineering Mechanics 16 (2001). Levels L_1 < L_2 < ... lie below the goal. Of N paths, those at L_j or above are kept.
Each kept path starts a Markov chain that leaves the law of paths above L_j unchanged, and the chains' paths are the
next N. With the share that reaches the next level in each round,

    p = share at L_1 x share at L_2 of those above L_1 x ... x share at the goal of those above the last.

A path is a row of standard normal numbers z, for its start and for every tick. A step of a chain changes z a little, by
0 < b <= 1, and is taken if the new path is at the level or above. Two of three steps move all of z,

    z' = (1 - b) z + sqrt(1 - (1 - b)^2) v,   v standard normal,

and the third draws each number anew with the probability b. Both are reversible for the law of z, whatever its size
(pCN: S. L. Cotter et al., "MCMC methods for functions", Statistical Science 28, 2013, and as conditional sampling:
I. Papaioannou et al., "MCMC algorithms for subset simulation", Probabilistic Engineering Mechanics 41, 2015; Gibbs).
The first kind suits events that one or two ticks decide, because it moves within these ticks. The second suits events
for which many numbers must each stay within bounds, as in a burst of losses. A path runs from its start to its end, so
a cause may be long before its effect.

A first climb chooses levels and steps; its own estimate is discarded. The later climbs take levels and steps as given,
so their estimates have no bias (waste-free sequential Monte Carlo: H.-D. Dau, N. Chopin, Journal of the Royal
Statistical Society B 84, 2022, proposition 1) and are independent of each other.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ortilo_drake.flight.store import Amount, Count, Share

KEPT = 0.1  # share of the paths that a chosen level keeps [1]
MOST_KEPT = 0.5  # with a larger share of equally high paths, their height is no level [1]
CHAIN = 10  # paths of a chain, its start included
ACCEPTED = 0.4  # wanted share of accepted steps [1]
SPREAD = 2.0  # steps are up to so many times smaller or larger than the level's own, to suit late and early causes
AT_ONCE = 2**21  # random numbers of the paths that run together
_GAIN = 2.0  # gain of the logarithm of a step's size on the error of the accepted share
FIRST = (0.5, 0.1, 0.01, 1e-3)  # shares of the first paths for which a plan keeps the height reached [1]
LEAST = 1e-9  # the climb that chooses levels stops at this probability [1]

Heights = Callable[[np.ndarray], np.ndarray]  # paths (n, size) -> the height that each reaches (n)


@dataclass(frozen=True)
class Plan:
    """The levels below the goal, upwards, and the steps that the first climb chose: b of each kind of step, in (0, 1].

    flights: run by the first climb; met: of its first, independent flights, the number that met the goal; reached:
    whether a path above the last level reached the goal; first: the heights that the shares FIRST of the first flights
    reached, as far as there are enough flights and the heights are finite.
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

    kept: share of the paths that reached each level, then the goal [1]; accepted: share of accepted steps at each level
    [1]; flights: number run; met: of the first, independent flights, the number that met the goal.
    """

    probability: Share
    kept: tuple[Share, ...]
    accepted: tuple[Share, ...]
    flights: Count
    met: Count


def independent_paths(n: int, size: int, random: np.random.Generator) -> np.ndarray:
    """Return n independent paths of `size` standard normal numbers (n, size)."""
    return random.standard_normal((n, size), dtype=np.float32)


def propose(paths: np.ndarray, step: np.ndarray, few: bool, random: np.random.Generator) -> np.ndarray:
    """Return proposed paths (n, size), with step b of each (n): a few of their numbers are new, or all are moved."""
    new, kept = independent_paths(len(paths), paths.shape[1], random), (1.0 - step[:, np.newaxis]).astype(np.float32)
    if few:
        return np.where(random.random(paths.shape, dtype=np.float32) < kept, paths, new)
    new *= np.sqrt(1.0 - kept**2)
    new += kept * paths
    return new


class _Best:
    """The `most` paths with the highest keys among all paths offered: so not all paths of a level are held."""

    def __init__(self, most: int, size: int):
        self._paths, self._heights = np.empty((most, size), np.float32), np.empty(most)
        self._keys = np.full(most, -np.inf)  # -inf: no path

    def offer(self, paths: np.ndarray, heights: np.ndarray, keys: np.ndarray) -> None:
        """Take the paths (n, size) whose keys (n) are among the highest; a key of -infinity means not offered."""
        there, most = np.flatnonzero(keys > -np.inf), len(self._keys)
        best = np.argsort(-np.concatenate((self._keys, keys[there])), kind="stable")[:most]
        goes = np.ones(most, dtype=bool)
        goes[best[best < most]] = False
        comes = there[best[best >= most] - most]
        self._paths[goes], self._heights[goes], self._keys[goes] = paths[comes], heights[comes], keys[comes]

    def starts(self, level: float, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Return the start paths of chains, at a level or above, and their heights: each equally often on average."""
        there = np.flatnonzero((self._keys > -np.inf) & (self._heights >= level))
        chosen = np.resize(random.permutation(there), len(self._keys))
        return self._paths[chosen], self._heights[chosen]


Keep = Callable[[np.ndarray, np.ndarray], None]  # called with paths (n, size) and the heights that they reach (n)


def _parts(n: int, size: int) -> list[slice]:
    """Return the slices of n paths that run together."""
    at_once = max(AT_ONCE // max(size, 1), 1)
    return [slice(at, min(at + at_once, n)) for at in range(0, n, at_once)]


def _first(run: Heights, paths: int, size: int, keep: Keep, random: np.random.Generator) -> np.ndarray:
    """Run `paths` new paths; return the heights that they reach (n)."""
    heights = np.empty(paths)
    for part in _parts(paths, size):
        new = independent_paths(part.stop - part.start, size, random)
        heights[part] = run(new)
        keep(new, heights[part])
    return heights


def _chains(
    run: Heights,
    starts: tuple[np.ndarray, np.ndarray],
    level: float,
    b: tuple[float, float],
    fixed: bool,
    keep: Keep,
    random: np.random.Generator,
) -> tuple[np.ndarray, list[float], tuple[float, float]]:
    """Run a chain from each start, at a level or above; unless `fixed`, b is adapted on the way and averaged.

    Return the paths' heights (n), the share of chains that accepted each step, and b of each kind of step.
    """
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
    return np.concatenate(found), accepted, (late[0], late[1])


def most_levels(least: float) -> int:
    """Return the number of levels down to the probability `least` [1]."""
    return math.ceil(math.log(least) / math.log(KEPT) - 1e-9)


def flights_of(levels: int, paths: int) -> int:
    """Return the number of paths that a climb over `levels` runs, with `paths` at each level."""
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
    """Return levels that each keep a share KEPT of the paths, and step sizes with a share ACCEPTED of accepted steps.

    The climb ends at the goal, if no path comes higher any more, or if the next level would be rarer than `least`, the
    smallest probability sought [1]. run: returns the heights of paths; size: numbers of a path; goal: height to reach;
    paths: N, a multiple of CHAIN; seed: of all random numbers; progress: called with the number of paths run so far.
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
        heights, _, b = _chains(counted, starts, level, b, False, keep, random)
        levels.append(level)
        steps.append(b)
    return Plan(tuple(levels), tuple(steps), flights, met, bool(np.any(heights >= goal)), first)


def _quantiles(heights: np.ndarray) -> tuple[float, ...]:
    """Return the heights that the shares FIRST of the paths reach, if there are enough paths and they are finite."""
    ordered = np.sort(heights)
    found = [float(ordered[-int(share * len(heights))]) for share in FIRST if share * len(heights) >= 1.0]
    return tuple(height for height in found if np.isfinite(height))


def _next_level(heights: np.ndarray, last: float) -> float | None:
    """Return the height that a share KEPT of the paths reach, above the last level; None if no path is above it.

    If many paths are equally high, it is the next height above them, which fewer paths reach.
    """
    level = float(np.sort(heights)[-max(int(KEPT * len(heights)), 1)])
    if level > last and np.mean(heights >= level) <= MOST_KEPT:
        return level
    higher = heights[heights > max(level, last)]
    if higher.size:
        return float(higher.min())
    return level if level > last else None


def climb(run: Heights, size: int, goal: float, plan: Plan, paths: int, seed: int, repetition: int) -> Climb:
    """Return one estimate, without bias, of the probability that a path reaches the goal; arguments as in plan_climb.

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
        heights, taken, _ = _chains(run, starts, level, b, True, keep, random)
        flights += paths - paths // CHAIN
        accepted.append(float(np.mean(taken)))
    kept.append(float(np.mean(heights >= goal)))
    return Climb(float(np.prod(kept)), tuple(kept), tuple(accepted), flights, met)
