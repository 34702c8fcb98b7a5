"""Subset simulation: the probability that a random path ever goes as high as a goal, however small it is.

S. K. Au, J. L. Beck, "Estimation of small failure probabilities in high dimensions by subset simulation", Probabilistic
Engineering Mechanics 16 (2001). Between nothing and the goal lie levels L_1 < L_2 < ...; of N paths those at L_j or
above go on, each as the start of a Markov chain that leaves the law of paths above L_j as it is, and the chains' paths
are the next N. With the share that is at the next level in each round,

    p = share at L_1 x share at L_2 of those above L_1 x ... x share at the goal of those above the last.

A path is made of independent pieces: J seeds for each tick, of which the noise of that tick is a pure function, and
standard normal numbers z for what is drawn at its start. A step of a chain changes a little of all, by 0 < b <= 1:

    each seed of each tick is drawn anew with the probability b,      z' = (1 - b) z + sqrt(1 - (1 - b)^2) v,  v normal,

both reversible for the law of paths (Gibbs; S. L. Cotter et al., "MCMC methods for functions", Statistical Science 28,
2013), and is taken if the new path is at the level or above. What depends on a sum of many ticks' noise keeps 1 - b of
itself by either. A path runs from its start to its end, so a cause may be long before its effect.

With J = 1 the noise of a tick stays or is new altogether, and where a single tick decides no chain goes up. A normal
number of a tick that is the sum of J seeds' numbers over sqrt(J) is moved within the tick: of J seeds one that is drawn
anew leaves 1 - 1 / J of it, the step z' = (1 - b) z + ... above with b = 1 / J.

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
_GAIN = 2.0  # of the logarithm of a step, for what is taken too often or too seldom
LEAST = 1e-9  # the climb that chooses levels goes no further down than to such a probability [1]


class Size(NamedTuple):
    """What a path is made of.

    Attributes:
        ticks: how many it has.
        drawn: normal numbers at its start.
        parts: seeds of each tick.
    """

    ticks: int
    drawn: int
    parts: int


class Paths(NamedTuple):
    """Paths, by what they are made of.

    Attributes:
        seeds: of the noise of each tick (n, ticks, parts).
        start: standard normal numbers, for what is drawn at the start (n, m).
    """

    seeds: np.ndarray
    start: np.ndarray

    def at(self, numbers: np.ndarray) -> "Paths":
        """Return some of them, by their numbers."""
        return Paths(self.seeds[numbers], self.start[numbers])


Heights = Callable[[Paths], np.ndarray]  # how high each path comes (n)


@dataclass(frozen=True)
class Plan:
    """What the first climb chose.

    Attributes:
        levels: below the goal, going up.
        steps: b at each level, in (0, 1].
        flights: how many paths it ran.
        met: how many of the first, independent paths reached the goal.
        reached: whether a path above the last level reached it.
    """

    levels: tuple[Amount, ...]
    steps: tuple[Share, ...]
    flights: Count
    met: Count
    reached: bool


@dataclass(frozen=True)
class Climb:
    """What one climb found.

    Attributes:
        probability: of reaching the goal [1].
        kept: share of the paths that were at each level, then at the goal [1].
        accepted: share of the steps that were taken at each level [1].
        flights: how many paths ran.
        met: how many of the first, independent paths reached the goal.
    """

    probability: Share
    kept: tuple[Share, ...]
    accepted: tuple[Share, ...]
    flights: Count
    met: Count


def fresh(n: int, size: Size, random: np.random.Generator) -> Paths:
    """Return n paths of that size."""
    return Paths(random.integers(2**62, size=(n, size.ticks, size.parts)), random.standard_normal((n, size.drawn)))


def moved(paths: Paths, step: np.ndarray, random: np.random.Generator) -> Paths:
    """Return paths a step away, b of each (n)."""
    (n, ticks, parts), b = paths.seeds.shape, step[:, np.newaxis]
    new = fresh(n, Size(ticks, paths.start.shape[1], parts), random)
    seeds = np.where(random.random(paths.seeds.shape) < b[..., np.newaxis], new.seeds, paths.seeds)
    return Paths(seeds, (1.0 - b) * paths.start + np.sqrt(1.0 - (1.0 - b) ** 2) * new.start)


class _Above(NamedTuple):
    """Paths at a level or above, how high they come, b after each step and the share of each that was taken."""

    paths: Paths
    heights: np.ndarray
    steps: list[float]
    accepted: list[float]


def _chains(
    run: Heights, starts: Paths, heights: np.ndarray, level: float, b: float, fixed: bool, random: np.random.Generator
) -> _Above:
    """Return the paths of a chain from each start, at a level or above; unless it is fixed, b is adapted on the way."""
    paths, found, steps, accepted = [starts], [heights], [], []
    for _ in range(CHAIN - 1):
        step = np.minimum(b * SPREAD ** random.uniform(-1.0, 1.0, len(heights)), 1.0)
        proposed = moved(paths[-1], step, random)
        its = run(proposed)
        taken = its >= level
        seeds = np.where(taken[:, np.newaxis, np.newaxis], proposed.seeds, paths[-1].seeds)
        paths.append(Paths(seeds, np.where(taken[:, np.newaxis], proposed.start, paths[-1].start)))
        found.append(np.where(taken, its, found[-1]))
        accepted.append(float(taken.mean()))
        steps.append(b)
        if not fixed:
            b = min(b * float(np.exp(_GAIN * (accepted[-1] - ACCEPTED))), 1.0)
    together = Paths(np.concatenate([p.seeds for p in paths]), np.concatenate([p.start for p in paths]))
    return _Above(together, np.concatenate(found), steps, accepted)


def most_levels(least: float) -> int:
    """Return how many levels lead to a probability [1]."""
    return math.ceil(math.log(least) / math.log(KEPT) - 1e-9)


def flights_of(levels: int, paths: int) -> int:
    """Return how many paths a climb over so many levels runs."""
    return paths + levels * (paths - paths // CHAIN)


def plan_climb(
    run: Heights,
    size: Size,
    goal: float,
    paths: int,
    seed: int,
    least: float = LEAST,
    progress: Callable[[int], None] = lambda flights: None,
) -> Plan:
    """Return levels that keep KEPT of the paths each, and steps of which ACCEPTED are taken.

    It ends at the goal, where no path comes higher any more, and where the next level would be rarer than `least`.

    Args:
        run: how high each path comes.
        size: what a path is made of.
        goal: how high a path must come, at least.
        paths: N, a multiple of CHAIN.
        seed: of all that is drawn.
        least: the smallest probability that is sought [1].
        progress: called with how many paths have run.
    """
    random, b, flights = np.random.default_rng((seed, 0)), ACCEPTED, 0

    def counted(some: Paths) -> np.ndarray:
        nonlocal flights
        its = run(some)
        flights += len(its)
        progress(flights)
        return its

    pool = fresh(paths, size, random)
    heights = counted(pool)
    met = int(np.sum(heights >= goal))
    levels: list[float] = []
    steps: list[float] = []
    while len(levels) < most_levels(least):
        level = _next_level(heights, levels[-1] if levels else -np.inf)
        if level is None or level >= goal:  # no path comes higher any more, or there
            break
        chosen = _starts(np.flatnonzero(heights >= level), paths, random)
        above = _chains(counted, pool.at(chosen), heights[chosen], level, b, False, random)
        b = float(np.exp(np.mean(np.log(above.steps[CHAIN // 2 :]))))
        levels.append(level)
        steps.append(b)
        pool, heights = above.paths, above.heights
    return Plan(tuple(levels), tuple(steps), flights, met, bool(np.any(heights >= goal)))


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


def climb(run: Heights, size: Size, goal: float, plan: Plan, paths: int, seed: int, repetition: int) -> Climb:
    """Return one estimate of the probability that a path reaches the goal, without bias; arguments as plan_climb's.

    Each repetition of each seed has noise of its own.
    """
    random = np.random.default_rng((seed, 1 + repetition))
    pool, flights = fresh(paths, size, random), paths
    heights = run(pool)
    met = int(np.sum(heights >= goal))
    kept: list[float] = []
    accepted: list[float] = []
    for level, b in zip(plan.levels, plan.steps, strict=True):
        there = np.flatnonzero(heights >= level)
        kept.append(there.size / paths)
        if not there.size:
            return Climb(0.0, tuple(kept), tuple(accepted), flights, met)
        chosen = _starts(there, paths, random)
        above = _chains(run, pool.at(chosen), heights[chosen], level, b, True, random)
        pool, heights, flights = above.paths, above.heights, flights + paths - paths // CHAIN
        accepted.append(float(np.mean(above.accepted)))
    kept.append(float(np.mean(heights >= goal)))
    return Climb(float(np.prod(kept)), tuple(kept), tuple(accepted), flights, met)


def _starts(there: np.ndarray, paths: int, random: np.random.Generator) -> np.ndarray:
    """Return the numbers of the paths from which chains go on: each of those there as often as any, on average."""
    return np.resize(random.permutation(there), paths // CHAIN)
