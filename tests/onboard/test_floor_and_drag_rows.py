"""Rows of range finder and flow, and the step of drag, against derivatives of the equations themselves."""

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from ortilo_drake.onboard.estimator.tight.drag import drag_step
from ortilo_drake.onboard.estimator.tight.floor_rows import finder_row, flow_row

P, V, W = np.array([1.0, -2.0, 1.3]), np.array([0.7, -0.4, 0.2]), np.array([0.3, -0.2, 0.5])
R = Rotation.from_euler("ZYX", [0.6, 0.2, -0.15]).as_matrix()
LEVER, FLOOR, PIXELS, SCALE = np.array([0.02, -0.01, -0.04]), 0.1, 4.4, 0.05
D = 1e-6


def moved(d):
    """Return p, v, R, body rates and scale with an error state of [dp, dv, theta, db_g, ds] (13) added."""
    return P + d[:3], V + d[3:6], R @ Rotation.from_rotvec(d[6:9]).as_matrix(), W - d[9:12], SCALE + d[12]


def distance(d):
    """Return how far the floor is from the finder along -z of the body: where its ray meets the plane z = floor."""
    p, _, A, _, _ = moved(d)
    start, ray = p + A @ LEVER, -A[:, 2]
    return (FLOOR - start[2]) / ray[2]


def flow(d, axis):
    p, v, A, w, s = moved(d)
    v_B, h = A.T @ v, p[2] - FLOOR
    seen = (v_B[1] * A[2, 2] / h + w[0], v_B[0] * A[2, 2] / h - w[1])[axis]
    return -PIXELS * (1.0 + s) * seen


def dense(where, row, m):
    found = np.zeros(13)
    np.add.at(found, where[:m], row[:m])
    return found


def slopes(f):
    return np.array([(f(D * e) - f(-D * e)) / (2 * D) for e in np.eye(13)])


def test_the_finders_row_is_its_derivative() -> None:
    where, row = np.zeros(16, np.int64), np.zeros(16)
    assert finder_row(P, R, LEVER, FLOOR, where, row) == pytest.approx(distance(np.zeros(13)))
    np.testing.assert_allclose(dense(where, row, 4), slopes(distance), atol=1e-8)


@pytest.mark.parametrize("axis", [0, 1])
def test_the_flows_rows_are_their_derivatives(axis) -> None:
    where, row = np.zeros(16, np.int64), np.zeros(16)
    y = flow_row(axis, P, V, R, W, FLOOR, PIXELS, SCALE, 12, where, row)
    assert y == pytest.approx(flow(np.zeros(13), axis))
    np.testing.assert_allclose(dense(where, row, 9), slopes(lambda d: flow(d, axis)), atol=1e-7)


@pytest.mark.parametrize("axis", [0, 1])
def test_a_step_of_drag_is_the_derivative_of_the_velocity_it_leaves(axis) -> None:
    k, dt = 0.4, 1e-3

    def after(d):
        _, v, A, _, _ = moved(d)
        return v - dt * k * A[:, axis] * (A[:, axis] @ v)

    base = after(np.zeros(13))
    A, N = np.eye(9), np.zeros((9, 9))
    drag_step(A, N, R, V, axis, k, dt, 0.0)
    jacobian = np.array([(after(D * e) - after(-D * e)) / (2 * D) for e in np.eye(13)])[:9].T
    # The turn of the axis along which a given force acts is inertial_step's: d(R e_i) f_i.
    force = -k * (R[:, axis] @ V)
    turns = np.array([(Rotation.from_rotvec(D * e).as_matrix()[:, axis] - np.eye(3)[axis]) / D for e in np.eye(3)])
    jacobian[:, 6:9] -= dt * force * (R @ turns.T)
    np.testing.assert_allclose(A[3:6], jacobian, atol=1e-8)
    assert not np.allclose(base, V)


@pytest.mark.long
def test_drag_alone_slows_as_its_differential_equation_and_its_noise_grows_as_that() -> None:
    """With dv/dt = -k v + w along x the velocity's variance goes to q / 2 k (1 - exp(-2 k t)); A to exp(F t)."""
    k, dt, n, q = 0.5, 1e-3, 4000, 0.3
    A, N = np.eye(9), np.zeros((9, 9))
    for _ in range(n):
        drag_step(A, N, np.eye(3), np.zeros(3), 0, k, dt, q)
    F = np.zeros((9, 9))
    F[3, 3] = -k
    np.testing.assert_allclose(A, expm(F * n * dt), atol=1e-3)
    assert N[3, 3] == pytest.approx(q / (2 * k) * (1 - np.exp(-2 * k * n * dt)), rel=2e-3)
