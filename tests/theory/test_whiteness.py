"""Autocorrelation against NumPy and the textbook's Ljung-Box statistic; its p-value against simulation."""

import numpy as np
import pytest
from scipy import stats

from ortilo_drake.theory.consistency.whiteness import (
    autocorrelation,
    normalized_innovations,
    only_arrivals,
    whiteness_report,
)


def test_normalised_innovations_are_standard_normal() -> None:
    S = np.array([[4.0, 1.0], [1.0, 2.0]])
    e = np.random.default_rng(1).multivariate_normal([0.0, 0.0], S, size=20_000)
    e[5] = np.nan
    z = normalized_innovations(e, np.broadcast_to(S, (20_000, 2, 2)))
    assert np.isnan(z[5]).all()
    np.testing.assert_allclose(np.cov(only_arrivals(z).T), np.eye(2), atol=0.04)


def test_one_series_gives_ljung_and_boxs_statistic() -> None:
    z = np.random.default_rng(2).normal(size=200)
    found = autocorrelation([z[:, np.newaxis]], 5)
    assert found is not None
    classical = np.array([np.dot(z[:-lag], z[lag:]) / np.dot(z, z) for lag in range(1, 6)])
    expected = 200 * 202 * np.sum(classical**2 / (200 - np.arange(1, 6)))
    assert pytest.approx(expected) == found.Q
    assert found.p_value == pytest.approx(stats.chi2.sf(expected, 5))


@pytest.mark.long
def test_the_p_values_of_white_noise_are_uniform() -> None:
    rng, p = np.random.default_rng(3), []
    for _ in range(400):
        flights = [rng.normal(size=(n, 2)) for n in (80, 120, 60)]
        for z in flights:
            z[rng.random(len(z)) < 0.3] = np.nan
        found = autocorrelation(flights, 6)
        assert found is not None
        p.append(found.p_value)
    assert stats.kstest(p, "uniform").pvalue > 0.01


def test_an_autoregression_shows_its_coefficient() -> None:
    rng, flights = np.random.default_rng(4), []
    for _ in range(20):
        z = rng.normal(size=(1000, 1))
        for k in range(1, 1000):
            z[k] = 0.6 * z[k - 1] + 0.8 * z[k]
        flights.append(z)
    found = autocorrelation(flights, 3)
    assert found is not None
    np.testing.assert_allclose(np.array(found.r)[:, 0], [0.6, 0.36, 0.216], atol=0.03)
    assert found.p_value < 1e-10


def test_lags_in_ticks_and_in_arrivals() -> None:
    z = np.full((300, 1), np.nan)
    z[::3] = np.random.default_rng(5).normal(size=(100, 1))
    report = whiteness_report([z], 6)
    assert report is not None
    assert [r is not None for r in report.lag_ticks.r] == [False, False, True, False, False, True]
    assert report.lag_ticks.r[2] == pytest.approx(report.lag_arrivals.r[0])
    assert whiteness_report([np.full((9, 1), np.nan)], 3) is None
