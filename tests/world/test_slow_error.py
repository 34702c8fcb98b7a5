"""Errors that last, against closed forms: stationary and exponentially correlated, or growing as a random walk."""

import numpy as np
import pytest
from drake_box import PlayedBox

from ortilo_drake.diagrams.wiring.truth import first_slow
from ortilo_drake.loop.element import Values
from ortilo_drake.world.drawn_truth import of_seed
from ortilo_drake.world.noise import SlowNoise, gauss_markov, random_walk
from ortilo_drake.world.vehicle.disturbance import lasting_force_box

H = 1.0 / 30.0


def source_of(noise: SlowNoise, seed: int, bias: np.ndarray) -> PlayedBox:
    """Return what adds such an error to nothing, begun as in the world of a seed."""
    source = PlayedBox(lasting_force_box(noise, H), H, seed, disturbance=np.zeros(len(noise.a)))
    drawn = first_slow("lasting_force", noise.start, of_seed(seed))
    source.system.give(source.context, {"lasting_force": drawn.updated(Values(tables={"bias": bias}))})
    return source


def series(noise: SlowNoise, ticks: int, seed: int = 3, bias: float = 0.0) -> np.ndarray:
    """Return e_0 .. e_ticks (ticks + 1, n) as a simulator's monitor sees them, before each tick's update."""
    source = source_of(noise, seed, np.full(len(noise.a), bias))
    found = [source.say(0)]
    for k in range(ticks):
        source.step()
        found.append(source.say(k + 1))
    return np.array(found)


def test_gauss_markov_noise_is_stationary_and_forgets_exponentially() -> None:
    n, ticks, T, sd = 400, 150, 0.5, 0.3
    x = series(gauss_markov(np.full(n, sd), T, H), ticks)
    # n independent paths: the variance of each tick from x_0 on, and the correlation at each lag.
    for k in (0, 1, 30, ticks):
        assert abs(np.std(x[k]) / sd - 1.0) < 4.0 / np.sqrt(2.0 * n), k
    for lag in (1, 5, 15, 45):
        products = (x[lag:] * x[:-lag]).mean() / sd**2
        # Paths are independent; along one, ticks a correlation time T apart nearly are.
        error = 5.0 / np.sqrt(n * (ticks - lag) * H / (2.0 * T))
        assert products == pytest.approx(np.exp(-lag * H / T), abs=error), lag
    assert abs(x.mean()) < 5.0 * sd / np.sqrt(n * ticks * H / (2.0 * T))


def test_a_random_walk_grows_with_the_root_of_time_and_keeps_its_mean() -> None:
    n, after_1_s = 500, 0.02
    x = series(random_walk(np.full(n, after_1_s), H), 120, bias=0.7) - 0.7
    assert not x[0].any()
    for k in (30, 120):
        assert np.std(x[k]) == pytest.approx(after_1_s * np.sqrt(k * H), rel=4.0 / np.sqrt(2.0 * n))
    steps = np.diff(x, axis=0)
    assert np.abs(np.corrcoef(steps[0], steps[1])[0, 1]) < 4.0 / np.sqrt(n)


def test_it_is_the_seeds() -> None:
    noise = gauss_markov(np.full(3, 0.1), 2.0, H)
    one = series(noise, 20)
    np.testing.assert_array_equal(series(noise, 20), one)
    assert not np.isclose(series(noise, 20, seed=4), one).any()
    np.testing.assert_allclose(series(noise, 20, bias=0.5) - 0.5, one, rtol=0.0, atol=1e-12)


def test_it_runs_on_autodiff() -> None:
    source = source_of(gauss_markov(np.full(3, 0.1), 2.0, H), 7, np.array([0.1, 0.2, 0.3]))
    other = source.on_autodiff(7)
    other.context.SetTimeStateAndParametersFrom(source.context)
    for one, its in ((source.say(), other.say()), (source.step(), other.step()), (source.say(1), other.say(1))):
        assert [float(v.value()) for v in its] == one.tolist()
        assert one.all()
