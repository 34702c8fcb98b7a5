"""The hover model against THEORY's printed values, SciPy's matrix exponential and numerical quadrature."""

import numpy as np
import pytest
from pydrake.autodiffutils import ExtractGradient, InitializeAutoDiff
from scipy.integrate import quad_vec
from scipy.linalg import expm
from scipy.signal import cont2discrete

from ortilo_drake.model.equations import small_angle_dynamics
from ortilo_drake.model.hover import discretize, disturbance_W, hover_A, hover_B, hover_B_d, output_C
from ortilo_drake.model.signals import STATE_NAMES
from ortilo_drake.model.vehicle import M100, Vehicle

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
