"""Degenerate second-order systems: E[P_k] as the sum over all arrivals there can be, none of them drawn."""

import numpy as np
import pytest

from ortilo_drake.theory.arrivals.second_order import second_order_rate, ticks_to_repeat

TICKS = 18
C = np.array([[1.0, 0.0]])


def turning(modulus: float, turns: float) -> np.ndarray:
    """Return a rotation by so many turns a tick, times a modulus: its two eigenvalues are 2 turns apart."""
    angle = 2.0 * np.pi * turns
    return modulus * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def mean_covariances(A: np.ndarray, failure: float, recovery: float) -> np.ndarray:
    """Return tr E[P_k], k = 0 to TICKS, of the Kalman predictor with W = 0, V = 1, P_0 = I and a good tick before."""
    P, chance, arrived = np.eye(2)[None], np.ones(1), np.ones(1, dtype=bool)
    traces = [2.0]
    for _ in range(TICKS):
        CP = C @ P
        seen = P - np.swapaxes(CP, 1, 2) @ CP / (CP @ C.T + 1.0)
        to_good = np.where(arrived, 1.0 - failure, recovery)
        P = A @ np.concatenate([seen, P]) @ A.T
        chance = np.concatenate([chance * to_good, chance * (1.0 - to_good)])
        arrived = np.repeat([True, False], len(arrived))
        traces.append(float(chance @ np.trace(P, axis1=1, axis2=2)))
    return np.array(traces)


def test_above_its_critical_rate_the_mean_covariance_settles_and_below_it_grows() -> None:
    """A = diag(2, -2), C = [1 1] turned by 45 degrees: l_c = 1 - 2^-4 = 0.9375."""
    A = np.array([[0.0, 2.0], [2.0, 0.0]])  # has the eigenvectors (1, 1) and (1, -1)
    assert second_order_rate(2.0, ticks_to_repeat(*np.linalg.eigvals(A))) == pytest.approx(0.9375)
    settled, growing = mean_covariances(A, 0.02, 0.98), mean_covariances(A, 0.1, 0.9)
    assert settled[-1] / settled[-3] == pytest.approx(1.0, abs=1e-3)
    assert growing[-1] / growing[-3] == pytest.approx(16.0 * 0.1, rel=0.02)


def test_a_jordan_block_needs_the_lower_bound_alone() -> None:
    """Between 1 - |s|^-2 = 0.75 and g's 1 - |s|^-4 = 0.9375 its mean covariance settles."""
    A = np.array([[2.0, 1.0], [0.0, 2.0]])
    assert second_order_rate(2.0, ticks_to_repeat(2.0, 2.0)) == 0.75
    traces = mean_covariances(A, 0.08, 0.92)
    assert traces[-1] / traces[-2] == pytest.approx(1.0, abs=1e-3)


def test_modes_that_never_look_alike_again_have_the_limit_of_many_ticks() -> None:
    s = 1.5 * np.exp(1j)  # 1 radian is no rational share of a turn
    assert ticks_to_repeat(s, s.conjugate()) is None
    assert second_order_rate(1.5, None) == pytest.approx(1.0 - 1.5**-2)
    assert second_order_rate(1.5, 10**9) == pytest.approx(second_order_rate(1.5, None), abs=1e-8)
