"""Sine, cosine, exp and log against mpmath at 60 digits."""

import math

import mpmath
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from numba import njit

from ortilo_drake.model.elementary import LARGE, cos, exp, log, sin

ANGLES = (
    st.floats(-LARGE, LARGE) | st.floats(-10.0, 10.0) | st.integers(-400_000, 400_000).map(lambda n: n * np.pi / 2.0)
)


@njit
def compiled(x: float) -> tuple[float, float]:
    return sin(x), cos(x)


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
    assert compiled(x) == (sin(x), cos(x))


@pytest.mark.parametrize("x", [np.inf, -np.inf, np.nan, 1.1e15])
def test_of_what_is_no_angle_they_are_no_number(x: float) -> None:
    assert np.isnan([*compiled(x), sin(x), cos(x)]).all()


@given(st.floats(LARGE, 1e15))
def test_of_many_turns_they_are_on_the_unit_circle(x: float) -> None:
    assert sin(x) ** 2 + cos(x) ** 2 == pytest.approx(1.0, abs=1e-15)
    assert compiled(-x) == (-sin(x), cos(x))


@njit
def compiled_exp_and_log(x: float, y: float) -> tuple[float, float]:
    return exp(x), log(y)


@given(st.floats(-699.0, 0.0), st.floats(1e-300, 1e300))
@example(0.0, 1.0)
@example(-1e-300, 1.5)
def test_exp_and_log_are_right_to_fifteen_digits_and_the_same_compiled(x: float, y: float) -> None:
    with mpmath.workdps(60):
        assert abs(exp(x) / mpmath.exp(x) - 1) < 1e-15 * (2.0 - x)
        assert abs(log(y) - mpmath.log(y)) < 1e-15 * (1.0 + abs(mpmath.log(y)))
    assert compiled_exp_and_log(x, y) == (exp(x), log(y))


def test_exp_and_log_end_where_they_have_no_number() -> None:
    assert exp(-701.0) == exp(-np.inf) == 0.0
    assert np.isnan([log(0.0), log(-1.0), log(np.inf), log(np.nan), *compiled_exp_and_log(np.nan, np.nan)]).all()
