"""The prediction to a command's time: against SciPy, and the closed loop that it promises."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm, solve_discrete_are
from scipy.signal import cont2discrete

from ortilo_drake.model.hover import discretize, hover_A, hover_B
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.model.vehicle import M100
from ortilo_drake.onboard.commands.timeline import predicted_state, reference_after, state_ahead
from ortilo_drake.onboard.servo.lq_gain import augmented_pair, servo_gain, weight_matrices
from ortilo_drake.onboard.servo.lq_servo import delayed_gain, delayed_pair, split_delay
from ortilo_drake.scenario import ServoWeights, load_scenario
from ortilo_drake.studies.command_link.late_servo import late_gains

H = 1.0 / 30.0
A, B = hover_A(), hover_B(M100)
HOVER = np.array([M100.hover_thrust, 0.0, 0.0, 0.0])
RNG = np.random.default_rng(5)


def test_the_flow_is_the_matrix_exponential() -> None:
    x, b, s = RNG.normal(size=12), RNG.normal(size=12), 0.37
    wide = np.zeros((13, 13))
    wide[:12, :12], wide[:12, 12] = A, b
    np.testing.assert_allclose(predicted_state(x, b, A, s), (expm(wide * s) @ [*x, 1.0])[:12], rtol=1e-12, atol=1e-12)


def test_the_reference_goes_on_with_its_acceleration() -> None:
    s = 0.3
    expected = expm(np.kron(np.diag([1.0, 1.0], 1), np.eye(3)) * s) @ (r := RNG.normal(size=9))
    np.testing.assert_allclose(reference_after(r, s), expected, rtol=1e-12)


@pytest.mark.parametrize("tau", [0.0, 0.5 * H, H, 2.3 * H, 4 * H])
def test_the_state_ahead_is_the_plant_under_the_commands_on_the_way(tau: float) -> None:
    t, x, us = 7 * H, RNG.normal(size=12), RNG.normal(size=(6, 4))
    since = np.array([-1.0, t - 0.02, t + 0.013, t + 0.05, t + 0.06, t + 0.11])

    def x_dot(now: float, state: np.ndarray) -> np.ndarray:
        return A @ state + B @ us[np.searchsorted(since, now, side="right") - 1]

    edges = [t, *since[(since > t) & (since < t + tau)], t + tau]
    expected = x
    for begin, end in pairwise(edges):
        expected = solve_ivp(x_dot, (begin, end - 1e-12), expected, rtol=1e-11, atol=1e-11).y[:, -1]
    rows = np.column_stack([since, us + HOVER])
    found = state_ahead(np.append(x, np.zeros(3)), np.zeros(9), rows, t, tau, H, A, B, -B @ HOVER)
    np.testing.assert_allclose(found[:12], expected, rtol=1e-7, atol=1e-7)


def predicted(ticks: float) -> tuple[np.ndarray, np.ndarray]:
    scenario = load_scenario("nominal_imu_uwb", (f"commands={{servo: predicted, delay: {ticks * H}}}",))
    L, _, L_u = late_gains(scenario, ticks)
    return L, L_u


@pytest.mark.long
@pytest.mark.parametrize("d", [1, 2, 3, 5])
def test_the_predictor_gives_the_eigenvalues_without_delay_and_zeros(d: int) -> None:
    # Artstein's reduction: z_k = x_{k+d} has no delay, and the d commands on the way are d zeros each.
    L, L_u = predicted(d)
    Phi, Gamma = delayed_pair(M100, H, d * H)
    gains = np.hstack([L, *L_u[:d]])
    np.testing.assert_allclose(L_u[d:], 0.0, atol=1e-12)
    found = np.linalg.eigvals(Phi - Gamma @ gains)
    found = found[np.argsort(-np.abs(found))]
    Phibar, Gammabar = augmented_pair(M100, H)
    wanted = np.linalg.eigvals(Phibar - Gammabar @ servo_gain(M100, ServoWeights(), H))
    np.testing.assert_allclose(
        np.sort_complex(np.round(found[:15], 6)), np.sort_complex(np.round(wanted, 6)), atol=2e-6
    )
    assert np.all(np.abs(found[15:]) < 1e-2)  # zeros in chains of d, which rounding spreads by its d-th root


@pytest.mark.parametrize("ticks", [0.5, 1.0, 2.0, 2.31, 4.0])
def test_the_delayed_plant_is_one_sampled_a_hundred_times_as_often(ticks: float) -> None:
    d, theta = split_delay(ticks * H, H)
    Phi, Gamma = delayed_pair(M100, H, ticks * H)
    fine_Phi, fine_Gamma, *_ = cont2discrete((A, B, np.eye(12), np.zeros((12, 4))), H / 100)
    x, us, u = RNG.normal(size=12), RNG.normal(size=(d, 4)), RNG.normal(size=4)
    z = Phi @ np.concatenate([x, np.zeros(3), us.ravel()]) + Gamma @ u
    for step in range(100):
        x = fine_Phi @ x + fine_Gamma @ [u, *us][d if step < round(100 * (1 - theta)) else d - 1]
    np.testing.assert_allclose(z[:12], x, rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(z[15:].reshape(d, 4), [u, *us][:d])


@pytest.mark.parametrize("ticks", [0.5, 1.0, 2.0, 2.31, 4.0])
def test_the_augmented_gain_is_scipy_s(ticks: float) -> None:
    Phi, Gamma = delayed_pair(M100, H, ticks * H)
    Q, R = weight_matrices(ServoWeights())
    wide = np.zeros_like(Phi)
    wide[:15, :15] = Q
    S = solve_discrete_are(Phi, Gamma, wide, R)
    expected = np.linalg.solve(Gamma.T @ S @ Gamma + R, Gamma.T @ S @ Phi)
    np.testing.assert_allclose(delayed_gain(M100, ServoWeights(), H, ticks * H), expected, rtol=1e-6, atol=1e-7)


@pytest.mark.long
@pytest.mark.parametrize("d", [0, 1, 3])
def test_of_whole_ticks_the_augmented_gain_is_the_predictor(d: int) -> None:
    Phibar, Gammabar = augmented_pair(M100, H)
    L = servo_gain(M100, ServoWeights(), H)
    powers = [np.linalg.matrix_power(Phibar, j) for j in range(d + 1)]
    expected = np.hstack([L @ powers[d], *(L @ powers[j] @ Gammabar for j in range(d))])
    np.testing.assert_allclose(delayed_gain(M100, ServoWeights(), H, d * H), expected, rtol=1e-6, atol=1e-7)
    if d:
        L_x, L_u = predicted(d)
        np.testing.assert_allclose(np.hstack([L_x, *L_u[:d]]), expected, rtol=1e-8, atol=1e-10)


@pytest.mark.parametrize(
    ("settings", "named"),
    [
        (("commands.filter=acted",), r"estimator\.delay must be replay"),
        (("commands.servo=augmented",), r"commands\.delay: null"),
        (("commands.delay=0.1",), "must be null with filter sent and servo present"),
        (("commands.servo=predicted", "servo.velocities=truth"), "of the truth"),
        (("commands.servo=early",), "commands.servo"),
        (("commands.delay=-0.1",), "commands.delay"),
        (("report_link.rate=100",), "report_link.rate"),
        (("report_link.rate=7",), "report_link.*must divide"),
    ],
)
def test_settings_that_cannot_be_are_refused(settings: tuple[str, ...], named: str) -> None:
    with pytest.raises(InputError, match=named):
        load_scenario("nominal_imu_uwb", settings)


def test_discretize_is_what_the_gain_goes_by() -> None:
    Phi, Gamma = discretize(A, B, H)
    wide_Phi, wide_Gamma = delayed_pair(M100, H, 0.0)
    np.testing.assert_array_equal(wide_Phi[:12, :12], Phi)
    np.testing.assert_array_equal(wide_Gamma[:12], Gamma)
