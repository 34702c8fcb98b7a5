"""Sine, cosine, arctangent, exponential and logarithm against mpmath at 60 digits."""

import math

import mpmath
import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st
from numba import njit

from ortilo_drake.model.elementary import LARGE, arctan2, cos, exp, log, power_of_two, sin, sin_cos

ANGLES = (
    st.floats(-LARGE, LARGE) | st.floats(-10.0, 10.0) | st.integers(-400_000, 400_000).map(lambda n: n * np.pi / 2.0)
)


@njit
def compiled(x: float) -> tuple[float, float]:
    return sin(x), cos(x)


@njit
def compiled_together(x: float) -> tuple[float, float]:
    return sin_cos(x)


@given(ANGLES)
@example(0.0)
@example(5e-324)
@example(np.pi / 4.0)
@example(-np.pi)
@example(LARGE)
def test_they_are_right_to_an_ulp_and_the_same_compiled(x: float) -> None:
    with mpmath.workdps(60):
        exact = mpmath.sin(x), mpmath.cos(x)
        for found, its in zip((sin(x), cos(x)), exact, strict=True):
            assert abs(mpmath.mpf(found) - its) <= math.ulp(float(its)), x
    assert compiled(x) == compiled_together(x) == sin_cos(x) == (sin(x), cos(x))


@pytest.mark.parametrize("x", [np.inf, -np.inf, np.nan, 1.1e15])
def test_of_what_is_no_angle_they_are_no_number(x: float) -> None:
    assert np.isnan([*compiled(x), sin(x), cos(x)]).all()


@given(st.floats(LARGE, 1e15))
def test_of_many_turns_they_are_on_the_unit_circle(x: float) -> None:
    assert sin(x) ** 2 + cos(x) ** 2 == pytest.approx(1.0, abs=1e-15)
    assert compiled(-x) == (-sin(x), cos(x))


SIGNED = (0.0, -0.0, 1.0, -1.0, np.inf, -np.inf, np.nan)


@njit
def more_compiled(y: float, x: float) -> tuple[float, float]:
    return arctan2(y, x), exp(x)


def ulps_of_angle(y: float, x: float) -> float:
    """Return how far our angle is from mpmath's, which knows no -0."""
    with mpmath.workdps(60):
        its = mpmath.atan2(abs(y), x)
        return float(abs(mpmath.mpf(abs(arctan2(y, x))) - its) / math.ulp(float(its)))


@given(
    st.floats(allow_nan=False, allow_infinity=False) | st.floats(-2.0, 2.0), st.floats(-2.0, 2.0) | st.floats(-1e150)
)
@example(1.0, 5e-324)
@example(5e-324, -1.0)
@example(5e-324, 1.5e-323)
@example(1.7e308, -1.7e308)
@example(1.7e308, 1e-308)
@example(2.0**-28, 1.0)
@example(0.4375, 1.0)
@example(0.6958420966801261, 0.9681281344)  # a ratio of 23 / 32
def test_the_angle_is_right_to_an_ulp_and_the_same_compiled(y: float, x: float) -> None:
    assume(x < np.inf and (x, y) != (0.0, 0.0))
    assert ulps_of_angle(y, x) <= 1.0
    assert more_compiled(y, x)[0] == arctan2(y, x)


def test_the_angle_is_right_to_an_ulp_where_rounding_is_worst() -> None:
    rng = np.random.default_rng(39)
    ratios = np.concatenate(
        [rng.uniform(0.4, 0.76, 500), [c + k * 2.0**-52 for c in (0.4375, 0.71875) for k in (-1, 1)]]
    )
    for ratio, x in zip(ratios.tolist(), rng.uniform(0.5, 1.0, ratios.size).tolist(), strict=True):
        for scale in (1.0, 2.0**701, 2.0**-701, 2.0**-1040):
            assert ulps_of_angle(ratio * x * scale, x * scale) <= 1.0, (ratio, x, scale)


@pytest.mark.parametrize("y", SIGNED)
@pytest.mark.parametrize("x", SIGNED)
def test_the_angle_of_what_lies_on_an_axis_or_at_infinity_is_numpys(y: float, x: float) -> None:
    found, its = arctan2(y, x), np.arctan2(y, x)
    assert np.array_equal(found, its, equal_nan=True)
    assert np.isnan(its) or np.signbit(found) == np.signbit(its)


@pytest.mark.long
@given(st.floats(-700.0, 700.0) | st.floats(-2.0, 2.0))
def test_the_exponential_is_right_to_an_ulp_and_the_same_compiled(x: float) -> None:
    with mpmath.workdps(60):
        its = mpmath.exp(x)
        assert abs(mpmath.mpf(exp(x)) - its) <= math.ulp(float(its))
    assert more_compiled(1.0, x)[1] == exp(x)


@pytest.mark.parametrize("x", [np.inf, -np.inf, np.nan, 709.7, 710.0, -746.0, 0.0])
def test_the_exponential_at_its_ends_is_numpys(x: float) -> None:
    with np.errstate(over="ignore", under="ignore"):
        np.testing.assert_allclose(exp(x), np.exp(x), rtol=1e-15)


@pytest.mark.parametrize("n", [0, 1, -1, 10, -30, 1023, -1074])
def test_powers_of_two_are_exact(n: int) -> None:
    assert power_of_two(n) == math.ldexp(1.0, n)


@njit
def compiled_log(x: float) -> float:
    return log(x)


@given(st.floats(1e-300, 1e300) | st.floats(0.5, 2.0))
@example(1.0)
@example(1.5)
def test_the_logarithm_is_right_to_fifteen_digits_and_the_same_compiled(x: float) -> None:
    with mpmath.workdps(60):
        assert abs(log(x) - mpmath.log(x)) < 1e-15 * (1.0 + abs(mpmath.log(x)))
    assert compiled_log(x) == log(x)


def test_the_logarithm_ends_where_it_has_no_number() -> None:
    assert np.isnan([log(0.0), log(-1.0), log(np.inf), log(np.nan), compiled_log(np.nan)]).all()
