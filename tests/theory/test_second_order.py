"""Degenerate second-order systems: E[P_k] as the sum over all arrivals there can be, none of them drawn."""

import numpy as np
import pytest

from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.theory.arrivals.critical_rate import growth_in_bursts, second_order_rate, ticks_to_repeat

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


@pytest.mark.parametrize(("turns", "d"), [(1 / 4, 2), (1 / 3, 3), (1 / 6, 3)])
@pytest.mark.parametrize(("failure", "recovery"), [(0.4, 0.6), (0.3, 0.7), (0.05, 0.5), (0.5, 0.55)])
def test_the_mean_covariance_grows_as_the_rarest_class_of_ticks_says(
    turns: float, d: int, failure: float, recovery: float
) -> None:
    A = turning(2.0, turns)
    assert ticks_to_repeat(*np.linalg.eigvals(A)) == d
    traces = mean_covariances(A, failure, recovery)
    predicted = growth_in_bursts(2.0, d, failure, recovery) ** d
    assert predicted > 1.5**d
    assert traces[-1] / traces[-1 - d] == pytest.approx(predicted, rel=0.02)


@pytest.mark.parametrize(("turns", "d"), [(1 / 8, 4), (3 / 10, 5), (0.5 / 7, 7)])
def test_losses_of_all_but_every_dth_packet(turns: float, d: int) -> None:
    """The chance of such losses, by multiplying the chain's matrices; their mean covariance then grows so much faster.

    With d of 4 and more, 18 ticks of all arrivals there can be are too few for E[P_k] to show its growth to a percent.
    """
    assert ticks_to_repeat(*np.linalg.eigvals(turning(1.5, turns))) == d
    failure, recovery = 0.2, 0.35
    chain = np.array([[1.0 - failure, failure], [recovery, 1.0 - recovery]])
    to_bad = chain * np.array([0.0, 1.0])
    over_d_ticks = np.linalg.matrix_power(to_bad, d - 1) @ chain
    radius = np.max(np.abs(np.linalg.eigvals(over_d_ticks)))
    assert growth_in_bursts(1.5, d, failure, recovery) ** d == pytest.approx(1.5 ** (2 * d) * radius)


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
    assert growth_in_bursts(1.5, None, 0.2, 0.3) == pytest.approx(growth_in_bursts(1.5, 900, 0.2, 0.3), rel=2e-3)


@pytest.mark.parametrize("d", [2, 3, 7])
def test_independent_losses_are_a_channel_without_memory(d: int) -> None:
    l_c = second_order_rate(1.3, d)
    assert growth_in_bursts(1.3, d, 1.0 - l_c, l_c) == pytest.approx(1.0, abs=1e-12)


def test_a_chance_beyond_one_is_refused() -> None:
    with pytest.raises(InputError, match=r"^recovery: 1\.5: must lie in \[0, 1\]$"):
        growth_in_bursts(1.3, 2, 0.1, 1.5)
