"""Inertial propagation of the tight filter: closed forms, Drake's rotations, and its transition by differences."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from ortilo_drake.onboard.estimator.tight.inertial import (
    angles_of,
    inertial_step,
    matrix_of,
    propagate_covariance,
    quaternion_of,
    turned,
)
from ortilo_drake.onboard.estimator.tight.layout import ACCEL, ADDITIVE, GYRO, N_INERTIAL, Q, make_layout, nominal_size
from ortilo_drake.onboard.estimator.tight.tick import keep_pose
from ortilo_drake.onboard.estimator.tight.update import inject

G = 9.81
PLAIN = make_layout({}, 0)
angles = st.tuples(*(st.floats(-1.4, 1.4),) * 3)


def start(rpy: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> np.ndarray:
    x = np.zeros(nominal_size(PLAIN))
    x[Q : Q + 4] = quaternion_of(np.array(rpy))
    return x


def run(x: np.ndarray, w: np.ndarray, f: np.ndarray, dt: float, steps: int) -> tuple[np.ndarray, np.ndarray]:
    A, N = np.eye(9, N_INERTIAL), np.zeros((9, 9))
    for _ in range(steps):
        inertial_step(x, A, N, w, f, dt, np.array([1e-4, 1e-2]))
    return A, N


@settings(deadline=None)
@given(rpy=angles)
def test_quaternion_matrix_and_angles_are_drakes(rpy: tuple[float, float, float]) -> None:
    q = quaternion_of(np.array(rpy))
    expected = RollPitchYaw(rpy)
    np.testing.assert_allclose(matrix_of(q), expected.ToRotationMatrix().matrix(), atol=1e-12)
    np.testing.assert_allclose(angles_of(q), rpy, atol=1e-9)


@settings(deadline=None)
@given(rpy=angles, turn=angles)
def test_a_turn_is_the_exponential(rpy: tuple[float, float, float], turn: tuple[float, float, float]) -> None:
    from scipy.spatial.transform import Rotation

    R = matrix_of(turned(quaternion_of(np.array(rpy)), *turn))
    expected = matrix_of(quaternion_of(np.array(rpy))) @ Rotation.from_rotvec(turn).as_matrix()
    np.testing.assert_allclose(R, expected, atol=1e-9)


def test_a_body_at_rest_stays_and_a_push_gives_half_a_t_squared() -> None:
    x = start((0.2, -0.1, 0.5))
    R = RollPitchYaw(0.2, -0.1, 0.5).ToRotationMatrix().matrix()
    a = np.array([0.3, -0.2, 0.1])
    run(x, np.zeros(3), R.T @ (a + [0.0, 0.0, G]), 1.0 / 240.0, 480)
    np.testing.assert_allclose(x[0:3], 0.5 * a * 4.0, atol=1e-9)
    np.testing.assert_allclose(x[3:6], a * 2.0, atol=1e-9)


def test_a_steady_turn_flies_a_circle() -> None:
    """At speed v and yaw rate w the way is a circle of radius v / w, its specific force w v to the left and g up."""
    v, w, x = 1.5, 0.7, start()
    x[3:6] = [v, 0.0, 0.0]
    steps, dt = 2400, 1.0 / 240.0
    run(x, np.array([0.0, 0.0, w]), np.array([0.0, w * v, G]), dt, steps)
    angle = w * dt * steps
    np.testing.assert_allclose(x[0:3], [v / w * np.sin(angle), v / w * (1.0 - np.cos(angle)), 0.0], atol=2e-5)
    assert angles_of(x[Q : Q + 4])[2] == pytest.approx((angle + np.pi) % (2.0 * np.pi) - np.pi, abs=1e-9)


def test_the_transition_is_the_derivative_of_the_propagation() -> None:
    rng = np.random.default_rng(3)
    w, f = rng.normal(0.0, 0.5, 3), np.array([0.4, -0.3, 9.6])
    x_0 = start((0.3, -0.2, 0.7))
    x_0[3:6] = rng.normal(size=3)
    x_0[ADDITIVE : ADDITIVE + 6] = rng.normal(0.0, 0.01, 6)
    x = x_0.copy()
    A, _ = run(x, w, f, 1.0 / 240.0, 8)
    eps = 1e-6
    for j in range(N_INERTIAL):
        moved = []
        for sign in (1.0, -1.0):
            error = np.zeros(N_INERTIAL)
            error[j] = sign * eps
            y = x_0.copy()
            inject(y, error, N_INERTIAL)
            run(y, w, f, 1.0 / 240.0, 8)
            turn = matrix_of(x[Q : Q + 4]).T @ matrix_of(y[Q : Q + 4])
            theta = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
            moved.append(np.concatenate((y[0:6] - x[0:6], theta)))
        # A bias turns the body by dt db_g, where the right Jacobian of the turn would have it by a 400th less.
        atol = 1.5e-4 if GYRO <= j < ACCEL else 3e-6
        np.testing.assert_allclose(A[:, j], (moved[0] - moved[1]) / (2.0 * eps), atol=atol)


def test_the_noise_of_a_tick_is_that_of_white_samples() -> None:
    """Eight samples of a level body at rest: sd dt sqrt(8) in angle and velocity, and the integral in position."""
    A, N = run(start(), np.zeros(3), np.array([0.0, 0.0, G]), 1.0 / 240.0, 8)
    dt = 1.0 / 240.0
    np.testing.assert_allclose(np.diag(N)[6:9], 8 * dt**2 * 1e-4, rtol=1e-9)
    np.testing.assert_allclose(N[5, 5], 8 * dt**2 * 1e-2, rtol=1e-9)
    ages = dt * np.arange(8)  # a velocity error made that long ago has been integrated since
    np.testing.assert_allclose(N[2, 2], np.sum(ages**2) * dt**2 * 1e-2, rtol=1e-9)
    np.testing.assert_allclose(N, N.T, atol=1e-20)
    assert A[2, 5] == pytest.approx(8 * dt)


def test_the_covariance_is_propagated_as_the_dense_product() -> None:
    rng = np.random.default_rng(0)
    layout = make_layout({"range_bias": 4, "range_slow": 4}, 2)
    root = rng.normal(size=(layout.n, layout.n))
    C = root @ root.T
    A = rng.normal(size=(9, N_INERTIAL))
    noise = np.diag(rng.uniform(0.1, 1.0, 9))
    keeps, steps = np.ones(layout.core - GYRO), rng.uniform(0.0, 1.0, layout.core - GYRO)
    keeps[-4:] = 0.8
    F = np.eye(layout.n)
    F[:9, :N_INERTIAL] = A
    F[range(9, layout.core), range(9, layout.core)] = keeps
    W = np.zeros((layout.n, layout.n))
    W[:9, :9] = noise
    W[range(9, layout.core), range(9, layout.core)] = steps
    expected = F @ C @ F.T + W
    propagate_covariance(C, A, noise, keeps, steps, np.empty((9, layout.n)))
    np.testing.assert_allclose(C, expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(C, C.T, rtol=1e-12)


def test_a_kept_pose_is_a_copy_with_its_correlations() -> None:
    rng = np.random.default_rng(1)
    layout = make_layout({"angles": 3}, 2)
    root = rng.normal(size=(layout.n, layout.n))
    C = root @ root.T
    x = rng.normal(size=nominal_size(layout))
    x[Q : Q + 4] = quaternion_of(np.array([0.1, 0.2, 0.3]))
    before, C_before = x.copy(), C.copy()
    keep_pose(x, C, layout)
    pose = [0, 1, 2, 6, 7, 8]
    new, old = np.arange(layout.core, layout.core + 6), np.arange(layout.core + 6, layout.core + 12)
    np.testing.assert_array_equal(C[np.ix_(new, new)], C_before[np.ix_(pose, pose)])
    np.testing.assert_array_equal(C[np.ix_(old, new)], C_before[np.ix_(new, pose)])  # yesterday's with today's
    np.testing.assert_array_equal(C[:18, :18], C_before[:18, :18])
    np.testing.assert_array_equal(x[layout.core + 1 : layout.core + 4], before[0:3])
    np.testing.assert_array_equal(x[layout.core + 4 : layout.core + 8], before[Q : Q + 4])
    np.testing.assert_array_equal(x[layout.core + 8 :], before[layout.core + 1 : layout.core + 8])


def test_drakes_pose_of_a_quaternion_is_ours() -> None:
    q = quaternion_of(np.array([0.3, -0.4, 1.1]))
    X = RigidTransform(RotationMatrix(Quaternion(q)), [0.0, 0.0, 0.0])
    np.testing.assert_allclose(matrix_of(q), X.rotation().matrix(), atol=1e-12)
