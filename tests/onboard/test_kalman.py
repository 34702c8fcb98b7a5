"""The filter's kernel, the Cramer-Rao bounds and the periodic gains against the printed equations of kalman.py."""

import numpy as np
import pytest
from scipy.linalg import block_diag

from ortilo_drake.floor.information_filter import predicted_bound
from ortilo_drake.loop.plain import plain_source
from ortilo_drake.onboard.estimator.kalman import predicted_covariance, predictor_gain
from ortilo_drake.onboard.estimator.linear_filter import linear_filter_step, linear_model
from ortilo_drake.sensors.information_rows import AMPLITUDE, SLOW, VARIANCE, rows_of
from ortilo_drake.studies.command_link.command_loop import over_arrivals
from ortilo_drake.studies.room_design.path_bound import PathModel, position_variance

TICKS = 40
MODELS = [np.random.default_rng(seed) for seed in range(5)]


def random_model(rng: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return a stable Phi (n, n) with zeros, and W (n, n) of half rank."""
    Phi = rng.normal(size=(n, n)) * (rng.random((n, n)) < 0.4)
    B = rng.normal(size=(n, n // 2))
    return 0.9 * Phi / max(1.0, np.abs(np.linalg.eigvals(Phi)).max()), B @ B.T


def printed(Phi: np.ndarray, W: np.ndarray, P: np.ndarray, H: np.ndarray, V: np.ndarray) -> np.ndarray:
    return predicted_covariance(Phi, H, W, P, predictor_gain(Phi, H, V, P))


def assert_same(found: np.ndarray, expected: np.ndarray) -> None:
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("rng", MODELS)
def test_two_steps_of_the_kernel_are_the_printed_predictor(rng: np.random.Generator) -> None:
    n, sizes = 9, (3, 1, 4)
    Phi, W = random_model(rng, n)
    Cs = [rng.normal(size=(m, n)) * (rng.random((m, n)) < 0.5) for m in sizes]
    Vs = [np.cov(rng.normal(size=(m, 20))).reshape(m, m) for m in sizes]
    Gamma, x, P = rng.normal(size=(n, 2)), rng.normal(size=n), 3.0 * np.eye(n)
    model = linear_model(Phi, Gamma, W, zip(Cs, Vs, strict=True))
    belief, rows, S = np.concatenate((x, P.ravel())), np.empty((n, n + 1)), np.empty((sum(sizes),) * 2)
    for _ in range(TICKS):
        delta, u = rng.random(len(sizes)) < 0.6, rng.normal(size=2)
        ys = [rng.normal(size=m) for m in sizes]
        messages = np.concatenate([np.append(float(there), y) for there, y in zip(delta, ys, strict=True)])
        linear_filter_step(u, messages, belief, rows, S, model)
        H = np.vstack([np.empty((0, n)), *(C for C, there in zip(Cs, delta, strict=True) if there)])
        V = block_diag(*(V for V, there in zip(Vs, delta, strict=True) if there)).reshape(len(H), len(H))
        y = np.concatenate([np.empty(0), *(y for y, there in zip(ys, delta, strict=True) if there)])
        K = predictor_gain(Phi, H, V, P)
        x, P = Phi @ x + Gamma @ u + K @ (y - H @ x), predicted_covariance(Phi, H, W, P, K)
        assert_same(belief[:n], x)
        assert_same(belief[n:].reshape(n, n), P)


@pytest.mark.parametrize("rng", MODELS)
def test_noise_that_process_and_measurement_share_is_a_state_of_a_larger_model(rng: np.random.Generator) -> None:
    n, m = 6, 2
    Phi, W = random_model(rng, n)
    H, V, P = rng.normal(size=(m, n)), np.cov(rng.normal(size=(m, 20))), 2.0 * np.eye(n)
    G = rng.normal(size=(n, m))  # w = w' + G v
    K = predictor_gain(Phi, H, V, P, G @ V)
    found = predicted_covariance(Phi, H, W + G @ V @ G.T, P, K, G @ V)
    # The state [x; v], measured by [H I] without further noise.
    large = np.block([[Phi, G], [np.zeros((m, n + m))]])
    row, small = np.hstack([H, np.eye(m)]), np.zeros((m, m))
    K_large = predictor_gain(large, row, small, block_diag(P, V))
    expected = predicted_covariance(large, row, block_diag(W, V), block_diag(P, V), K_large)
    np.testing.assert_allclose(K, K_large[:n], rtol=0.0, atol=1e-12 * np.abs(K).max())
    assert_same(found, expected[:n, :n])


@pytest.mark.parametrize("rng", MODELS)
def test_the_cramer_rao_recursion_is_the_covariance_of_the_printed_predictor(rng: np.random.Generator) -> None:
    Phi, W = random_model(rng, 15)  # three unknown errors beside the vehicle's states
    g, r = rng.normal(size=(5 * TICKS, 15)) * (rng.random((5 * TICKS, 15)) < 0.5), rng.uniform(0.1, 2.0, 5 * TICKS)
    rows = rows_of(np.repeat(np.arange(TICKS), 5), g[:, :12], r)
    rows = np.hstack([rows, g[:, 12:]])
    found, P = predicted_bound(rows, TICKS, Phi, W, 2.0 * np.eye(15), 1), 2.0 * np.eye(15)
    assert rows[0, VARIANCE] == r[0]
    for k in range(TICKS):
        assert_same(found[k], P[:12, :12])
        P = printed(Phi, W, P, g[5 * k : 5 * k + 5], np.diag(r[5 * k : 5 * k + 5]))


def test_a_slow_error_that_was_dropped_is_read_no_more() -> None:
    """As plain Python, which refuses an index outside an array: one slow error in six, then rows without any."""
    rng = np.random.default_rng(9)
    Phi, W = random_model(rng, 12)
    rows = rows_of(np.arange(TICKS), rng.normal(size=(TICKS, 12)), np.ones(TICKS))
    rows[:6, SLOW], rows[:6, AMPLITUDE] = np.arange(6), 0.5
    given = rows, TICKS, Phi, W, np.eye(12), 5
    np.testing.assert_allclose(plain_source(predicted_bound)(*given), predicted_bound(*given), rtol=1e-9)


@pytest.mark.parametrize("rng", MODELS)
def test_the_bound_along_a_path_is_the_covariance_of_the_printed_predictor(rng: np.random.Generator) -> None:
    Phi, W = random_model(rng, 12)
    first = np.concatenate([[0], np.cumsum(rng.integers(0, 4, TICKS))])
    rows, ranges = rng.normal(size=(first[-1], 12)), rng.normal(size=(TICKS, 4, 3))
    heard = rng.integers(2, 5, TICKS)
    found = position_variance(PathModel(Phi, W, rows, first), ranges.transpose(0, 2, 1) @ ranges, heard, 3)
    P, expected = np.zeros((12, 12)), []
    for k in range(TICKS):
        expected.append(np.trace(P[:3, :3]))
        own = np.pad(ranges[k], ((0, 0), (0, 9))) if heard[k] >= 3 else np.empty((0, 12))
        H = np.vstack([rows[first[k] : first[k + 1]], own])
        P = printed(Phi, W, P, H, np.eye(len(H)))
    assert_same(found, np.array(expected))


def test_the_gains_over_arrivals_are_those_of_the_kernel() -> None:
    rng = np.random.default_rng(8)
    Phi, W = random_model(rng, 9)
    C, V = rng.normal(size=(4, 9)), np.diag(rng.uniform(0.1, 1.0, 4))
    there = rng.random((TICKS, 4)) < 0.5
    Ks, Ps, P = over_arrivals(Phi, C, W, V, there, np.eye(9))
    model = linear_model(Phi, np.zeros((9, 1)), W, [(C[i : i + 1], V[i : i + 1, i : i + 1]) for i in range(4)])
    belief, rows, S = np.concatenate((np.zeros(9), np.eye(9).ravel())), np.empty((9, 10)), np.empty((4, 4))
    for k in range(TICKS):
        assert_same(Ps[k], belief[9:].reshape(9, 9))
        assert not Ks[k][:, ~there[k]].any()
        y = rng.normal(size=4)
        x = belief[:9].copy()
        linear_filter_step(np.zeros(1), np.column_stack([there[k], y]).astype(float).ravel(), belief, rows, S, model)
        assert_same(belief[:9], Phi @ x + Ks[k] @ (y - C @ x))
    assert_same(P, belief[9:].reshape(9, 9))
