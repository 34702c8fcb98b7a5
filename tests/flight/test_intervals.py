"""Intervals against SciPy's own, by hand, and by how often they hold what they should."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import beta, binomtest, quantile_test

from ortilo_drake.flight.intervals import middle_of, quantile, quantile_interval, share_interval


@pytest.mark.parametrize(("events", "trials"), [(0, 20), (7, 20), (20, 20), (3, 400)])
def test_a_shares_interval_is_wilsons(events: int, trials: int) -> None:
    z, share = 1.959963984540054, events / trials
    for end in share_interval(events, trials):
        assert (share - end) ** 2 == pytest.approx(z**2 * end * (1.0 - end) / trials, rel=1e-9, abs=1e-15)
    found = binomtest(events, trials).proportion_ci(0.95, method="wilson")
    assert share_interval(events, trials) == pytest.approx((found.low, found.high))


@pytest.mark.long
@given(st.lists(st.floats(0.0, 1e6), min_size=1, max_size=60), st.sampled_from([0.25, 0.5, 0.75]))
def test_a_quantile_is_numpys_and_its_interval_scipys(values: list[float], q: float) -> None:
    assert quantile(values, q) == pytest.approx(np.quantile(values, q), rel=1e-12, abs=1e-12)
    expected = quantile_test(values, p=q).confidence_interval(0.95)
    found = quantile_interval(values, q)
    if found is None:
        assert np.isnan([expected.low, expected.high]).any()
    else:
        assert found == (expected.low, expected.high)


def test_the_median_of_twenty_lies_between_the_sixth_and_the_fifteenth() -> None:
    """As every table of order statistics has it: P(6 <= B <= 14) = 0.9586 of B ~ Bin(20, 1/2)."""
    assert quantile_interval(range(1, 21)) == (6.0, 15.0)
    assert [quantile_interval(range(n)) is None for n in (5, 6)] == [True, False]
    assert [quantile_interval(range(n), 0.75) is None for n in (12, 13)] == [True, False]


@pytest.mark.family
@pytest.mark.parametrize("q", [0.25, 0.5, 0.75])
@pytest.mark.parametrize("n", [13, 20, 200])
@pytest.mark.parametrize("share_lost", [0.0, 0.2])
def test_the_interval_holds_the_true_quantile_in_95_of_100_cases(n: int, q: float, share_lost: float) -> None:
    """Of Cauchy errors, which have no mean, with a share that is lost, each the worst.

    Exactly: U_(r) <= q <= U_(s) of uniform U, whose order statistics are beta's; simulated as well, with lost flights.
    """
    low, high = quantile_interval(np.arange(1.0, n + 1.0), q) or (math.nan, math.nan)
    exact = beta.cdf(q, low, n + 1 - low) - beta.cdf(q, high, n + 1 - high)
    assert 0.95 <= exact < 1.0
    rng, cases, held = np.random.default_rng(n), 2000, 0
    values = rng.standard_cauchy(size=(cases, n))
    true = math.tan(math.pi * (q / (1.0 - share_lost) - 0.5)) if q < 1.0 - share_lost else math.inf
    values[rng.random(size=(cases, n)) < share_lost] = np.inf
    for row in values.tolist():
        ends = quantile_interval(row, q)
        assert ends is not None
        held += ends[0] <= true <= ends[1]
    assert held / cases > 0.95 - 3.0 * math.sqrt(0.05 * 0.95 / cases)


def test_where_lost_flights_stand_a_median_is_lost() -> None:
    for kept, lost, expected in (([1.0, 2.0, 3.0], 2, 3.0), ([1.0, 2.0], 2, math.inf), ([1.0, 2.0], 3, math.inf)):
        assert middle_of(kept, lost).median == expected
    found = middle_of([float(k) for k in range(1, 14)], 7)
    assert (found.median, found.interval) == (10.5, (6.0, math.inf))
    assert (found.kept, found.kept_interval) == (7.0, (3.0, 11.0))
    nothing = middle_of([], 0)
    assert (nothing.median, nothing.interval, nothing.kept, nothing.kept_interval) == (None,) * 4
    assert middle_of([], 8).interval == (math.inf, math.inf)


def test_none_lost_has_one_median() -> None:
    found = middle_of([3.0, 1.0, 2.0, 4.0, 6.0, 5.0], 0)
    assert (found.median, found.interval) == (found.kept, found.kept_interval) == (3.5, (1.0, 6.0))
