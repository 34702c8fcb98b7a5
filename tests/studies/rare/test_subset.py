"""Subset simulation against laws that are known exactly: a random walk's, a burst's, a linear Gaussian start's."""

import numpy as np
import pytest
from numba import njit
from scipy.stats import binom, norm, t

from ortilo_drake.studies.rare.estimate import log_interval
from ortilo_drake.studies.rare.subset import CHAIN, Climb, climb, flights_of, independent_paths, plan_climb, propose

TICKS, REPETITIONS = 40, 24
TO_BAD, TO_GOOD = 0.05, 0.4


def walk(z: np.ndarray) -> np.ndarray:
    """The highest point of a Gaussian walk from 0, of the noise of all ticks but the last."""
    return np.maximum(np.cumsum(z, axis=1, dtype=float)[:, :-1].max(axis=1), 0.0)


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


@njit
def _longest_bursts(z: np.ndarray, to_bad: float, to_good: float) -> np.ndarray:
    longest = np.zeros(len(z))
    for i in range(len(z)):
        bad, run = False, 0
        for k in range(z.shape[1]):
            bad = z[i, k] >= to_good if bad else z[i, k] < to_bad
            run = run + 1 if bad else 0
            longest[i] = max(longest[i], run)
    return longest


def longest_burst(z: np.ndarray) -> np.ndarray:
    """The most ticks in a row in which a Gilbert-Elliott chain is bad; each is by Phi(z) what it is."""
    return _longest_bursts(z, float(norm.ppf(TO_BAD)), float(norm.ppf(TO_GOOD)))


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


def estimates(run, size: int, goal: float, paths: int, seed: int = 0, repetitions: int = REPETITIONS) -> np.ndarray:
    plan = plan_climb(run, size, goal, paths, seed)
    return np.array([climb(run, size, goal, plan, paths, seed, i).probability for i in range(repetitions)])


def check(found: np.ndarray, exact: float, width: float) -> None:
    """The mean's interval holds what is exact, one in a thousand seeds aside, and is so wide at most."""
    half = t.ppf(0.9995, len(found) - 1) * found.std(ddof=1) / np.sqrt(len(found))
    assert abs(found.mean() - exact) < half < width * exact


@pytest.mark.family
@pytest.mark.parametrize(("goal", "magnitude"), [(15.0, 1e-2), (24.0, 1e-4), (30.0, 1e-6)])
def test_the_law_of_a_random_walk(goal: float, magnitude: float) -> None:
    exact = law_of_walk(goal)
    assert 0.3 * magnitude < exact < 3.0 * magnitude
    check(estimates(walk, TICKS, goal, 800), exact, 0.8)


@pytest.mark.long
def test_the_law_of_the_longest_burst_whose_heights_are_whole_numbers() -> None:
    exact = law_of_bursts(18)
    assert 5e-5 < exact < 5e-4
    check(estimates(longest_burst, TICKS, 18.0, 2000), exact, 0.8)


def test_heights_of_which_most_are_equal_are_climbed() -> None:
    """All but 1.5 % of the walks come to 0 and no higher, then by whole fives: no tenth of them is a level."""

    def steps(z: np.ndarray) -> np.ndarray:
        return 5.0 * np.maximum(np.floor(walk(z) / 5.0) - 2.0, 0.0)

    exact = law_of_walk(25.0)  # 5 x (5 - 2) = 15
    assert 3e-5 < exact < 1e-4
    check(estimates(steps, TICKS, 15.0, 800), exact, 1.0)


def mean_of(ticks: int):
    """Return a height that so many ticks decide together: a standard normal number."""

    def run(z: np.ndarray) -> np.ndarray:
        return z[:, :ticks].sum(axis=1, dtype=float) / np.sqrt(ticks)

    return run


def highest(z: np.ndarray) -> np.ndarray:
    """A height that one tick decides, whichever it is: the largest of all numbers."""
    return z.max(axis=1).astype(float)


def goal_of_highest(p: float) -> float:
    return float(norm.isf(-np.expm1(np.log1p(-p) / TICKS)))


TOYS = {
    "one tick": (mean_of(1), norm.isf),
    "one of all ticks": (highest, goal_of_highest),
    "two ticks": (mean_of(2), norm.isf),
    "all ticks": (mean_of(TICKS), norm.isf),
}


def held_of(toy: str, exact: float, paths: int, intervals: int) -> int:
    """Return how many intervals of 10 repetitions hold what is exact."""
    (run, goal), held = TOYS[toy], 0
    for seed in range(intervals):
        ends = log_interval(estimates(run, TICKS, float(goal(exact)), paths, seed, 10), 0.95)
        held += ends is not None and ends[0] <= exact <= ends[1]
    return held


@pytest.mark.family
@pytest.mark.parametrize("toy", TOYS)
@pytest.mark.parametrize("exact", [1e-4, 1e-6])
def test_however_few_ticks_decide_the_interval_holds_what_is_exact(toy: str, exact: float) -> None:
    """12 intervals of 100 paths: were they to hold it in 0.93, one in a thousand such counts would be below."""
    assert held_of(toy, exact, 100, 12) >= binom.ppf(1e-3, 12, 0.93)


@pytest.mark.long
def test_the_interval_covers_what_is_exact_in_93_to_97_of_100() -> None:
    """1,200 intervals of 10 repetitions of 200 paths; were it 0.95, one in 500 such shares would be outside."""
    cases = [(toy, exact) for toy in TOYS for exact in (1e-4, 1e-5, 1e-6)]
    held = [held_of(toy, exact, 200, 100) for toy, exact in cases]
    assert min(held) >= binom.ppf(1e-3 / len(cases), 100, 0.93)
    assert 0.93 <= sum(held) / (100 * len(cases)) <= 0.97


@pytest.mark.long
def test_every_repetition_comes_to_the_goal() -> None:
    """Of 24 repetitions of 1,000 paths, whichever ticks decide."""
    for toy in TOYS:
        found = estimates(TOYS[toy][0], TICKS, float(TOYS[toy][1](1e-5)), 1000)
        check(found, 1e-5, 1.0)
        assert np.all(found > 0.0)


def test_a_start_that_is_drawn_together_with_the_noise_of_all_ticks() -> None:
    """a^T z + b^T noise is normal: most of it is drawn at the start, some in the first ticks, none in the last."""
    a, b = np.array([2.0, -1.0, 0.5]), np.where(np.arange(TICKS) < 10, 0.3, 0.0)

    def run(z: np.ndarray) -> np.ndarray:
        return z @ np.append(b, a)

    goal = 4.26 * float(np.sqrt(a @ a + b @ b))
    assert 0.9e-5 < norm.sf(4.26) < 1.1e-5
    check(estimates(run, TICKS + 3, goal, 400), float(norm.sf(4.26)), 0.8)


def test_what_happens_often_is_counted_and_what_cannot_happen_is_never() -> None:
    plan = plan_climb(walk, TICKS, 0.0, 50, 0)
    assert plan.levels == ()
    assert climb(walk, TICKS, 0.0, plan, 50, 0, 0) == Climb(1.0, (1.0,), (), 50, 50)

    def flat(z: np.ndarray) -> np.ndarray:
        return np.zeros(len(z))

    plan = plan_climb(flat, TICKS, 1.0, 50, 0)
    assert not plan.reached
    assert climb(flat, TICKS, 1.0, plan, 50, 0, 0).probability == 0.0


@pytest.mark.parametrize(("least", "levels"), [(1e-2, 2), (3e-3, 3), (1e-3, 3)])
def test_the_first_climb_stops_at_the_least_probability_that_is_sought(least: float, levels: int) -> None:
    ran: list[int] = []
    plan = plan_climb(walk, TICKS, np.inf, 100, 0, least, ran.append)
    assert (len(plan.levels), plan.reached, plan.met) == (levels, False, 0)
    assert ran == [100] + [100 + 10 * k for k in range(1, 9 * levels + 1)]
    assert plan.flights == flights_of(levels, 100) == ran[-1]


def test_a_seed_repeats_a_climb_and_counts_its_paths() -> None:
    run = [0]

    def counted(z: np.ndarray) -> np.ndarray:
        run[0] += len(z)
        return walk(z)

    plan = plan_climb(counted, TICKS, 12.0, 100, 3)
    assert run[0] == plan.flights
    one = climb(counted, TICKS, 12.0, plan, 100, 3, 4)
    assert run[0] == plan.flights + one.flights
    assert one.flights == 100 + len(plan.levels) * (100 - 100 // CHAIN)
    assert climb(walk, TICKS, 12.0, plan, 100, 3, 4) == one
    assert climb(walk, TICKS, 12.0, plan, 100, 3, 5) != one
    assert climb(walk, TICKS, 12.0, plan, 100, 4, 3) != one  # repetitions of one seed are none of another's


@pytest.mark.parametrize("few", [False, True])
@pytest.mark.parametrize("b", [0.03, 0.4, 1.0])
def test_a_step_leaves_the_law_as_it_is_and_keeps_what_it_says(b: float, few: bool) -> None:
    random = np.random.default_rng(1)
    z = independent_paths(4000, 5, random)
    after, n = propose(z, np.full(4000, b), few, random), z.size
    assert abs(after.mean()) < 4.0 / np.sqrt(n)
    assert abs(after.var() - 1.0) < 4.0 * np.sqrt(2.0 / n)
    assert abs(np.mean(z * after) - (1.0 - b)) < 4.0 * np.sqrt(2.0 / n)
    changed = np.mean(z != after)
    assert abs(changed - (b if few else 1.0)) <= 4.0 * np.sqrt(b * (1.0 - b) / n) + 1e-3


def test_what_is_run_at_once_does_not_decide(monkeypatch: pytest.MonkeyPatch) -> None:
    """Paths of many numbers are run in parts: each chain's law stays, so the mean is that of the walk."""
    monkeypatch.setattr("ortilo_drake.studies.rare.subset.AT_ONCE", 7 * TICKS)
    check(estimates(walk, TICKS, 15.0, 400), law_of_walk(15.0), 0.8)
