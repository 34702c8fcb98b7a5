"""The equations of motion against Drake's rotations and its Euler-angle accelerations."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from pydrake.autodiffutils import ExtractGradient, InitializeAutoDiff
from pydrake.math import RollPitchYaw
from scipy.integrate import quad_vec, solve_ivp
from scipy.linalg import expm
from scipy.signal import cont2discrete

from ortilo_drake.model.equations import (
    DYNAMICS,
    KINEMATICS,
    body_rates,
    euler_rate_matrix,
    linear_dynamics,
    rigid_body_dynamics,
    rotation_matrix,
    small_angle_dynamics,
    step,
    thrust_direction,
)
from ortilo_drake.model.hover import discretize, disturbance_W, hover_A, hover_B, hover_B_d, output_C
from ortilo_drake.model.signals import STATE_NAMES
from ortilo_drake.model.vehicle import GRAVITY, M100, Vehicle

INERTIA = np.array(M100.inertia)


def vectors(size: int, bound: float) -> st.SearchStrategy[np.ndarray]:
    return arrays(float, size, elements=st.floats(-bound, bound))


RPY = vectors(3, 1.3)
STATES = vectors(12, 1.3)
CONTROLS = vectors(4, 30.0)
DISTURBANCES = vectors(6, 2.0)


@given(RPY)
def test_rotation_and_thrust_direction_are_drakes(rpy: np.ndarray) -> None:
    R_WB = RollPitchYaw(rpy).ToRotationMatrix().matrix()
    np.testing.assert_allclose(rotation_matrix(rpy), R_WB, atol=1e-15)
    np.testing.assert_allclose(thrust_direction(*rpy), R_WB[:, 2], atol=1e-15)


@given(RPY, vectors(3, 4.0))
def test_body_rates_are_drakes(rpy: np.ndarray, rpy_dot: np.ndarray) -> None:
    w_WB_B = RollPitchYaw(rpy).CalcAngularVelocityInChildFromRpyDt(rpy_dot)
    np.testing.assert_allclose(body_rates(rpy, rpy_dot), w_WB_B, atol=1e-14)


@given(STATES, CONTROLS, DISTURBANCES)
def test_rigid_body_obeys_newton_and_euler(x: np.ndarray, u: np.ndarray, d: np.ndarray) -> None:
    x_dot = rigid_body_dynamics(x, u, d, M100.mass, INERTIA)
    attitude = RollPitchYaw(x[3:6])
    R_WB = attitude.ToRotationMatrix().matrix()
    force_W = R_WB @ [0.0, 0.0, u[0]] + d[:3] - [0.0, 0.0, M100.mass * GRAVITY]
    w_B = attitude.CalcAngularVelocityInChildFromRpyDt(x[9:12])
    alpha_B = np.linalg.solve(np.diag(INERTIA), u[1:] + d[3:] - np.cross(w_B, INERTIA * w_B))
    np.testing.assert_array_equal(x_dot[:6], x[6:])
    np.testing.assert_allclose(x_dot[6:9], force_W / M100.mass, rtol=1e-13, atol=1e-13)
    rpy_ddot = attitude.CalcRpyDDtFromAngularAccelInChild(x[9:12], alpha_B)
    np.testing.assert_allclose(x_dot[9:12], rpy_ddot, rtol=1e-11, atol=1e-9)


@given(STATES, CONTROLS, DISTURBANCES)
def test_small_angle_takes_euler_rates_for_body_rates(x: np.ndarray, u: np.ndarray, d: np.ndarray) -> None:
    x_dot = small_angle_dynamics(x, u, d, M100.mass, INERTIA)
    w = x[9:12]
    alpha = (u[1:] + d[3:] - np.cross(w, INERTIA * w)) / INERTIA
    np.testing.assert_allclose(x_dot[9:12], alpha, rtol=1e-12, atol=1e-11)
    same = rigid_body_dynamics(x, u, d, M100.mass, INERTIA)
    np.testing.assert_array_equal(x_dot[:9], same[:9])


@given(RPY, vectors(3, 4.0))
def test_the_matrix_of_euler_rates_gives_the_body_rates(rpy: np.ndarray, rpy_dot: np.ndarray) -> None:
    np.testing.assert_allclose(euler_rate_matrix(rpy) @ rpy_dot, body_rates(rpy, rpy_dot), atol=1e-12)


@given(STATES, CONTROLS, DISTURBANCES)
def test_the_linear_equations_are_those_of_the_hover_matrices(x: np.ndarray, u: np.ndarray, d: np.ndarray) -> None:
    hover = np.array([M100.hover_thrust, 0.0, 0.0, 0.0])
    expected = hover_A() @ x + hover_B(M100) @ (u - hover) + hover_B_d(M100) @ d
    np.testing.assert_allclose(linear_dynamics(x, u, d, M100.mass, INERTIA), expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("kinematics", KINEMATICS)
def test_a_step_is_scipys_flight_to_the_fifth_order(kinematics: str) -> None:
    rng = np.random.default_rng(3)
    x, d = 0.3 * rng.normal(size=12), rng.normal(size=6)
    u = np.array([M100.hover_thrust, 0.0, 0.0, 0.0]) + [1.0, 0.1, -0.1, 0.05]
    arguments = u, d, M100.mass, INERTIA
    errors = []
    for h in (0.08, 0.04):
        exact = solve_ivp(
            lambda _, y: DYNAMICS[kinematics](y, *arguments), (0.0, h), x, method="DOP853", rtol=1e-13, atol=1e-14
        ).y[:, -1]
        errors.append(np.abs(step(x, *arguments, KINEMATICS.index(kinematics), h) - exact).max())
    assert errors[0] < 1e-5
    assert errors[1] < errors[0] / 20.0 or errors[0] < 1e-13  # of fifth order in h, so 32 times


@pytest.mark.family
@pytest.mark.parametrize("kinematics", DYNAMICS)
@given(STATES, CONTROLS, DISTURBANCES)
def test_compiled_and_plain_form_agree(kinematics: str, x: np.ndarray, u: np.ndarray, d: np.ndarray) -> None:
    compiled = DYNAMICS[kinematics](x, u, d, M100.mass, INERTIA)
    plain = DYNAMICS[kinematics].py_func(x, u, d, M100.mass, INERTIA)
    np.testing.assert_allclose(compiled, plain, rtol=1e-12, atol=1e-11)


H = 1.0 / 30.0
PHI, GAMMA = discretize(hover_A(), hover_B(M100), H)
ROW = {name: i for i, name in enumerate(STATE_NAMES)}
F_T, TAU_Y = 0, 2


@pytest.mark.parametrize(
    ("value", "printed"),
    [
        (PHI[ROW["x"], ROW["theta"]], "5.4500000e-03"),
        (PHI[ROW["x"], ROW["theta_dot"]], "6.0555556e-05"),
        (GAMMA[ROW["x"], TAU_Y], "3.0419001e-06"),
        (GAMMA[ROW["x_dot"], TAU_Y], "3.6502801e-04"),
        (GAMMA[ROW["z"], F_T], "2.0576132e-04"),
        (GAMMA[ROW["z_dot"], F_T], "1.2345679e-02"),
    ],
)
def test_values_of_the_m100_to_their_printed_digits(value: float, printed: str) -> None:
    assert f"{value:.7e}" == printed


def test_A_is_nilpotent_of_index_four() -> None:
    A = hover_A()
    assert np.any(np.linalg.matrix_power(A, 3))
    assert not np.any(np.linalg.matrix_power(A, 4))


@pytest.mark.parametrize("h", [0.001, H, 0.1])
@pytest.mark.parametrize("vehicle", [M100, Vehicle(mass=0.5, inertia=(0.003, 0.004, 0.005))], ids=["m100", "small"])
def test_discretisation_is_scipys(vehicle: Vehicle, h: float) -> None:
    A, B = hover_A(), np.hstack([hover_B(vehicle), hover_B_d(vehicle)])
    Phi, Gamma = discretize(A, B, h)
    n, m = B.shape
    block = expm(h * np.block([[A, B], [np.zeros((m, n + m))]]))
    np.testing.assert_allclose(Phi, block[:n, :n], rtol=1e-13, atol=1e-17)
    np.testing.assert_allclose(Gamma, block[:n, n:], rtol=1e-13, atol=1e-17)
    Phi_zoh, Gamma_zoh, *_ = cont2discrete((A, B, np.eye(n), np.zeros((n, m))), h, method="zoh")
    np.testing.assert_allclose(Phi, Phi_zoh, rtol=1e-13, atol=1e-17)
    np.testing.assert_allclose(Gamma, Gamma_zoh, rtol=1e-13, atol=1e-17)


@pytest.mark.parametrize("yaw", [0.0, 0.7, np.pi / 2, -2.2, np.pi])
def test_A_and_B_are_the_slopes_of_the_equations_of_motion_under_any_heading(yaw: float) -> None:
    """Drake's automatic differentiation of the nonlinear plant at hover; Phi follows by SciPy's exponential."""
    x, u = np.zeros(12), np.array([M100.hover_thrust, 0.0, 0.0, 0.0])
    x[5] = yaw
    at = InitializeAutoDiff(np.concatenate([x, u]))[:, 0]
    inertia = np.array(M100.inertia)
    slopes = ExtractGradient(small_angle_dynamics(at[:12], at[12:], np.zeros(6), M100.mass, inertia))
    np.testing.assert_allclose(hover_A(yaw), slopes[:, :12], atol=1e-14)
    np.testing.assert_allclose(hover_B(M100), slopes[:, 12:], atol=1e-14)
    np.testing.assert_allclose(discretize(hover_A(yaw), hover_B(M100), H)[0], expm(H * slopes[:, :12]), atol=1e-15)


@pytest.mark.parametrize("yaw", [0.0, 0.7])
def test_W_is_the_covariance_of_a_held_disturbance_by_quadrature(yaw: float) -> None:
    A, B_d = hover_A(yaw), hover_B_d(M100)
    effect, _ = quad_vec(lambda s: expm(A * (H - s)) @ B_d, 0.0, H, epsabs=1e-16, epsrel=1e-13)
    W = effect @ np.diag([0.27**2] * 3 + [0.005**2] * 3) @ effect.T
    np.testing.assert_allclose(disturbance_W(M100, H, 0.27, 0.005, yaw), W, rtol=1e-11, atol=1e-22)


def test_W_is_the_covariance_of_sampled_disturbances() -> None:
    n = 200_000
    d = np.random.default_rng(1).normal(size=(n, 6)) * ([0.27] * 3 + [0.005] * 3)
    # The state after a tick from rest at hover, by hand: force acts on v, v on p; torque on rates, and so on.
    a, alpha = d[:, :3] / M100.mass, d[:, 3:] / np.array(M100.inertia)
    rates, angles = alpha * H, alpha * H**2 / 2
    tilt = 9.81 * np.column_stack([angles[:, 1], -angles[:, 0], 0 * angles[:, 2]])
    v = a * H + tilt * H / 3  # the angle grows as s^2 / 2: its integral is h / 3 of its end
    p = a * H**2 / 2 + tilt * H**2 / 12
    sampled = np.cov(np.hstack([p, angles, v, rates]).T)
    W = disturbance_W(M100, H, 0.27, 0.005)
    scale = np.sqrt(np.outer(np.diag(W), np.diag(W)))
    np.testing.assert_allclose(sampled / scale, W / scale, atol=5 / np.sqrt(n))


def test_every_sensor_reads_its_states() -> None:
    x = np.arange(12.0)
    np.testing.assert_array_equal(output_C() @ x, [0, 1, 2, 0, 1, 2, 3, 4, 5])
