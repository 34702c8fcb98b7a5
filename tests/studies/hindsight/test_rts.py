"""The smoother of the linear filters: against dense least squares, RTS as printed, and the filter that flew."""

import numpy as np
import pytest

from ortilo_drake.model.measurement import Measurement, Row
from ortilo_drake.onboard.estimator.intermittent_filter import FilterModel
from ortilo_drake.scenario import load_scenario
from ortilo_drake.studies.hindsight.recorded_flight import RecordedFlight, fly_recorded
from ortilo_drake.studies.hindsight.rts import (
    Forward,
    Tick,
    arrived,
    is_linear,
    linear_problem,
    run_forward,
    smooth,
    smoothed,
)

# Through the first blackout and out of it again.
SHORT = "planner={kind: waypoints, points: [[0, 0, 1.5], [4, 1.5, 1.5], [7, 1.5, 1.5]]}"


def made_up(n: int = 12, N: int = 4) -> tuple[FilterModel, Measurement, np.ndarray, np.ndarray, list[Tick]]:
    """Return a linear problem without structure: a sensor of its own in each tick, but for every third one."""
    rng = np.random.default_rng(5)
    Phi, Gamma = np.eye(N) + 0.2 * rng.normal(size=(N, N)), rng.normal(size=(N, 4))
    root, root_0 = 0.3 * rng.normal(size=(N, N)), rng.normal(size=(N, N))
    model = FilterModel.of(Phi, Gamma, root @ root.T, 0)
    x_0, P_0 = rng.normal(size=N), root_0 @ root_0.T
    H, states = rng.normal(size=(n, 2, N)), tuple("abcd"[:N])
    rows = tuple(
        (str(k), tuple(Row(f"{k}.{i}", tuple(zip(states, H[k, i].tolist(), strict=True))) for i in range(2)))
        for k in range(n)
    )
    x, ticks, arrives = x_0 + root_0 @ rng.normal(size=N), [], np.eye(n) * (np.arange(n) % 3 != 2)
    for k in range(n):
        root_V, u, y, V2 = (
            np.tril(rng.normal(size=(2, 2))) + np.eye(2),
            rng.normal(size=4),
            np.zeros((n, 2)),
            np.ones((n, 4)),
        )
        y[k], V2[k] = H[k] @ x + root_V @ rng.normal(size=2), (root_V @ root_V.T).ravel()
        ticks.append(Tick(y.ravel(), arrives[k], V2.ravel(), u))
        x = Phi @ x + Gamma @ u + root @ rng.normal(size=N)
    return model, Measurement(rows, states), x_0, P_0, ticks


def least_squares(
    model: FilterModel, measurement: Measurement, x_0: np.ndarray, P_0: np.ndarray, ticks: list[Tick]
) -> tuple[np.ndarray, np.ndarray]:
    """Return all states by weighted least squares over all ticks at once, and their joint covariance."""
    n, N = len(ticks), len(x_0)
    rows, values = [], []

    def add(weight: np.ndarray, blocks: dict[int, np.ndarray], value: np.ndarray) -> None:
        row = np.zeros((len(value), n * N))
        for k, block in blocks.items():
            row[:, k * N : (k + 1) * N] = block
        root = np.linalg.cholesky(np.linalg.inv(weight)).T
        rows.append(root @ row)
        values.append(root @ value)

    add(P_0, {0: np.eye(N)}, x_0)
    for k, tick in enumerate(ticks):
        y, H, V = arrived(measurement, tick)
        if len(y):
            add(V, {k: H}, y)
        if k + 1 < n:
            add(model.W, {k: -model.Phi, k + 1: np.eye(N)}, model.Gamma @ tick.u)
    A, b = np.vstack(rows), np.concatenate(values)
    return np.linalg.lstsq(A, b)[0].reshape(n, N), np.linalg.inv(A.T @ A)


def rts(
    model: FilterModel, measurement: Measurement, found: Forward, ticks: list[Tick]
) -> tuple[np.ndarray, np.ndarray]:
    """Return what Rauch, Tung and Striebel print, from the filter's priors."""
    (priors, P_priors), n = found.prior, len(ticks)
    x, P = np.empty_like(priors), np.empty_like(P_priors)
    for k in range(n - 1, -1, -1):
        y, H, V = arrived(measurement, ticks[k])
        K = P_priors[k] @ H.T @ np.linalg.inv(H @ P_priors[k] @ H.T + V)
        x[k], P[k] = priors[k] + K @ (y - H @ priors[k]), P_priors[k] - K @ H @ P_priors[k]
        if k + 1 < n:
            C = P[k] @ model.Phi.T @ np.linalg.inv(P_priors[k + 1])
            x[k] = x[k] + C @ (x[k + 1] - priors[k + 1])
            P[k] = P[k] + C @ (P[k + 1] - P_priors[k + 1]) @ C.T
    return x, P


def test_it_solves_the_least_squares_problem_of_all_ticks() -> None:
    problem = made_up()
    x, P = smooth(run_forward(*problem))
    expected, joint = least_squares(*problem)
    np.testing.assert_allclose(x, expected, rtol=0.0, atol=1e-9)
    N = x.shape[1]
    for k in range(len(x)):
        block = slice(k * N, (k + 1) * N)
        np.testing.assert_allclose(P[k], joint[block, block], rtol=0.0, atol=1e-9)


def test_it_is_what_rauch_tung_and_striebel_print() -> None:
    problem = made_up(n=40)
    found = run_forward(*problem)
    x, P = rts(*problem[:2], found, problem[4])
    np.testing.assert_allclose(smooth(found).x, x, rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(smooth(found).P, P, rtol=0.0, atol=1e-8)


def test_what_is_known_at_first_stays_known() -> None:
    """Where P_0 and W are singular there is no inverse of P; a constant of no variance stays as it is."""
    model, measurement, x_0, P_0, ticks = made_up()
    Phi, Gamma, W = model.Phi.copy(), model.Gamma.copy(), model.W.copy()
    Gamma[3], Phi[3], W[3], W[:, 3], P_0[3], P_0[:, 3] = 0.0, np.eye(4)[3], 0.0, 0.0, 0.0, 0.0
    x, P = smooth(run_forward(FilterModel.of(Phi, Gamma, W, 0), measurement, x_0, P_0, ticks))
    np.testing.assert_allclose(x[:, 3], x_0[3], rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(P[:, 3], 0.0, rtol=0.0, atol=1e-12)


@pytest.fixture(scope="module", params=["nominal_imu_uwb", "imu_uwb"])
def flights(request: pytest.FixtureRequest) -> list[RecordedFlight]:
    scenario = load_scenario(request.param, (SHORT, "multilateration.bias_bank=null"))
    return [fly_recorded(scenario, seed) for seed in range(3)]


@pytest.mark.long
def test_forward_is_the_filter_that_flew(flights: list[RecordedFlight]) -> None:
    for recorded in flights:
        assert is_linear(recorded.scenario)
        found = run_forward(*linear_problem(recorded))
        estimate, P = (recorded.flight[name].values for name in ("estimate", "covariance"))
        np.testing.assert_allclose(found.prior.x[:, :12], estimate[:, :12], rtol=0.0, atol=1e-8)
        np.testing.assert_allclose(found.prior.P[:, :12, :12], P[:, :12, :12], rtol=0.0, atol=1e-9)


@pytest.mark.family("nominal_imu_uwb")
def test_hindsight_errs_less(flights: list[RecordedFlight]) -> None:
    before = after = 0.0
    for recorded in flights:
        truth, estimate = (recorded.flight[name].values for name in ("truth", "estimate"))
        x, P = smoothed(recorded)
        before += np.mean((estimate[:, :3] - truth[:, :3]) ** 2)
        after += np.mean((x[:, :3] - truth[:, :3]) ** 2)
        prior = recorded.flight["covariance"].values[:, :12, :12]
        assert np.linalg.eigvalsh(prior - P[:, :12, :12]).min() > -1e-9
    assert after < before


def test_a_filter_that_is_not_linear_or_runs_again_is_not_smoothed_here() -> None:
    assert not is_linear(load_scenario("tight_imu_uwb"))
    assert not is_linear(load_scenario("imu_uwb"))  # learns its anchors' survey
    assert not is_linear(load_scenario("imu_uwb", ("estimator.delay=replay",)))
