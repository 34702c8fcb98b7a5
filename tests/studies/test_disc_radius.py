"""The disc that a plane Gaussian leaves with a given probability, against closed forms and SciPy."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import dblquad
from scipy.optimize import brentq
from scipy.stats import multivariate_normal, ncx2

from ortilo_drake.studies.tube.disc_radius import THREE_SIGMA, disc_radii


def radius(m: tuple[float, float], C: list[list[float]], outside: float = THREE_SIGMA) -> float:
    return float(disc_radii(np.array([m]), np.array([C]), outside)[0])


@pytest.mark.parametrize("outside", [0.5, 0.01, THREE_SIGMA])
def test_round_covariance_is_rayleigh(outside: float) -> None:
    expected = 0.3 * math.sqrt(-2.0 * math.log(outside))
    assert radius((0.0, 0.0), [[0.09, 0.0], [0.0, 0.09]], outside) == pytest.approx(expected, rel=1e-8)


def test_one_dimension_is_three_sigma() -> None:
    c, s = np.cos(0.7), np.sin(0.7)
    line = 0.04 * np.outer([c, s], [c, s])
    assert radius((0.0, 0.0), line.tolist()) == pytest.approx(0.6, rel=1e-6)


def test_no_spread_is_the_mean() -> None:
    assert radius((0.3, -0.4), [[0.0, 0.0], [0.0, 0.0]]) == pytest.approx(0.5)


@pytest.mark.long
@given(st.floats(0.0, 10.0), st.floats(0.0, 2.0 * np.pi))
def test_round_covariance_off_centre_is_noncentral_chi_square(distance: float, direction: float) -> None:
    m = (distance * math.cos(direction), distance * math.sin(direction))
    expected = brentq(lambda R: ncx2.sf(R**2, 2, distance**2 + 1e-12) - THREE_SIGMA, 0.1, 30.0, xtol=1e-12)
    assert radius(m, [[1.0, 0.0], [0.0, 1.0]]) == pytest.approx(expected, rel=1e-6)


def test_any_covariance_by_double_quadrature() -> None:
    m, C = np.array([0.4, -0.2]), np.array([[1.0, 0.5], [0.5, 0.6]])
    R = radius(tuple(m), C.tolist(), 0.05)
    density = multivariate_normal(m, C).pdf
    inside, _ = dblquad(
        lambda y, x: density([x, y]), -R, R, lambda x: -math.sqrt(R**2 - x**2), lambda x: math.sqrt(R**2 - x**2),
        epsabs=1e-7,
    )  # fmt: skip
    assert 1.0 - inside == pytest.approx(0.05, abs=1e-5)


@given(st.floats(0.01, 3.0), st.floats(0.0, 1.0), st.floats(-3.0, 3.0), st.floats(0.1, 10.0))
def test_radius_scales_and_turns_with_the_covariance(s: float, flatness: float, angle: float, scale: float) -> None:
    C = np.diag([s**2, (flatness * s) ** 2])
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    R = radius((0.0, 0.0), C.tolist())
    assert 3.0 * s * (1.0 - 1e-6) <= R <= 3.4394 * s
    assert radius((0.0, 0.0), (scale**2 * turn @ C @ turn.T).tolist()) == pytest.approx(scale * R, rel=1e-6)
