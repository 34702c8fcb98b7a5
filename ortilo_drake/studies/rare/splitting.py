"""Adaptive multilevel splitting: the probability that a random path ever goes as high as a goal, however small it is.

F. Cerou, A. Guyader, "Adaptive multilevel splitting for rare event analysis", Stochastic Analysis and Applications 25
(2007); that the estimate has no bias, with as many paths dropped as lie at or below the level: C.-E. Brehier et al.,
"Unbiasedness of some generalized adaptive multilevel splitting algorithms", Annals of Applied Probability 26 (2016).

N paths run to their end. Again and again those that came least high are dropped: all whose highest point is at most
the level L, which the n-th least of them sets. Each is replaced by a branch of a path that came higher: its twin up to
the first tick above L, and noise of its own from there. When the level would reach the goal,

    p = prod over the rounds of (paths kept / N), times the share of the last paths that reach the goal.

A path is known by its seeds, one for each tick: the noise of a tick is a pure function of the seed and the tick, so a
branch needs no state to be kept, only the seeds of its twin up to where it leaves it.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

DROPPED = 10  # one path in so many is dropped in a round


@dataclass(frozen=True)
class Split:
    """What splitting found.

    Attributes:
        probability: of reaching the goal [1].
        rounds: how often paths were dropped.
        paths: how many ran to their end in all.
    """

    probability: float
    rounds: int
    paths: int


def split(run: Callable[[np.ndarray], np.ndarray], ticks: int, goal: float, paths: int, seed: int) -> Split:
    """Return the probability that a path reaches a goal.

    Args:
        run: how high each path is at each tick (n, ticks), from its seeds at each (n, ticks). What stands at a tick
            must follow from the seeds before it.
        ticks: of a path.
        goal: how high a path must come, at least.
        paths: N, at least 2 DROPPED.
        seed: of what splitting itself draws, the paths' own seeds among it.
    """
    random = np.random.default_rng(seed)

    def fresh(n: int) -> np.ndarray:
        return random.integers(2**62, size=(n, 1))

    seeds = np.repeat(fresh(paths), ticks, axis=1)
    heights = run(seeds)
    highest, probability, rounds, run_in_all = heights.max(axis=1), 1.0, 0, paths
    while (level := np.sort(highest)[paths // DROPPED - 1]) < goal:
        dropped, kept = np.flatnonzero(highest <= level), np.flatnonzero(highest > level)
        probability *= kept.size / paths
        if not kept.size:
            break
        parents = random.choice(kept, dropped.size)
        leaves = np.argmax(heights[parents] > level, axis=1)
        seeds[dropped] = np.where(np.arange(ticks) < leaves[:, np.newaxis], seeds[parents], fresh(dropped.size))
        heights[dropped] = run(seeds[dropped])
        highest[dropped] = heights[dropped].max(axis=1)
        rounds, run_in_all = rounds + 1, run_in_all + dropped.size
    return Split(float(probability * np.mean(highest >= goal)), rounds, run_in_all)
