"""The filter against the printed formula at full size, Drake's steady-state filter, and its known structure."""

from functools import lru_cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.systems.controllers import DiscreteTimeLinearQuadraticRegulator
from pydrake.systems.estimators import DiscreteTimeSteadyStateKalmanFilter
from scipy.linalg import block_diag

from ortilo_drake.model.hover import discretize, disturbance_W, hover_A, hover_B, output_C
from ortilo_drake.model.measurement import PAPER, make_measurement, row
from ortilo_drake.model.vehicle import M100
from ortilo_drake.onboard.estimator.intermittent_filter import (
    INTEGRATOR_ESTIMATE,
    INTEGRATOR_HOLD,
    INTEGRATOR_LITERAL,
    INTEGRATORS,
    FilterModel,
    filter_gain,
    filter_step,
    intermittent_step,
)

H = 1.0 / 30.0
PHI, GAMMA = discretize(hover_A(), hover_B(M100), H)
C = output_C()
W = disturbance_W(M100, H, 0.27, 0.005)
P_0 = np.diag([*np.repeat(np.square([0.05, 0.02, 0.05, 0.05]), 3), 0.0, 0.0, 0.0])
CBAR = np.hstack([C, np.zeros((9, 3))])
GAMMABAR = np.vstack([GAMMA, np.zeros((3, 4))])
IBAR = np.vstack([np.zeros((12, 3)), np.eye(3)])
EVERYTHING = np.ones(3)
LAYOUT = make_measurement().layout


def spd_blocks(rng: np.random.Generator) -> np.ndarray:
    """Random covariances of the three sensors (3, 3, 3), position sd about 0.1 m, angle sd about 0.01 rad."""
    blocks = []
    for sd in (0.1, 0.15, 0.01):
        Q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        blocks.append(sd**2 * Q @ np.diag(rng.uniform(0.3, 3.0, 3)) @ Q.T)
    return np.array([(V + V.T) / 2 for V in blocks])


Measured = tuple[np.ndarray, np.ndarray, np.ndarray]


def message(y: np.ndarray, delta: np.ndarray, V2: np.ndarray) -> Measured:
    return y, delta, V2.ravel()


def step(
    xhat: np.ndarray, P_flat: np.ndarray, m: Measured, u: np.ndarray, r: np.ndarray, noise: np.ndarray, code: int
) -> np.ndarray:
    """[xhat, P row by row] of the next tick."""
    return filter_step(np.concatenate([xhat, P_flat]), *m, u, r, FilterModel.of(PHI, GAMMA, noise, code), LAYOUT)


def selection(delta: np.ndarray) -> np.ndarray:
    """E_k = [Delta_1, not Delta_1 and Delta_2, 0] as printed."""
    uwb, camera = bool(delta[0]), bool(delta[1])
    return np.hstack([np.eye(3) * uwb, np.eye(3) * (not uwb and camera), np.zeros((3, 3))])


def predictor(
    P: np.ndarray, F: np.ndarray, H: np.ndarray, V1: np.ndarray, V12: np.ndarray, V2: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The one-step predictor's gain and next covariance, dense, for x+ = F x + w, y = H x + v, E[w v^T] = V12."""
    HPF_V12 = H @ P @ F.T + V12.T
    K = np.linalg.solve(H @ P @ H.T + V2, HPF_V12).T
    P_next = F @ P @ F.T + V1 - K @ HPF_V12
    return K, (P_next + P_next.T) / 2  # without this the printed recursion diverges


@lru_cache
def printed_matrices(uwb: float, camera: float, imu: float) -> tuple[np.ndarray, ...]:
    """Delta_k, E_k, Phibar and Ebar of the paper, at full size."""
    delta = np.array([uwb, camera, imu])
    E = selection(delta)
    Phibar = np.block([[PHI, np.zeros((12, 3))], [-E @ C, np.eye(3)]])
    return np.diag(np.repeat(delta, 3)), E, Phibar, block_diag(np.eye(12), -E)


def printed_step(
    xbar: np.ndarray, P: np.ndarray, y: np.ndarray, delta: np.ndarray, V2: np.ndarray,
    u: np.ndarray, r: np.ndarray, integrator: str,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """The paper's filter at full size: masked by Delta, no row deleted; slips mended as THEORY says."""
    Delta, E, Phibar, Ebar = printed_matrices(*delta)
    if integrator == "estimate":
        K, P_next = predictor(P[:12, :12], PHI, Delta @ C, W, np.zeros((12, 9)), V2)
        x = PHI @ xbar[:12] + GAMMA @ u + K @ (Delta @ y - Delta @ C @ xbar[:12])
        return np.concatenate([x, xbar[12:] + r - xbar[:3]]), np.pad(P_next, (0, 3))
    Hk, V12 = Delta @ CBAR, np.vstack([np.zeros((12, 9)), V2])
    V1 = np.zeros((21, 21))
    V1[:12, :12], V1[12:, 12:] = W, V2
    integrated = r if integrator == "literal" or np.any(E) else np.zeros(3)
    K, P_next = predictor(P, Phibar, Hk, Ebar @ V1 @ Ebar.T, Ebar @ V12, V2)
    xbar_next = Phibar @ xbar + GAMMABAR @ u + IBAR @ integrated + K @ (Delta @ y - Hk @ xbar)
    return xbar_next, P_next


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("steps", [50, pytest.param(20_000, marks=pytest.mark.long)])
def test_the_printed_formula_over_thousands_of_random_arrivals(steps: int, integrator: str) -> None:
    # Absolute tolerances on xhat (of order 1, the integral of order 100) and relative ones on P's largest entry.
    # Each runs on its own values from first to last: the comparison never re-synchronises them.
    rng = np.random.default_rng(11)
    blocks = [spd_blocks(rng) for _ in range(7)]
    dense = [block_diag(*V2) for V2 in blocks]
    xhat, P_flat = 0.1 * rng.normal(size=15), P_0.ravel()
    xbar, P = xhat, P_0
    for k in range(steps):
        delta = (rng.random(3) < (0.3, 0.3, 0.8)).astype(float)
        V2 = blocks[k % 7]
        y = rng.normal(size=9) * np.repeat([0.1, 0.15, 0.01], 3)
        u, r = rng.normal(size=4) * [1.0, 0.01, 0.01, 0.01], 0.1 * rng.normal(size=3)
        out = step(xhat, P_flat, message(y, delta, V2), u, r, W, INTEGRATORS[integrator])
        xbar, P = printed_step(xbar, P, y, delta, dense[k % 7], u, r, integrator)
        xhat, P_flat = out[:15], out[15:]
        P_mine = P_flat.reshape(15, 15)
        assert np.max(np.abs(xhat - xbar)) < 1e-9 * max(1.0, np.max(np.abs(xbar))), k
        assert np.max(np.abs(P_mine - P)) < 1e-9 * np.max(np.abs(P)), k
        assert np.max(np.abs(P_mine[12:])) < 1e-20, k
        if k % 50 == 0:
            assert np.array_equal(P_mine, P_mine.T)
            assert np.linalg.eigvalsh(P_mine)[0] > -1e-15 * np.max(P_mine), k


@pytest.mark.family
@pytest.mark.parametrize("integrator", ["literal", "hold"])
@pytest.mark.parametrize("seed", range(4))
def test_one_step_from_an_integral_that_is_not_known_is_the_printed_formula_too(seed: int, integrator: str) -> None:
    """In flight the integral is known, its rows of P are 0, and the loops rely on it; the equations hold for any P."""
    rng = np.random.default_rng(seed)
    root, V2, delta = 0.1 * rng.normal(size=(15, 15)), spd_blocks(rng), np.array([[1, 1, 1], [0, 1, 0], [1, 0, 1]])
    for there in delta.astype(float):
        xhat, y, u, r = rng.normal(size=15), rng.normal(size=9), rng.normal(size=4), rng.normal(size=3)
        P, code = root @ root.T, INTEGRATORS[integrator]
        model = FilterModel.of(PHI, GAMMA, W, code)
        x, P_lines, _ = intermittent_step(xhat, P, y, there, V2.ravel(), u, r, model, LAYOUT)
        xbar, P_next = printed_step(xhat, P, y, there, block_diag(*V2), u, r, integrator)
        np.testing.assert_allclose(x, xbar, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(P_lines, P_next, rtol=1e-9, atol=1e-9 * np.abs(P_next).max())


@pytest.mark.long
def test_missing_rows_carry_nothing_into_the_filter() -> None:
    rng = np.random.default_rng(12)
    for delta in np.array(np.meshgrid(*[[0.0, 1.0]] * 3)).reshape(3, -1).T:
        y, V2 = rng.normal(size=9), spd_blocks(rng)
        other_y, other_V2 = y.copy(), V2.copy()
        for s in np.flatnonzero(delta == 0.0):
            other_y[3 * s : 3 * s + 3] = np.nan
            other_V2[s] = np.nan
        xhat, u, r = rng.normal(size=15), rng.normal(size=4), rng.normal(size=3)
        steps = [
            step(xhat, P_0.ravel(), message(*m), u, r, W, INTEGRATOR_LITERAL)
            for m in ((y, delta, V2), (other_y, delta, other_V2))
        ]
        np.testing.assert_array_equal(*steps)


@pytest.mark.long
@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1))
def test_the_integrator_is_known_so_its_gain_is_minus_E(seed: int) -> None:
    rng = np.random.default_rng(seed)
    V2 = spd_blocks(rng)
    P = P_0
    for _ in range(40):
        delta = (rng.random(3) < rng.random(3)).astype(float)
        K = filter_gain(P, delta, V2.ravel(), PHI, INTEGRATOR_LITERAL, LAYOUT)
        assert np.max(np.abs(K[12:] + selection(delta))) < 1e-9
        assert not np.any(K[:, np.repeat(delta, 3) == 0.0])
        m = message(np.zeros(9), delta, V2)
        after = step(np.zeros(15), P.ravel(), m, np.zeros(4), np.zeros(3), W, INTEGRATOR_LITERAL)
        P = after[15:].reshape(15, 15)


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_with_all_sensors_the_gain_settles_at_drakes_steady_state_predictor(integrator: str) -> None:
    V2 = spd_blocks(np.random.default_rng(13))
    V = block_diag(*V2)
    W_full = W + 1e-10 * np.eye(12)  # W alone has rank 6, which Drake's definiteness check takes for indefinite
    code = INTEGRATORS[integrator]
    P_flat = P_0.ravel()
    m = message(np.zeros(9), EVERYTHING, V2)
    for _ in range(6000):
        P_flat = step(np.zeros(15), P_flat, m, np.zeros(4), np.zeros(3), W_full, code)[15:]
    K = filter_gain(P_flat.reshape(15, 15), EVERYTHING, V2.ravel(), PHI, code, LAYOUT)
    steady = DiscreteTimeSteadyStateKalmanFilter(PHI, C, W_full, V)
    np.testing.assert_allclose(K[:12], steady, rtol=1e-8, atol=1e-8 * np.max(np.abs(steady)))
    # A predictor gain Phi P C^T (C P C^T + V)^-1, not the filter gain P C^T (C P C^T + V)^-1.
    assert np.max(np.abs(K[:12] - np.linalg.solve(PHI, K[:12]))) > 1e-3 * np.max(np.abs(K))


def test_the_dense_predictor_with_cross_covariance_is_dual_to_drakes_regulator() -> None:
    rng = np.random.default_rng(14)
    V = block_diag(*spd_blocks(rng))
    L = np.linalg.cholesky(W + 1e-12 * np.eye(12))
    G = rng.normal(size=(12, 9))
    # N = L G (half) R^T with |G| < 1, so that [W N; N^T V] > 0.
    N = 0.5 * L @ (G / np.linalg.norm(G, 2)) @ np.linalg.cholesky(V).T
    noise = L @ L.T
    assert np.linalg.eigvalsh(np.block([[noise, N], [N.T, V]]))[0] > 0.0
    P = P_0[:12, :12]
    for _ in range(20_000):
        K, P_next = predictor(P, PHI, C, noise, N, V)
        done, P = np.max(np.abs(P_next - P)) < 1e-15 * np.max(P_next), P_next
        if done:
            break
    dual, _ = DiscreteTimeLinearQuadraticRegulator(PHI.T, C.T, noise, V, N)
    np.testing.assert_allclose(K, dual.T, rtol=1e-8, atol=1e-8 * np.max(np.abs(dual)))
    # Ebar V12 is such an N: without it the gain is another.
    plain, _ = DiscreteTimeLinearQuadraticRegulator(PHI.T, C.T, noise, V)
    assert np.max(np.abs(dual - plain)) > 1e-3 * np.max(np.abs(plain))


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_what_each_integrator_sums(integrator: str) -> None:
    rng = np.random.default_rng(15)
    V2 = spd_blocks(rng)
    xhat, P_flat = 0.1 * rng.normal(size=15), P_0.ravel()
    i = xhat[12:].copy()
    for _ in range(200):
        delta = (rng.random(3) < 0.5).astype(float)
        y, r = rng.normal(size=9), rng.normal(size=3)
        measured = y[0:3] if delta[0] else y[3:6]
        if integrator == "estimate":
            i += r - xhat[:3]
        elif delta[0] or delta[1]:
            i += r - measured
        elif integrator == "literal":
            i += r
        code = INTEGRATORS[integrator]
        out = step(xhat, P_flat, message(y, delta, V2), np.zeros(4), r, W, code)
        xhat, P_flat = out[:15], out[15:]
        np.testing.assert_allclose(xhat[12:], i, atol=1e-11)


def test_the_integrators_share_one_estimate_of_the_vehicle() -> None:
    rng = np.random.default_rng(16)
    V2 = spd_blocks(rng)
    codes = (INTEGRATOR_ESTIMATE, INTEGRATOR_LITERAL, INTEGRATOR_HOLD)
    runs = {code: (np.zeros(15), P_0.ravel()) for code in codes}
    for _ in range(500):
        delta = (rng.random(3) < 0.5).astype(float)
        y, u, r = 0.1 * rng.normal(size=9), rng.normal(size=4) * 0.01, rng.normal(size=3)
        for code, (xhat, P_flat) in runs.items():
            out = step(xhat, P_flat, message(y, delta, V2), u, r, W, code)
            runs[code] = out[:15], out[15:]
    for code in codes[1:]:
        np.testing.assert_allclose(runs[code][0][:12], runs[codes[0]][0][:12], atol=1e-12)
        P, P_estimate = (runs[c][1].reshape(15, 15)[:12, :12] for c in (code, codes[0]))
        np.testing.assert_allclose(P, P_estimate, atol=1e-12 * np.max(P_estimate))


OWN = (
    ("altimeter", (row("z_alt", z=1.0),)),
    ("flow", (row("x_dot_flow", x_dot=1.0), row("y_dot_flow", y_dot=1.0))),
    ("beacon", (row("along", x=0.6, y=0.8), row("lift", z=1.0, theta=-0.2), row("up", z=1.0))),
)


@pytest.mark.family
@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("rows", [PAPER, (*PAPER, *OWN), (PAPER[2], OWN[0]), OWN], ids=["paper", "all", "two", "own"])
def test_the_loops_are_the_equations_line_by_line_for_any_list_of_sensors(rows: tuple, integrator: str) -> None:
    rng, measurement = np.random.default_rng(18), make_measurement(rows)
    layout, model = measurement.layout, FilterModel.of(PHI, GAMMA, W, INTEGRATORS[integrator])
    xhat, P = 0.1 * rng.normal(size=15), P_0.copy()
    belief = np.concatenate([xhat, P.ravel()])
    sizes = np.diff(layout.first)
    for _ in range(300):
        roots = [0.1 * rng.normal(size=(m, m + 2)) for m in sizes]
        V2 = np.concatenate([(root @ root.T).ravel() for root in roots])
        delta = (rng.random(len(sizes)) < 0.5).astype(float)
        y, u, r = rng.normal(size=layout.first[-1]), rng.normal(size=4) * 0.01, rng.normal(size=3)
        belief = filter_step(belief, y, delta, V2, u, r, model, layout)
        xhat, P, _ = intermittent_step(xhat, P, y, delta, V2, u, r, model, layout)
        scale = max(1.0, np.abs(xhat).max())
        np.testing.assert_allclose(belief[:15], xhat, rtol=0.0, atol=1e-9 * scale)
        np.testing.assert_allclose(belief[15:].reshape(15, 15), P, rtol=0.0, atol=1e-9 * np.abs(P).max())
