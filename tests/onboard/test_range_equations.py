"""The normal equations of ranges, the inverse and the product by cofactors, against NumPy's matrices."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ortilo_drake.onboard.ranging.range_equations import (
    MAX_SD,
    Symmetric,
    fix_with_covariance,
    inverse,
    matrix,
    normal_equations,
)
from ortilo_drake.onboard.ranging.range_equations import product as times

UPPER = np.triu_indices(3)


def dense(N: Symmetric) -> np.ndarray:
    matrix = np.zeros((3, 3))
    matrix[UPPER] = N
    return matrix + np.triu(matrix, 1).T


def symmetric(seed: int, scale: float = 1.0, least: float = 0.1) -> np.ndarray:
    """A symmetric matrix of eigenvalues scale, 0.4 scale and least scale."""
    turn = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    return scale * (turn * np.array([1.0, 0.4, least])) @ turn.T


@pytest.mark.parametrize("seed", range(10))
def test_the_normal_equations_are_those_of_the_stacked_ranges(seed: int) -> None:
    rng = np.random.default_rng(seed)
    anchors, p, noise = 5.0 * rng.normal(size=(7, 3)), rng.normal(size=3), rng.uniform(0.01, 0.1, 2)
    ranges, there = rng.uniform(1.0, 9.0, 7), np.array([1.0, 0.0, 1.0, 1.0, 0.0, 1.0, 1.0])
    cost, N, g = normal_equations(p, ranges, there, anchors, noise)
    used = there == 1.0
    away = p - anchors[used]
    distances = np.linalg.norm(away, axis=1)
    J, e = away / distances[:, None], ranges[used] - distances
    weights = np.diag(1.0 / (noise[0] + noise[1] * ranges[used]) ** 2)
    assert cost == pytest.approx(e @ weights @ e, rel=1e-12)
    np.testing.assert_allclose(dense(N), J.T @ weights @ J, rtol=1e-10)
    np.testing.assert_allclose(g, J.T @ weights @ e, rtol=1e-10)


def test_no_range_is_believed_better_than_a_millimetre_and_an_anchors_own_place_is_no_trouble() -> None:
    anchor, somewhere = np.zeros((1, 3)), np.array([0.3, 0.0, 0.0])
    cost, N, _ = normal_equations(somewhere, np.array([0.1]), np.ones(1), anchor, np.array([0.0, 0.005]))
    assert cost == pytest.approx((0.2 / 1e-3) ** 2)
    assert N[0] == pytest.approx(1e6)
    cost, N, g = normal_equations(np.zeros(3), np.array([0.5]), np.ones(1), anchor, np.array([0.1, 0.0]))
    assert cost == pytest.approx(25.0)
    assert not np.any(N)
    assert not np.any(g)


@given(st.integers(0, 10**6), st.floats(-9.0, 9.0), st.floats(1e-3, 1.0))
def test_the_inverse_and_the_product_are_numpys(seed: int, exponent: float, least: float) -> None:
    N, g = symmetric(seed, 10.0**exponent, least), np.random.default_rng(seed + 1).normal(size=3)
    definite, C = inverse(tuple(N[UPPER]))
    assert definite
    np.testing.assert_allclose(dense(C), np.linalg.inv(N), rtol=1e-8, atol=1e-8 * np.abs(C).max())
    np.testing.assert_allclose(times(tuple(N[UPPER]), g), N @ g, rtol=1e-9, atol=1e-9 * np.abs(N).max())


@pytest.mark.parametrize(
    "N",
    [
        np.zeros((3, 3)),
        np.diag([1.0, 1.0, 0.0]),
        np.diag([0.0, 1.0, 1.0]),
        np.diag([1.0, -1.0, -1.0]),
        np.diag([-1.0, -1.0, 1.0]),
        np.diag([-1.0, 1.0, -1.0]),
        np.ones((3, 3)),
        symmetric(1, 1.0, 1e-17),
        np.full((3, 3), np.nan),
    ],
)
def test_what_is_not_positive_definite_has_no_inverse(N: np.ndarray) -> None:
    assert not inverse(tuple(N[UPPER]))[0]


@pytest.mark.parametrize("lasts", [0.0, 0.3, 20.0])
def test_a_position_is_a_fix_if_it_is_known_to_ten_metres(lasts: float) -> None:
    """Three anchors ahead, to the left and above: J = -I, and C = s^2 I whatever lasts of the ranges' errors."""
    p, there = np.array([1.0, 2.0, 3.0]), np.ones(3)
    anchors, ranges = p + 4.0 * np.eye(3), np.full(3, 4.0)
    for share, found in [(0.99, True), (1.01, False)]:
        sd = share * MAX_SD / np.sqrt(3.0)
        answer, q, C = fix_with_covariance(tuple(p), ranges, there, anchors, np.array([sd, 0.0, lasts]))
        assert answer == found
        np.testing.assert_array_equal(q, p)
        np.testing.assert_allclose(matrix(C), sd**2 * np.eye(3) if found else np.zeros((3, 3)), rtol=1e-9)
    two = np.array([1.0, 1.0, 0.0])
    assert not fix_with_covariance(tuple(p), ranges, two, anchors, np.array([0.1, 0.0, lasts]))[0]


@pytest.mark.parametrize("seed", range(5))
def test_with_errors_that_last_the_weights_are_of_both_and_the_covariance_of_what_is_new(seed: int) -> None:
    rng = np.random.default_rng(seed)
    anchors, p, noise = 5.0 * rng.normal(size=(7, 3)), rng.normal(size=3), np.array([0.02, 0.03, 0.2])
    there = np.array([1.0, 0.0, 1.0, 1.0, 1.0, 1.0, 1.0])
    ranges = np.linalg.norm(p - anchors, axis=1)
    used = there == 1.0
    J = (p - anchors[used]) / ranges[used, None]
    new = np.diag((noise[0] + noise[1] * ranges[used]) ** 2)
    weights = np.linalg.inv(new + noise[2] ** 2 * np.eye(6))
    _, N, _ = normal_equations(p, ranges, there, anchors, noise)
    np.testing.assert_allclose(dense(N), J.T @ weights @ J, rtol=1e-10)
    by_ranges = np.linalg.solve(J.T @ weights @ J, J.T @ weights)
    found, _, C = fix_with_covariance(tuple(p), ranges, there, anchors, noise)
    assert found
    np.testing.assert_allclose(matrix(C), by_ranges @ new @ by_ranges.T, rtol=1e-9)
