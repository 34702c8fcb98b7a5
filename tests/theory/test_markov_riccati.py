"""Arrivals in bursts: the coupled equations against the independent case, closed forms and Monte Carlo."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario.link import BernoulliLoss, GilbertElliottLoss, Link, NoLoss
from ortilo_drake.scenario.loss_chain import loss_of
from ortilo_drake.studies.arrivals.arrival_map import link_chain
from ortilo_drake.theory.arrivals.arrival_simulation import draw_markov, simulate
from ortilo_drake.theory.arrivals.arrivals import Model, check_model, pattern_probabilities
from ortilo_drake.theory.arrivals.expected_riccati import (
    TRANSLATION,
    ArrivalChain,
    arrival_chain,
    average_over_modes,
    markov_translation_lower_bound,
    solve_coupled,
    upper_bound,
    vehicle_model,
)
from ortilo_drake.theory.arrivals.expected_riccati_kernel import coupled_fixed_point
from ortilo_drake.world.radio.link import chain_after, delay_of_message, radio_of

H = 1.0 / 30.0
MODEL = vehicle_model(1e-4 * np.eye(12), np.diag(np.repeat([0.05, 0.08, 0.01], 3)), H)
ALL_OR_NOTHING = np.array([[False], [True]])
LOSES_ALL_WHILE_BAD = np.array([[0.0, 1.0], [1.0, 0.0]])


def markov_upper_bound(model: Model, chain: ArrivalChain) -> np.ndarray:
    return solve_coupled(model, chain.probabilities, chain.backward, None, "coupled Riccati equations")


def scalar(a: float) -> Model:
    return check_model(Model(np.array([[a]]), np.eye(1), np.eye(1), np.eye(1), ALL_OR_NOTHING))


def bursts(g: float, b: float, loss_good: float = 0.0, loss_bad: float = 1.0) -> Link:
    loss = GilbertElliottLoss(
        kind="gilbert_elliott", good_to_bad=g, bad_to_good=b, loss_good=loss_good, loss_bad=loss_bad
    )
    return Link(loss=loss)


@settings(max_examples=20)
@given(uwb=st.floats(0.05, 1.0), camera=st.floats(0.0, 1.0), b=st.floats(0.05, 0.9))
def test_independent_arrivals_are_a_special_case(uwb: float, camera: float, b: float) -> None:
    """Two modes that lose alike, and a chain whose next mode does not depend on the last, are both independent."""
    X = upper_bound(MODEL, pattern_probabilities(uwb, camera))
    alike = link_chain(bursts(0.3, b, 1.0 - uwb, 1.0 - uwb), bursts(b, 0.2, 1.0 - camera, 1.0 - camera), H)
    forgetful = link_chain(
        bursts(1.0 - uwb, uwb), Link(loss=BernoulliLoss(kind="bernoulli", probability=1.0 - camera)), H
    )
    scale = np.sqrt(np.outer(np.diag(X), np.diag(X)))
    for chain in (alike, forgetful):
        for X_mode in markov_upper_bound(MODEL, chain):
            assert np.max(np.abs(X_mode - X) / scale) < 1e-8


@pytest.mark.parametrize("a", [1.1, 1.25, 2.0])
def test_critical_recovery_of_a_scalar(a: float) -> None:
    """Huang and Dey (2007): bounded exactly where a^2 (1 - q) < 1, q the probability that a burst ends."""
    critical = 1.0 - 1.0 / a**2
    for g in (0.01, 0.3):
        for factor, is_bounded in ((0.97, False), (1.03, True)):
            q = factor * critical
            chain = arrival_chain(np.array([[1 - g, g], [q, 1 - q]]), LOSES_ALL_WHILE_BAD)
            if is_bounded:
                X = markov_upper_bound(scalar(a), chain)
                assert np.all(np.isfinite(X))
            else:
                with pytest.raises(InputError, match=rf"eigenvalue {a:g} in state 1 is seen too seldom"):
                    markov_upper_bound(scalar(a), chain)


def test_scalar_bursts_by_the_two_equations() -> None:
    """With everything lost while bad, the two means are X_b = mix of a^2 X_b + q and the good mode's equation."""
    a, g, b = 1.25, 0.1, 0.6
    chain = arrival_chain(np.array([[1 - g, g], [b, 1 - b]]), LOSES_ALL_WHILE_BAD)
    np.testing.assert_allclose(chain.stationary, [b / (g + b), g / (g + b)], rtol=1e-12)
    good, bad = markov_upper_bound(scalar(a), chain)[:, 0, 0]
    # Balance of E[P 1{mode}]: pi_j X_j = sum_i pi_i T_ij g_i(X_i)
    pi_g, pi_b = chain.stationary
    after_good, after_bad = a**2 * good / (good + 1.0) + 1.0, a**2 * bad + 1.0
    assert pi_g * good == pytest.approx(pi_g * (1 - g) * after_good + pi_b * b * after_bad, rel=1e-8)
    assert pi_b * bad == pytest.approx(pi_g * g * after_good + pi_b * (1 - b) * after_bad, rel=1e-8)


@pytest.mark.long
@pytest.mark.parametrize(
    ("uwb", "camera", "runs"),
    [
        (bursts(0.03, 0.1), None, 5_000),
        (bursts(0.05, 0.2, 0.1, 0.9), Link(rate=10.0), 6_000),
    ],
)
def test_monte_carlo_lies_between_the_bounds(uwb: Link, camera: Link | None, runs: int) -> None:
    chain = link_chain(uwb, camera, H)
    start = upper_bound(MODEL, pattern_probabilities(1.0, float(camera is not None)))
    initial = chain.stationary
    ticks = 90
    patterns = draw_markov(chain.T, chain.probabilities, initial, runs, ticks, seed=4)
    mean, error = simulate(MODEL, start, patterns)
    upper = np.diag(average_over_modes(chain, markov_upper_bound(MODEL, chain)))
    lower = np.diag(average_over_modes(chain, markov_translation_lower_bound(MODEL, chain)))
    seldom = [0, 1, 2, 3, 4, 6, 7, 8, 9, 10]
    assert np.all((np.diag(mean) + 3 * error)[seldom] < upper[seldom])
    assert np.all(lower < (np.diag(mean) - 3 * error)[TRANSLATION])


def test_the_exact_mean_of_each_mode_lies_below_the_recursion() -> None:
    """E[P_12 | mode] by all 2^13 paths of the chain, a scalar plant, from P_0 = 1 and the stationary chain."""
    a, steps = 1.25, 12
    model = scalar(a)
    for g, b in ((0.1, 0.5), (0.3, 0.3), (0.8, 0.9)):
        T = np.array([[1 - g, g], [b, 1 - b]])
        chain = arrival_chain(T, LOSES_ALL_WHILE_BAD)
        P, weight, mode = np.ones(2), chain.stationary, np.array([0, 1])
        for _ in range(steps):
            P = np.tile(np.where(mode == 0, a**2 * P / (P + 1.0), a**2 * P) + 1.0, 2)
            following = np.repeat([0, 1], len(mode))
            weight = np.tile(weight, 2) * T[np.tile(mode, 2), following]
            mode = following
        X = coupled_fixed_point(np.ones((2, 1, 1)), *model, chain.probabilities, chain.backward, 0.0, steps)[0]
        for j in (0, 1):
            assert weight[mode == j].sum() == pytest.approx(chain.stationary[j])
            exact = np.average(P[mode == j], weights=weight[mode == j])
            assert 1.0 < exact < X[j, 0, 0] - 1e-3


@pytest.mark.parametrize("link", [bursts(0.05, 0.2, 0.1, 0.9), bursts(0.2, 0.3).model_copy(update={"rate": 10.0})])
def test_the_chain_is_that_of_the_link_that_flies(link: Link) -> None:
    """Shares of arrivals, and of pairs of them a period apart, in 60,000 ticks of the world's link."""
    radio, nowhere = radio_of("uwb", link, link.every(H), H), np.zeros(3)
    bad, arrived = False, []
    for k in range(60_000):
        arrived.append(delay_of_message(radio, k, nowhere, bad, 5) == 0)
        bad = chain_after(k, bad, radio.loss, 5, radio.stream)
    seen = np.array(arrived[:: link.every(H)], dtype=float)
    chain = link_chain(link, None, H)
    arrives = chain.probabilities[:, 1]
    again = np.linalg.matrix_power(chain.T, link.every(H)) @ arrives
    share = link.every(H) * chain.stationary @ arrives
    pairs = link.every(H) * chain.stationary @ (arrives * again)
    for drawn, predicted in ((seen, share), (seen[1:] * seen[:-1], pairs)):
        error = np.std(drawn.reshape(-1)[: len(drawn) // 100 * 100].reshape(100, -1).mean(axis=1)) / 10.0  # 100 blocks
        assert np.mean(drawn) == pytest.approx(predicted, abs=4 * error)
        assert error < 0.01


def test_longer_bursts_at_the_same_rate_are_worse() -> None:
    variances = []
    for burst in (1.0, 3.0, 10.0, 30.0, 90.0):
        chain = link_chain(Link(loss=loss_of(0.4, burst)), None, H)
        assert chain.stationary[0] == pytest.approx(0.6, rel=1e-12)
        variances.append(average_over_modes(chain, markov_upper_bound(MODEL, chain))[0, 0])
    assert np.all(np.diff(variances) > 0.0)


def test_a_sensor_on_every_third_tick_is_the_periodic_riccati_equation() -> None:
    """Without chance: the limit cycle of the filter's own recursion, tick by tick."""
    chain = link_chain(Link(rate=10.0), None, H)
    X = markov_upper_bound(MODEL, chain)
    P = MODEL.W
    A, C, W, V, _ = MODEL
    for k in range(3_000):
        rows = [0, 1, 2, 6, 7, 8] if k % 3 == 0 else [6, 7, 8]
        C_k, V_k = C[rows], V[np.ix_(rows, rows)]
        K = A @ P @ C_k.T @ np.linalg.inv(C_k @ P @ C_k.T + V_k)
        P = (A - K @ C_k) @ P @ (A - K @ C_k).T + W + K @ V_k @ K.T
        if k >= 2_997:
            np.testing.assert_allclose(np.diag(X[(k + 1) % 3]), np.diag(P), rtol=1e-8)


def test_modes_that_do_not_recur_are_left_out() -> None:
    assert len(link_chain(bursts(0.0, 0.5), None, H).T) == 1
    stuck = link_chain(bursts(0.5, 0.0), None, H)
    np.testing.assert_allclose(stuck.probabilities, [[1.0, 0.0, 0.0, 0.0]])
    with pytest.raises(InputError, match="x, y, z, x_dot, y_dot, z_dot"):
        markov_upper_bound(MODEL, stuck)
    # Both sensors are good and bad on the same ticks: two of four modes, although the chain never forgets.
    locked = link_chain(bursts(1.0, 1.0), bursts(1.0, 1.0), H)
    np.testing.assert_allclose(locked.stationary, [0.5, 0.5])
    assert len(link_chain(Link(loss=NoLoss(), rate=15.0), Link(rate=10.0), H).T) == 6


@given(rate=st.floats(0.05, 1.0), burst=st.floats(20.0, 1000.0))
def test_bursts_have_the_rate_and_length_asked_for(rate: float, burst: float) -> None:
    loss = loss_of(1.0 - rate, burst)
    g, b = loss.good_to_bad, loss.bad_to_good
    assert b / (g + b) == pytest.approx(rate, rel=1e-9)
    assert 1.0 / b == pytest.approx(burst)


@pytest.mark.parametrize(("rate", "burst"), [(0.0, 5.0), (1.5, 5.0), (0.5, 0.5), (0.5, np.inf), (0.1, 2.0)])
def test_bursts_that_cannot_be_are_refused(rate: float, burst: float) -> None:
    with pytest.raises(InputError, match="must"):
        loss_of(1.0 - rate, burst)


def test_a_matrix_that_is_no_chain_is_refused() -> None:
    with pytest.raises(InputError, match="rows of T"):
        arrival_chain(np.array([[0.5, 0.6], [0.5, 0.5]]), LOSES_ALL_WHILE_BAD)
