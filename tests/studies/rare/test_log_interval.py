"""The interval on the log scale: lognormal numbers, of which the mean is known."""

import numpy as np
import pytest
from scipy.stats import binom, norm, t

from ortilo_drake.studies.rare.estimate import log_interval


@pytest.mark.family
@pytest.mark.parametrize("spread", [0.3, 1.0, 1.5])
@pytest.mark.parametrize("n", [10, 30])
def test_of_lognormal_numbers_it_holds_the_mean_as_often_as_it_says(spread: float, n: int) -> None:
    """2000 intervals; one in a thousand of such counts would be below that of 0.92 or above that of 0.98."""
    random, exact, held = np.random.default_rng(1), np.exp(spread**2 / 2.0), 0
    for _ in range(2000):
        low, high = log_interval(1e-3 * np.exp(spread * random.standard_normal(n)), 0.95) or (0.0, 0.0)
        held += low <= 1e-3 * exact <= high
    assert binom.ppf(1e-3, 2000, 0.92) <= held <= binom.ppf(0.999, 2000, 0.98)


def test_of_numbers_that_scatter_little_it_is_students() -> None:
    estimates = 1e-3 * (1.0 + 1e-3 * norm.ppf(np.linspace(0.1, 0.9, 9)))
    low, high = log_interval(estimates, 0.95) or (0.0, 0.0)
    half = t.ppf(0.975, 8) * estimates.std(ddof=1) / 3.0
    assert (low, high) == pytest.approx((estimates.mean() - half, estimates.mean() + half), rel=1e-5)


def test_it_lies_about_the_mean_in_any_unit_and_widens_with_zeros() -> None:
    estimates = np.array([1.0, 3.0, 0.5, 2.0, 1.5])
    low, high = log_interval(1e-3 * estimates, 0.95) or (0.0, 0.0)
    assert np.sqrt(low * high) == pytest.approx(1.6e-3)
    tiny = log_interval(1e-9 * estimates, 0.95) or (0.0, 0.0)
    assert np.array(tiny) == pytest.approx(1e-6 * np.array([low, high]))
    with_zeros = log_interval(1e-3 * np.append(estimates, [0.0, 0.0]), 0.95) or (1.0, 1.0)
    assert with_zeros[1] / with_zeros[0] > high / low


def test_without_two_above_zero_there_is_none_and_none_goes_beyond_one() -> None:
    assert log_interval(np.array([0.0, 1e-6, 0.0]), 0.95) is None
    assert log_interval(np.zeros(3), 0.95) is None
    _, high = log_interval(np.array([0.5, 1.0]), 0.95) or (0.0, 0.0)
    assert high == 1.0
