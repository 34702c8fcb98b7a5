"""Multilevel splitting against the law of a random walk, which is known exactly."""

import numpy as np
import pytest
from scipy.stats import norm, t

from ortilo_drake.studies.rare.splitting import split
from ortilo_drake.world.noise import normals, stream_id

TICKS = 40


def heights(seeds: np.ndarray) -> np.ndarray:
    """A Gaussian walk from 0: what stands at a tick is made of the noise of those before it."""
    steps = np.array([[normals(int(s), stream_id("walk"), k, 1)[0] for k, s in enumerate(row)] for row in seeds])
    return np.hstack((np.zeros((len(seeds), 1)), np.cumsum(steps, axis=1)[:, :-1]))


def law(goal: float) -> float:
    """P(max of the walk over its ticks >= goal), by the walk's density below the goal, step by step."""
    grid = np.linspace(goal - 45.0, goal, 9001)[:-1] + 0.0025  # midpoints
    density = norm.pdf(grid)
    width, reached = grid[1] - grid[0], norm.sf(goal)
    kernel = norm.pdf(np.arange(-2000, 2001) * width) * width
    for _ in range(TICKS - 2):
        reached += float(np.sum(density * norm.sf(goal - grid)) * width)
        density = np.convolve(density, kernel, mode="same")
    return reached


@pytest.mark.parametrize(("goal", "magnitude"), [(15.0, 1e-2), (24.0, 1e-4)])
def test_the_mean_of_repetitions_holds_the_law_of_a_random_walk(goal: float, magnitude: float) -> None:
    exact = law(goal)
    assert 0.3 * magnitude < exact < 3.0 * magnitude
    found = np.array([split(heights, TICKS, goal, 100, seed).probability for seed in range(24)])
    half = t.ppf(0.9995, 23) * found.std(ddof=1) / np.sqrt(24)  # one in a thousand seeds would miss it
    assert abs(found.mean() - exact) < half < exact


def test_what_happens_often_is_counted_and_what_cannot_happen_is_never() -> None:
    assert split(heights, TICKS, 0.0, 50, 0).probability == 1.0
    none = split(lambda seeds: np.zeros(seeds.shape), TICKS, 1.0, 50, 0)
    assert none.probability == 0.0
    assert none.rounds == 0


def test_a_branch_is_its_twin_up_to_the_level_and_its_own_from_there() -> None:
    flown = []

    def run(seeds: np.ndarray) -> np.ndarray:
        flown.append(seeds.copy())
        return heights(seeds)

    split(run, TICKS, 8.0, 40, 3)
    first = {int(row[0]) for row in flown[0]}
    for rows in flown[1:]:
        for row in rows:
            assert int(row[0]) in first or len(set(row.tolist())) == 1  # begins as a path of the first, or left at once
            assert len(set(row.tolist())) <= len(flown)
            assert row[-1] not in first
