"""The servo's outer loop: where the servo itself asks for no torque, and a thrust that points there."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ortilo_drake.model.vehicle import GRAVITY
from ortilo_drake.onboard.servo.lq_gain import gain_of
from ortilo_drake.onboard.servo.lq_servo import servo_control
from ortilo_drake.onboard.servo.outer_loop import attitude_along, wanted_force
from ortilo_drake.scenario import load_scenario

RNG = np.random.default_rng(3)


def servo(yaw: float) -> tuple[np.ndarray, float]:
    scenario = load_scenario("nominal_imu_uwb", (f"servo.yaw={yaw}",))
    return gain_of(scenario), scenario.vehicle.mass


@pytest.mark.parametrize("yaw", [0.0, 0.7, -2.5])
def test_at_the_attitude_wanted_the_servo_asks_for_no_torque_and_this_thrust(yaw: float) -> None:
    """The whole law says so, near hover, where its small angles are those of the thrust's direction."""
    L, mass = servo(yaw)
    e, v, i = (1e-4 * RNG.normal(size=3) for _ in range(3))
    f = wanted_force(L, mass, yaw, e, v, i)
    rpy, thrust = attitude_along(f, yaw, 1.0)
    r = np.array([1.0, 2.0, 1.5])
    xbar = np.concatenate([r + e, rpy, v, np.zeros(3), i])
    u = servo_control(xbar, np.concatenate([r, np.zeros(6)]), L, mass, yaw, True, None)
    assert u[0] == pytest.approx(mass * thrust, rel=1e-6)
    wanted = L[1:3, 3:5] @ rpy[:2]
    assert np.abs(u[1:3]).max() < 1e-3 * np.abs(wanted).max()


@pytest.mark.parametrize("yaw", [0.0, 0.7])
def test_a_body_that_follows_at_once_comes_to_the_place_and_stays(yaw: float) -> None:
    """A double integrator driven by a + g e_z is stable in closed loop, the integral included."""
    L, mass = servo(yaw)
    h, zero = 1.0 / 30.0, np.zeros(3)
    base = wanted_force(L, mass, yaw, zero, zero, zero)
    K = np.empty((3, 9))
    for k, step in enumerate(1e-3 * np.eye(9)):
        K[:, k] = (wanted_force(L, mass, yaw, step[:3], step[3:6], step[6:]) - base) / 1e-3
    M = np.eye(9)
    M[0:3, 3:6], M[6:9, 0:3] = h * np.eye(3), -np.eye(3)
    M[3:6] += h * K
    assert np.abs(np.linalg.eigvals(M)).max() < 1.0
    np.testing.assert_allclose(base, [0.0, 0.0, GRAVITY], atol=1e-12)


@pytest.mark.parametrize("yaw", [0.0, 1.2, 3.0])
def test_the_body_s_z_lies_along_the_force_at_the_heading_asked_for(yaw: float) -> None:
    f = np.array([2.0, -3.0, 9.0])
    rpy, thrust = attitude_along(f, yaw, 1.0)
    z = Rotation.from_euler("ZYX", rpy[::-1]).as_matrix()[:, 2]
    np.testing.assert_allclose(thrust * z, f, atol=1e-12)
    assert rpy[2] == yaw


def test_it_leans_no_more_than_is_allowed_and_keeps_its_lift() -> None:
    rpy, thrust = attitude_along(np.array([30.0, 40.0, 10.0]), 0.4, 0.35)
    z = Rotation.from_euler("ZYX", rpy[::-1]).as_matrix()[:, 2]
    assert np.arccos(z[2]) == pytest.approx(0.35)
    assert thrust * z[2] == pytest.approx(10.0)
    assert np.arctan2(z[1], z[0]) == pytest.approx(np.arctan2(4.0, 3.0))


def test_however_far_below_it_is_asked_to_be_some_lift_is_left() -> None:
    L, mass = servo(0.0)
    f = wanted_force(L, mass, 0.0, np.array([0.0, 0.0, 1e3]), np.zeros(3), np.zeros(3))
    assert f[2] == pytest.approx(0.2 * GRAVITY)
