"""The level at which 5 % of the flights are lost: by maximum likelihood, against draws from a known curve."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.special import expit, logit, xlogy

from ortilo_drake.studies.sensitivity.loss_level import Flown, loss_level

SHARE = 0.05
NONE_LOST = Flown(0.0, 20, 0)
LEVELS = (0.5, 1.0, 2.0, 4.0, 8.0)


def logistic(z: np.ndarray) -> np.ndarray:
    return np.asarray(expit(logit(SHARE) + z))


def weibull(z: np.ndarray) -> np.ndarray:
    return np.asarray(1.0 - (1.0 - SHARE) ** np.exp(z))


@pytest.mark.parametrize("curve", [logistic, weibull])
def test_it_is_the_greatest_likelihood_of_both_curves(curve: Callable[[np.ndarray], np.ndarray]) -> None:
    v, n = np.array(LEVELS), 300
    lost = np.round(n * curve(3.0 * np.log(v / 1.3)))

    def cost(parameters: np.ndarray, fitted: Callable[[np.ndarray], np.ndarray]) -> float:
        P = fitted(np.exp(parameters[1]) * (np.log(v) - parameters[0]))
        return -float(np.sum(xlogy(lost, P) + xlogy(n - lost, 1.0 - P)))

    options = {"xatol": 1e-8, "fatol": 1e-10}
    fits = [minimize(cost, [0.0, 0.5], (f,), method="Nelder-Mead", options=options) for f in (logistic, weibull)]
    best = min(fits, key=lambda fit: fit.fun)
    found = loss_level(Flown(0.0, 4000, 0), [Flown(*row) for row in zip(LEVELS, [n] * 5, lost, strict=True)], SHARE)
    assert found.value == pytest.approx(np.exp(best.x[0]), rel=0.03)  # its grid has steps of 1 % in v*, 6 % in b
    low, high = found.interval
    assert low is not None
    assert high is not None
    assert low < 1.3 < high < 1.5 * low


@pytest.mark.long
def test_the_interval_holds_the_true_level_as_often_as_it_says() -> None:
    rng, true, inside = np.random.default_rng(5), 1.7, 0
    for _ in range(40):
        P = expit(logit(SHARE) + 3.0 * np.log(np.array(LEVELS) / true))
        flown = [Flown(v, 40, int(rng.binomial(40, p))) for v, p in zip(LEVELS, P, strict=True)]
        low, high = loss_level(Flown(0.0, 40, 0), flown, SHARE).interval
        inside += (low or 0.0) <= true <= (high or np.inf)
    assert inside >= 34  # 38 expected; of 40 with a chance of 0.95 fewer than 34 happens once in 300


def test_where_none_is_lost_the_level_is_beyond() -> None:
    found = loss_level(NONE_LOST, [Flown(v, 20, 0) for v in LEVELS], SHARE)
    assert found.value is None
    low, high = found.interval
    assert low is not None
    assert low > 1.0
    assert high is None


def test_where_all_are_lost_the_level_is_below() -> None:
    found = loss_level(NONE_LOST, [Flown(v, 20, 20) for v in LEVELS], SHARE)
    assert found.interval[0] == 0.0
    assert found.interval[1] is not None
    assert found.interval[1] < LEVELS[0]


def test_between_none_and_all_lies_the_level() -> None:
    low, high = loss_level(NONE_LOST, [Flown(v, 20, 20 * (v > 2.0)) for v in LEVELS], SHARE).interval
    assert low is not None
    assert high is not None
    assert 0.5 < low < high < 4.0


def test_what_is_lost_without_it_already_leaves_no_level() -> None:
    found = loss_level(Flown(0.0, 20, 5), [Flown(v, 20, 5) for v in LEVELS], SHARE)
    assert found.value == 0.0
    assert found.interval[0] == 0.0
