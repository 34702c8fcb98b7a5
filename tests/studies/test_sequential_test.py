"""Wald's test of a share of lost flights: its errors by the exact distribution of where it ends."""

import numpy as np
import pytest
from scipy.stats import binom

from ortilo_drake.studies.sensitivity.loss_level import ABOVE, APART, ERROR, loses_more

SHARE = 0.05


def decided(p: float, most: int = 600) -> tuple[float, float]:
    """Return the chances that it decides for more and for less, by a dense recursion over flights and losses."""
    going, more, less = np.array([1.0]), 0.0, 0.0
    for flights in range(1, most + 1):
        going = np.append(going, 0.0) * (1.0 - p) + np.insert(going, 0, 0.0) * p
        for lost in range(flights + 1):
            decision = loses_more(flights, lost, SHARE)
            if decision is not None:
                more, less = (more + going[lost], less) if decision else (more, less + going[lost])
                going[lost] = 0.0
    return more, less


@pytest.mark.long
def test_its_errors_are_as_stated() -> None:
    most = ERROR / (1.0 - ERROR)
    more, less = decided(SHARE / APART)
    assert more <= most
    assert more + less == pytest.approx(1.0, abs=1e-4)
    more, less = decided(SHARE * ABOVE)
    assert less <= most
    assert more + less == pytest.approx(1.0, abs=1e-4)


def test_it_is_the_ratio_of_two_binomial_likelihoods() -> None:
    bound = (1.0 - ERROR) / ERROR
    for flights in (1, 7, 20, 35, 36, 100):
        for lost in range(flights + 1):
            ratio = binom.pmf(lost, flights, SHARE * ABOVE) / binom.pmf(lost, flights, SHARE / APART)
            expected = True if ratio >= bound else False if ratio <= 1.0 / bound else None
            assert loses_more(flights, lost, SHARE) is expected
