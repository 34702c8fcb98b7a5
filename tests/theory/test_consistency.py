"""Normalised squares and their bands against closed forms and simulated chi-square numbers."""

import numpy as np
import pytest
from scipy import stats

from ortilo_drake.theory.consistency.consistency import (
    average_band,
    ensemble_average,
    mean_interval,
    normalized_square,
    share_in_band,
    time_average,
)


def test_the_normalised_square_is_e_by_the_inverse() -> None:
    rng = np.random.default_rng(1)
    A = rng.normal(size=(50, 4, 4))
    S, e = A @ np.swapaxes(A, 1, 2) + 0.1 * np.eye(4), rng.normal(size=(50, 4))
    scale = np.array([1.0, 1e-6, 1e5, 1.0])  # units must not matter
    expected = [v @ np.linalg.inv(M) @ v for v, M in zip(e, S, strict=True)]
    found = normalized_square(e * scale, S * scale[:, np.newaxis] * scale)
    np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_an_irregular_covariance_has_no_normalised_square() -> None:
    S = np.array([np.eye(2), np.ones((2, 2)), np.diag([1.0, 0.0]), np.full((2, 2), np.nan)])
    found = normalized_square(np.ones((4, 2)), S)
    assert found[0] == pytest.approx(2.0)
    assert np.isnan(found[1:]).all()


def test_the_band_is_that_of_bar_shalom() -> None:
    # 50 runs, 2 degrees of freedom: the book's example, [1.5, 2.6] from chi2_100 = [74.2, 129.6].
    low, high = average_band(2, 50)
    assert low == pytest.approx(74.222 / 50, rel=1e-4)
    assert high == pytest.approx(129.561 / 50, rel=1e-4)


def test_averages_leave_out_what_is_not_there() -> None:
    average, count = ensemble_average([np.array([1.0, np.nan, 3.0]), np.array([3.0, np.nan])])
    assert count.tolist() == [2, 0, 1]
    np.testing.assert_equal(average, [2.0, np.nan, 3.0])


def test_white_noise_lies_in_its_band_19_times_of_20() -> None:
    rng = np.random.default_rng(2)
    flights = list(rng.chisquare(3, size=(20, 4000)))
    assert share_in_band(flights, 3) == pytest.approx(0.95, abs=0.012)


def test_the_interval_of_the_mean_is_students() -> None:
    samples = np.array([2.0, 3.5, 2.5, 4.0])
    expected = stats.ttest_1samp(samples, 0.0).confidence_interval(0.95)
    assert mean_interval(samples) == pytest.approx((expected.low, expected.high))
    assert mean_interval(samples[:1]) is None


@pytest.mark.long
def test_the_time_average_covers_the_truth_where_ticks_are_dependent() -> None:
    # One chi-square number a flight, held over all its ticks: a band over ticks would be far too narrow.
    rng, covered = np.random.default_rng(3), 0
    masks = [np.ones(50, dtype=bool)] * 30
    for _ in range(400):
        flights = [np.full(50, value) for value in rng.chisquare(3, size=30)]
        found = time_average(flights, masks, 3)
        assert found is not None
        covered += found.consistent
    assert 0.90 < covered / 400 < 0.98


def test_only_the_mask_counts() -> None:
    flights, half = [np.array([1.0, 9.0]), np.array([3.0, 9.0])], np.array([True, False])
    found = time_average(flights, [half, half], 2)
    assert found is not None
    assert found.mean == 2.0
    assert found.ratio == 1.0
    assert time_average(flights, [np.zeros(2, dtype=bool)] * 2, 2) is None
