"""The search for the level that loses 5 %: its first steps, its end, and its intervals on known curves."""

from collections.abc import Callable
from itertools import count

import numpy as np
import pytest
from scipy.special import expit, logit
from scipy.stats import weibull_min

from ortilo_drake.studies.sensitivity.loss_level import (
    BATCH,
    Flown,
    LossLevel,
    is_settled,
    ladder,
    loss_level,
    next_level,
)

SHARE = 0.05
LEVELS = ladder(1.0, 64.0)
NONE_LOST = Flown(0.0, 70, 0)


def searched(chance: Callable[[float], float], seed: int, most: int = 40) -> tuple[LossLevel, dict[float, Flown]]:
    """Return what a search finds, whose flights are lost with a known chance, after 20 flights at a given value."""
    rng = np.random.default_rng(seed)
    given = 5.0
    flown = {given: Flown(given, 20, int(rng.binomial(20, chance(given))))}
    for batch in count(1):
        found = loss_level(NONE_LOST, list(flown.values()), SHARE)
        if is_settled(found, LEVELS) or BATCH * batch > most:
            return found, flown
        level = next_level(NONE_LOST, list(flown.values()), LEVELS, SHARE)
        _, flights, lost = flown.get(level, Flown(level, 0, 0))
        flown[level] = Flown(level, flights + BATCH, lost + int(rng.binomial(BATCH, chance(level))))
    raise AssertionError


def test_the_ladder_reaches_from_the_largest_to_a_thirtysecond_of_the_careful() -> None:
    levels = ladder(3.0, 50.0)
    assert levels[0] == 50.0
    assert 3.0 / 32.0 <= levels[-1] < 3.0 / 32.0 * 2.0**0.25
    np.testing.assert_allclose(levels[:-1] / levels[1:], 2.0**0.25)


def test_without_flights_it_begins_by_bisection() -> None:
    level = next_level(NONE_LOST, [], LEVELS, SHARE)
    assert LEVELS.min() * 4.0 < level < LEVELS.max() / 4.0
    assert next_level(NONE_LOST, [Flown(level, 4, 4)], LEVELS, SHARE) < level / 2.0
    assert next_level(NONE_LOST, [Flown(level, 4, 0)], LEVELS, SHARE) > level


@pytest.mark.family
@pytest.mark.parametrize("threshold", [0.3, 3.0, 20.0])
def test_a_threshold_is_found_by_few_flights(threshold: float) -> None:
    found, flown = searched(lambda v: float(v > threshold), 0)
    low, high = found.interval
    assert low is not None
    assert high is not None
    assert low < threshold * 1.01
    assert threshold < 1.3 * high  # a step of the ladder: with all or none lost it may be anywhere between two
    assert high <= 2.0 * low
    assert sum(row.flights for row in flown.values()) <= 60


@pytest.mark.parametrize("none", [True, False])
def test_where_nothing_or_all_is_lost_it_ends_at_the_edge(none: bool) -> None:
    found, flown = searched(lambda _: 0.0 if none else 1.0, 0)
    edge = LEVELS.max() if none else LEVELS.min()
    assert any(edge / 1.3 < level < edge * 1.3 for level in flown)
    assert found.value is None if none else found.value == 0.0
    low, high = found.interval
    assert (high is None) if none else (low == 0.0)
    assert (low or 0.0) >= edge / 2.0 if none else (high or np.inf) <= 2.0 * edge


@pytest.mark.long
@pytest.mark.parametrize("curve", ["logistic", "Weibull"])
@pytest.mark.parametrize(("true", "slope"), [(2.0, 3.0), (9.0, 8.0)])
def test_the_interval_holds_the_true_level_as_often_as_it_says(curve: str, true: float, slope: float) -> None:
    scale = true / weibull_min(slope).ppf(SHARE)

    def chance(level: float) -> float:
        if curve == "Weibull":
            return float(weibull_min(slope, scale=scale).cdf(level))
        return float(expit(logit(SHARE) + slope * np.log(level / true)))

    inside, flights = 0, 0
    for seed in range(40):
        found, flown = searched(chance, seed)
        low, high = found.interval
        inside += (low or 0.0) <= true <= (high or np.inf)
        flights += sum(row.flights for row in flown.values())
    assert inside >= 34  # 38 expected; of 40 with a chance of 0.95 fewer than 34 happens once in 300
    assert flights <= 40 * 60
