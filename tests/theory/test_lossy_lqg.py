"""LQG over lossy links: the published scalar regions by the very recursions, costs by simulation and by SciPy."""

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.theory.jump_linear.lossy_lqg import (
    modified_riccati,
    steady_modified_riccati,
    tcp_cost,
    tcp_is_stable,
    udp_is_stable,
    udp_solution,
    udp_step,
)

ONE, ZERO = np.eye(1), np.zeros((1, 1))
RATES = np.linspace(0.025, 0.975, 20)


@pytest.mark.parametrize("a", [1.1, 1.5, 2.0])
def test_the_tcp_region_is_where_both_recursions_settle(a: float) -> None:
    # The scalar region: each rate above 1 - 1 / a^2, whatever the other is.
    A = a * ONE
    settles = np.array([steady_modified_riccati(A, ONE, ONE, 0.5 * ONE, rate) is not None for rate in RATES])
    np.testing.assert_array_equal(settles, 1 - 1 / a**2 < RATES)
    for i, gamma in enumerate(RATES):
        for j, nu in enumerate(RATES):
            assert tcp_is_stable(a, gamma, nu) == (settles[i] and settles[j])


@pytest.mark.parametrize("a", [1.1, 1.5, 2.0])
def test_the_udp_region_is_where_the_coupled_recursion_settles(a: float) -> None:
    found = 0
    for gamma in RATES[::2]:
        for nu in RATES[1::2]:
            if abs(a**2 * (gamma + nu - 2 * gamma * nu) / (gamma + nu - gamma * nu) - 1) < 0.02:
                continue  # too near the border to wait for
            settles = udp_solution(a * ONE, ONE, ONE, ONE, ZERO, gamma, nu) is not None
            assert (
                settles
                == (a**2 * (gamma + nu - 2 * gamma * nu) < gamma + nu - gamma * nu)
                == udp_is_stable(a, gamma, nu)
            )
            found += settles
    assert 3 <= found < 97


def test_without_acknowledgement_less_is_stable() -> None:
    tcp = np.array([[tcp_is_stable(1.5, g, n) for g in RATES] for n in RATES])
    udp = np.array([[udp_is_stable(1.5, g, n) for g in RATES] for n in RATES])
    assert np.all(tcp[udp])
    assert udp.sum() < tcp.sum()
    for rate in (0.5, 0.6):  # with one link perfect the other's limit is TCP's, 1 - 1 / a^2 = 0.5556
        assert (
            udp_is_stable(1.5, 1.0, rate)
            == udp_is_stable(1.5, rate, 1.0)
            == tcp_is_stable(1.5, 1.0, rate)
            == (rate > 5 / 9)
        )


def test_the_border_of_the_udp_region_is_where_the_recursion_neither_grows_nor_shrinks() -> None:
    a, gamma = 1.3, 0.8
    # a^2 (gamma + nu - 2 gamma nu) = gamma + nu - gamma nu, solved for nu
    nu = gamma * (a**2 - 1) / (2 * a**2 * gamma - a**2 + 1 - gamma)
    S = T = ONE
    for _ in range(3000):
        S, T = udp_step(S, T, a * ONE, ONE, ZERO, ZERO, gamma, nu)
        S, T, growth = S / S[0, 0], T / S[0, 0], S[0, 0]
    assert growth == pytest.approx(1.0, abs=1e-9)


def test_nothing_lost_is_the_classical_problem() -> None:
    rng = np.random.default_rng(3)
    A, B, C = rng.normal(size=(4, 4)), rng.normal(size=(4, 2)), rng.normal(size=(2, 4))
    Q, R, W, U = np.eye(4), 0.3 * np.eye(2), np.diag([1.0, 2.0, 0.5, 1.0]), np.diag([0.1, 0.2])
    P, S = solve_discrete_are(A.T, C.T, Q, R), solve_discrete_are(A, B, W, U)
    np.testing.assert_allclose(steady_modified_riccati(A, C, Q, R, 1.0), P, rtol=1e-8)
    np.testing.assert_allclose(steady_modified_riccati(A.T, B.T, W, U, 1.0), S, rtol=1e-8)
    # LQG with u a function of the measurements up to now: J = tr(S Q) + tr((A'SA + W - S) P_{k|k}).
    filtered = np.linalg.inv(np.linalg.inv(P) + C.T @ np.linalg.inv(R) @ C)
    expected = np.trace(S @ Q) + np.trace((A.T @ S @ A + W - S) @ filtered)
    np.testing.assert_allclose(tcp_cost(A, B, C, Q, R, W, U, 1.0, 1.0)[1], expected, rtol=1e-8)
    solution = udp_solution(A, B, Q, W, U, 1.0, 1.0)
    np.testing.assert_allclose(solution.S, S, rtol=1e-8)
    np.testing.assert_allclose(solution.L, np.linalg.solve(B.T @ S @ B + U, B.T @ S @ A), rtol=1e-8)
    np.testing.assert_allclose(solution.J, np.trace(S @ Q), rtol=1e-8)


def test_the_mare_of_the_literature() -> None:
    # Sinopoli and others (2004), a = -1.25, c = 1, q = 1, r = 2.5: critical rate 1 - 1 / a^2 = 0.36.
    A, R = -1.25 * ONE, 2.5 * ONE
    assert steady_modified_riccati(A, ONE, ONE, R, 0.35) is None
    P = steady_modified_riccati(A, ONE, ONE, R, 0.37)
    np.testing.assert_allclose(modified_riccati(P, A, ONE, ONE, R, 0.37), P, rtol=1e-10)
    # At 0.7 the fixed point solves the quadratic p = a^2 p + 1 - 0.7 a^2 p^2 / (p + 2.5).
    roots = np.roots([1.25**2 * 0.3 - 1, 2.5 * 1.25**2 + 1 - 2.5, 2.5])
    np.testing.assert_allclose(steady_modified_riccati(A, ONE, ONE, R, 0.7)[0, 0], roots.max(), rtol=1e-10)
    assert roots.max() == pytest.approx(5.4008, abs=5e-5)


def simulated_cost(
    a: float, gamma: float, nu: float, gain: float, U: float, r: float, acknowledged: bool
) -> np.ndarray:
    """Mean cost of each of many runs of the scalar loop, b = c = q = W = 1, with the optimal estimator of its case."""
    rng = np.random.default_rng(11)
    runs, ticks, warm_up = 2000, 600, 100
    x, xhat, P, cost = np.zeros(runs), np.zeros(runs), np.ones(runs), np.zeros(runs)
    for k in range(ticks):
        there = rng.random(runs) < gamma
        K = np.where(there, P / (P + r), 0.0)
        xhat = xhat + K * (x + np.sqrt(r) * rng.normal(size=runs) - xhat)
        P = (1 - K) * P
        u, arrived = -gain * xhat, rng.random(runs) < nu
        if k >= warm_up:
            cost += x**2 + U * arrived * u**2
        x = a * x + arrived * u + rng.normal(size=runs)
        xhat = a * xhat + (arrived if acknowledged else nu) * u
        P = a**2 * P + 1.0 if acknowledged else P + 1.0  # with r = 0 its value does not matter
    return cost / (ticks - warm_up)


def test_the_udp_cost_is_the_simulated_one_and_its_gain_the_best() -> None:
    a, gamma, nu = 1.2, 0.8, 0.85
    solution = udp_solution(a * ONE, ONE, ONE, ONE, 0.5 * ONE, gamma, nu)
    cost = simulated_cost(a, gamma, nu, solution.L[0, 0], 0.5, 0.0, acknowledged=False)
    assert abs(cost.mean() - solution.J) < 4 * cost.std() / np.sqrt(len(cost))
    for other in (0.85, 1.15):
        worse = simulated_cost(a, gamma, nu, other * solution.L[0, 0], 0.5, 0.0, acknowledged=False)
        assert (worse - cost).mean() > 4 * (worse - cost).std() / np.sqrt(len(cost))


@pytest.mark.parametrize("r", [0.0, 2.0])
def test_the_tcp_cost_is_the_simulated_one_or_bounds_it(r: float) -> None:
    a, gamma, nu = 1.2, 0.7, 0.8
    low, high = tcp_cost(a * ONE, ONE, ONE, ONE, r * ONE, ONE, 0.5 * ONE, gamma, nu)
    S = steady_modified_riccati(a * ONE, ONE, ONE, 0.5 * ONE, nu)[0, 0]  # scalar, so its own dual
    cost = simulated_cost(a, gamma, nu, S * a / (S + 0.5), 0.5, r, acknowledged=True)
    sd = cost.std() / np.sqrt(len(cost))
    if r == 0.0:
        assert low == pytest.approx(high, rel=1e-9)
        assert abs(cost.mean() - low) < 4 * sd
    else:
        assert low < high
        assert low - 4 * sd < cost.mean() < high + 4 * sd


def test_unstable_rates_have_no_cost() -> None:
    assert tcp_cost(2 * ONE, ONE, ONE, ONE, ONE, ONE, ONE, 0.7, 0.9) is None
    assert tcp_cost(2 * ONE, ONE, ONE, ONE, ONE, ONE, ONE, 0.9, 0.7) is None
    assert udp_solution(2 * ONE, ONE, ONE, ONE, ZERO, 0.8, 0.8) is None


@pytest.mark.parametrize("rate", [-0.1, 1.1, float("nan")])
def test_rates_outside_0_1_are_refused(rate: float) -> None:
    with pytest.raises(InputError, match=r"gamma.*in \[0, 1\]"):
        tcp_cost(ONE, ONE, ONE, ONE, ONE, ONE, ONE, rate, 0.5)
    with pytest.raises(InputError, match=r"nu.*in \[0, 1\]"):
        udp_solution(ONE, ONE, ONE, ONE, ONE, 0.5, rate)
    with pytest.raises(InputError, match=r"arrival rate.*in \[0, 1\]"):
        steady_modified_riccati(ONE, ONE, ONE, ONE, rate)
