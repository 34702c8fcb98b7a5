"""Subset simulation against laws that are known exactly: a random walk's, a burst's, a linear Gaussian start's."""

import numpy as np
import pytest
from numba import njit
from scipy.stats import binom, norm, t

from ortilo_drake.studies.rare.log_interval import log_interval
from ortilo_drake.studies.rare.subset import CHAIN, Climb, Paths, Size, climb, flights_of, fresh, moved, plan_climb
from ortilo_drake.world.noise import normals, stream_id, uniforms

TICKS, REPETITIONS = 40, 24
TO_BAD, TO_GOOD = 0.05, 0.4
WALKS = Size(TICKS, 0, 1)


WALK = stream_id("walk")


@njit
def noise_of(seeds: np.ndarray) -> np.ndarray:
    """A standard normal number for each tick of each path (n, ticks), of all seeds of the tick alike."""
    noise = np.zeros(seeds.shape[:2])
    for i in range(seeds.shape[0]):
        for k in range(seeds.shape[1]):
            for j in range(seeds.shape[2]):
                noise[i, k] += normals(seeds[i, k, j], WALK, k, 1)[0] / np.sqrt(seeds.shape[2])
    return noise


def walk(paths: Paths) -> np.ndarray:
    """The highest point of a Gaussian walk from 0, of the noise of all ticks but the last."""
    return np.maximum(np.cumsum(noise_of(paths.seeds), axis=1)[:, :-1].max(axis=1), 0.0)


def law_of_walk(goal: float) -> float:
    """P(max of the walk over its ticks >= goal), by the walk's density below the goal, step by step."""
    grid = np.linspace(goal - 45.0, goal, 9001)[:-1] + 0.0025  # midpoints
    density = norm.pdf(grid)
    width, reached = grid[1] - grid[0], norm.sf(goal)
    kernel = norm.pdf(np.arange(-2000, 2001) * width) * width
    for _ in range(TICKS - 2):
        reached += float(np.sum(density * norm.sf(goal - grid)) * width)
        density = np.convolve(density, kernel, mode="same")
    return reached


LINK = stream_id("link")


@njit
def _longest_bursts(seeds: np.ndarray) -> np.ndarray:
    longest = np.zeros(len(seeds))
    for i in range(len(seeds)):
        bad, run = False, 0
        for k in range(seeds.shape[1]):
            u = uniforms(seeds[i, k, 0], LINK, k, 1)[0]
            bad = u >= TO_GOOD if bad else u < TO_BAD
            run = run + 1 if bad else 0
            longest[i] = max(longest[i], run)
    return longest


def longest_burst(paths: Paths) -> np.ndarray:
    """The most ticks in a row in which a Gilbert-Elliott chain is bad."""
    return _longest_bursts(paths.seeds)


def law_of_bursts(goal: int) -> float:
    """P(longest burst >= goal), by the chain of how long the present burst is, absorbed at the goal."""
    p = np.zeros(goal + 1)
    p[0] = 1.0
    for _ in range(TICKS):
        after = np.zeros(goal + 1)
        after[0] = p[0] * (1.0 - TO_BAD) + TO_GOOD * p[1:goal].sum()
        after[1] = p[0] * TO_BAD
        after[2 : goal + 1] += (1.0 - TO_GOOD) * p[1:goal]
        after[goal] += p[goal]
        p = after
    return float(p[goal])


def estimates(
    run, drawn: int, goal: float, paths: int, parts: int = 1, seed: int = 0, repetitions: int = REPETITIONS
) -> np.ndarray:
    size = Size(TICKS, drawn, parts)
    plan = plan_climb(run, size, goal, paths, seed)
    return np.array([climb(run, size, goal, plan, paths, seed, i).probability for i in range(repetitions)])


def check(found: np.ndarray, exact: float, width: float) -> None:
    """The mean's interval holds what is exact, one in a thousand seeds aside, and is so wide at most."""
    half = t.ppf(0.9995, len(found) - 1) * found.std(ddof=1) / np.sqrt(len(found))
    assert abs(found.mean() - exact) < half < width * exact


@pytest.mark.parametrize(("goal", "magnitude"), [(15.0, 1e-2), (24.0, 1e-4), (30.0, 1e-6)])
def test_the_law_of_a_random_walk(goal: float, magnitude: float) -> None:
    exact = law_of_walk(goal)
    assert 0.3 * magnitude < exact < 3.0 * magnitude
    check(estimates(walk, 0, goal, 800), exact, 0.8)


def test_the_law_of_the_longest_burst_whose_heights_are_whole_numbers() -> None:
    exact = law_of_bursts(18)
    assert 5e-5 < exact < 5e-4
    check(estimates(longest_burst, 0, 18.0, 2000), exact, 0.8)


def test_heights_of_which_most_are_equal_are_climbed() -> None:
    """All but 1.5 % of the walks come to 0 and no higher, then by whole fives: no tenth of them is a level."""

    def steps(paths: Paths) -> np.ndarray:
        return 5.0 * np.maximum(np.floor(walk(paths) / 5.0) - 2.0, 0.0)

    exact = law_of_walk(25.0)  # 5 x (5 - 2) = 15
    assert 3e-5 < exact < 1e-4
    check(estimates(steps, 0, 15.0, 400), exact, 1.0)


DECIDING = {1: np.array([7]), 2: np.array([7, 30])}


def of_few_ticks(ticks: np.ndarray):
    """Return the height of paths of which the noise of few ticks decides: a standard normal number."""

    def run(paths: Paths) -> np.ndarray:
        return noise_of(paths.seeds[:, : ticks[-1] + 1])[:, ticks].sum(axis=1) / np.sqrt(len(ticks))

    return run


@pytest.mark.parametrize("ticks", DECIDING)
def test_noise_is_moved_within_the_ticks_that_decide(ticks: int) -> None:
    check(estimates(of_few_ticks(DECIDING[ticks]), 0, float(norm.isf(1e-5)), 400, parts=8), 1e-5, 1.0)


@pytest.mark.long
@pytest.mark.parametrize("ticks", DECIDING)
@pytest.mark.parametrize("exact", [1e-4, 1e-6])
def test_the_interval_covers_what_is_exact(ticks: int, exact: float) -> None:
    """60 intervals of 10 repetitions of 200 paths; were it 0.93, one in a thousand such counts would be below."""
    run, goal, held = of_few_ticks(DECIDING[ticks]), float(norm.isf(exact)), 0
    for seed in range(60):
        ends = log_interval(estimates(run, 0, goal, 200, 8, seed, 10), 0.95)
        held += ends is not None and ends[0] <= exact <= ends[1]
    assert held >= binom.ppf(1e-3, 60, 0.93)


def test_a_start_that_is_drawn_together_with_the_noise_of_all_ticks() -> None:
    """a^T z + b^T noise is normal: most of it is drawn at the start, some in the first ticks, none in the last."""
    a, b = np.array([2.0, -1.0, 0.5]), np.where(np.arange(TICKS) < 10, 0.3, 0.0)

    def run(paths: Paths) -> np.ndarray:
        return paths.start @ a + noise_of(paths.seeds) @ b

    goal = 4.26 * float(np.sqrt(a @ a + b @ b))
    assert 0.9e-5 < norm.sf(4.26) < 1.1e-5
    check(estimates(run, 3, goal, 400), float(norm.sf(4.26)), 0.8)


def test_what_happens_often_is_counted_and_what_cannot_happen_is_never() -> None:
    plan = plan_climb(walk, WALKS, 0.0, 50, 0)
    assert plan.levels == ()
    assert climb(walk, WALKS, 0.0, plan, 50, 0, 0) == Climb(1.0, (1.0,), (), 50, 50)

    def flat(paths: Paths) -> np.ndarray:
        return np.zeros(len(paths.seeds))

    plan = plan_climb(flat, WALKS, 1.0, 50, 0)
    assert not plan.reached
    assert climb(flat, WALKS, 1.0, plan, 50, 0, 0).probability == 0.0


@pytest.mark.parametrize(("least", "levels"), [(1e-2, 2), (3e-3, 3), (1e-3, 3)])
def test_the_first_climb_stops_at_the_least_probability_that_is_sought(least: float, levels: int) -> None:
    ran: list[int] = []
    plan = plan_climb(walk, WALKS, np.inf, 100, 0, least, ran.append)
    assert (len(plan.levels), plan.reached, plan.met) == (levels, False, 0)
    assert ran == [100] + [100 + 10 * k for k in range(1, 9 * levels + 1)]
    assert plan.flights == flights_of(levels, 100) == ran[-1]


def test_a_seed_repeats_a_climb_and_counts_its_paths() -> None:
    run = [0]

    def counted(paths: Paths) -> np.ndarray:
        run[0] += len(paths.seeds)
        return walk(paths)

    plan = plan_climb(counted, WALKS, 12.0, 100, 3)
    assert run[0] == plan.flights
    one = climb(counted, WALKS, 12.0, plan, 100, 3, 4)
    assert run[0] == plan.flights + one.flights
    assert one.flights == 100 + len(plan.levels) * (100 - 100 // CHAIN)
    assert climb(walk, WALKS, 12.0, plan, 100, 3, 4) == one
    assert climb(walk, WALKS, 12.0, plan, 100, 3, 5) != one
    assert climb(walk, WALKS, 12.0, plan, 100, 4, 3) != one  # repetitions of one seed are none of another's


@pytest.mark.parametrize("b", [0.03, 0.4, 1.0])
def test_a_step_leaves_the_law_as_it_is_and_keeps_what_it_says(b: float) -> None:
    random = np.random.default_rng(1)
    paths = fresh(4000, Size(5, 5, 2), random)
    after = moved(paths, np.full(4000, b), random)
    n = paths.start.size
    assert abs(after.start.mean()) < 4.0 / np.sqrt(n)
    assert abs(after.start.var() - 1.0) < 4.0 * np.sqrt(2.0 / n)
    assert abs(np.mean(paths.start * after.start) - (1.0 - b)) < 4.0 * np.sqrt(2.0 / n)
    changed = np.mean(paths.seeds != after.seeds)
    assert abs(changed - b) <= 4.0 * np.sqrt(b * (1.0 - b) / paths.seeds.size)
    assert len(np.unique(after.seeds)) == after.seeds.size
