"""Gramians against closed-form sums, SciPy's Lyapunov solution and stacked outputs."""

import numpy as np
import pytest
from scipy.linalg import solve_discrete_lyapunov

from ortilo_drake.model.hover import discretize, hover_A, hover_B, output_C
from ortilo_drake.model.vehicle import M100
from ortilo_drake.scenario import InputError, Scenario
from ortilo_drake.studies.linearization.linearization_report import (
    CONTROL_UNITS,
    STATE_UNITS,
    controllability_gramian,
    gramian,
    observability_gramian,
)

H = 1.0 / 30.0
PHI, GAMMA = discretize(hover_A(), hover_B(M100), H)


def test_gramian_of_two_integrators_is_the_closed_form_sum() -> None:
    n = 50
    A, C = np.array([[1.0, 0.1], [0.0, 1.0]]), np.array([[1.0, 0.0]])
    first, second = 0.1 * n * (n - 1) / 2, 0.01 * (n - 1) * n * (2 * n - 1) / 6
    np.testing.assert_allclose(gramian(A, C, n), [[n, first], [first, second]], rtol=1e-13)


def test_gramian_of_a_stable_pair_is_the_lyapunov_solution_less_its_tail() -> None:
    rng = np.random.default_rng(8)
    A = rng.normal(size=(5, 5))
    A *= 0.9 / np.max(np.abs(np.linalg.eigvals(A)))
    C = rng.normal(size=(2, 5))
    X = solve_discrete_lyapunov(A.T, C.T @ C)
    power = np.linalg.matrix_power(A, 17)
    np.testing.assert_allclose(gramian(A, C, 17), X - power.T @ X @ power, rtol=1e-9, atol=1e-9)


def test_gramians_of_the_vehicle_in_their_units() -> None:
    scenario, ticks = Scenario(), 60
    sensors = ("uwb", "imu")
    seen = np.vstack([output_C()[r] for r in (0, 1, 2, 6, 7, 8)])
    stacked = np.vstack([seen @ np.linalg.matrix_power(PHI, k) for k in range(ticks)])
    weights = np.tile(np.repeat([1.0, 0.1], 3), ticks)  # m, 0.1 rad
    scaled = stacked * STATE_UNITS / weights[:, None]
    by_outputs = observability_gramian(scenario, sensors, 2.0)
    s = np.linalg.svd(scaled, compute_uv=False)
    np.testing.assert_allclose(by_outputs.singular_values, s**2, rtol=1e-9)
    assert by_outputs.condition == pytest.approx((s[0] / s[-1]) ** 2, rel=1e-9)
    reached = np.hstack([np.linalg.matrix_power(PHI, k) @ GAMMA * CONTROL_UNITS for k in range(ticks)])
    s = np.linalg.svd(reached / STATE_UNITS[:, None], compute_uv=False)
    by_control = controllability_gramian(scenario, 2.0)
    np.testing.assert_allclose(by_control.singular_values, s**2, rtol=1e-8)
    assert np.isinf(observability_gramian(scenario, ("imu",), 2.0).condition)


def test_gramians_grow_with_the_horizon_without_end() -> None:
    def largest(sensors: tuple[str, ...], horizon: float) -> float:
        return float(observability_gramian(Scenario(), sensors, horizon).singular_values[0])

    assert largest(("uwb",), 800.0) / largest(("uwb",), 400.0) == pytest.approx(2.0**7, rel=0.02)
    assert largest(("imu",), 800.0) / largest(("imu",), 400.0) == pytest.approx(2.0**3, rel=0.02)


def test_a_horizon_below_a_tick_is_refused() -> None:
    for horizon in (0.0, -1.0, 0.01, np.nan, np.inf):
        with pytest.raises(InputError, match=r"horizon: .* must be at least a tick, 0\.0333333 s"):
            controllability_gramian(Scenario(), horizon)
