"""The equations of motion against Drake's rotations and its Euler-angle accelerations."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from pydrake.math import RollPitchYaw
from scipy.integrate import solve_ivp

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
from ortilo_drake.model.hover import hover_A, hover_B, hover_B_d
from ortilo_drake.model.vehicle import GRAVITY, M100

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
