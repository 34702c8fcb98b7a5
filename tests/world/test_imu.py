"""The IMU: rest, Drake's body rates, the specific force of Newton's law, and the noise's statistics."""

import numpy as np
import pytest
from drake_box import PlayedBox
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from pydrake.math import RollPitchYaw
from scipy import stats

from ortilo_drake.model.equations import rigid_body_dynamics
from ortilo_drake.model.vehicle import GRAVITY, M100
from ortilo_drake.scenario import Imu as Settings
from ortilo_drake.world.sensors.imu import imu_box

H = 1.0 / 30.0
HOVER = np.array([M100.hover_thrust, 0.0, 0.0, 0.0])
ONE_SECOND = 30


def imu(settings: Settings, seed: int = 0) -> PlayedBox:
    inputs = {"sent": np.zeros(1), "state": np.zeros(12), "felt": HOVER, "disturbance": np.zeros(6)}
    return PlayedBox(imu_box(settings, H, whole=True, mass=M100.mass), H, seed, **inputs)


EXACT = imu(Settings(angle_sd=0.0, rate_sd=0.0, specific_force_sd=0.0))


def exact(x: np.ndarray, u: np.ndarray, d: np.ndarray) -> np.ndarray:
    return EXACT.say(ONE_SECOND, state=x, felt=u, disturbance=d)


@pytest.mark.parametrize("yaw", [0.0, 0.4, -2.0])
def test_at_rest_it_feels_gravity_upwards_and_no_rotation(yaw: float) -> None:
    x = np.zeros(12)
    x[5] = yaw
    expected = [1.0, 1.0, 0.0, 0.0, yaw, 0.0, 0.0, 0.0, 0.0, 0.0, GRAVITY]
    np.testing.assert_allclose(exact(x, HOVER, np.zeros(6)), expected, atol=1e-14)


@given(
    arrays(float, 12, elements=st.floats(-1.2, 1.2)),
    arrays(float, 4, elements=st.floats(-40.0, 40.0)),
    arrays(float, 6, elements=st.floats(-3.0, 3.0)),
)
def test_in_motion_it_measures_rates_by_drake_and_acceleration_less_gravity(
    x: np.ndarray, u: np.ndarray, d: np.ndarray
) -> None:
    message = exact(x, u, d)
    attitude = RollPitchYaw(x[3:6])
    np.testing.assert_array_equal(message[2:5], x[3:6])
    np.testing.assert_allclose(message[5:8], attitude.CalcAngularVelocityInChildFromRpyDt(x[9:12]), atol=1e-13)
    a_W = rigid_body_dynamics(x, u, d, M100.mass, np.array(M100.inertia))[6:9]
    f_B = attitude.ToRotationMatrix().matrix().T @ (a_W + [0.0, 0.0, GRAVITY])
    np.testing.assert_allclose(message[8:11], f_B, atol=1e-12)


def test_noise_is_white_gaussian_of_the_given_deviations() -> None:
    n = 6000
    noisy, noise = imu(Settings(angle_sd=0.01, rate_sd=0.02, specific_force_sd=0.05), seed=7), np.empty((n, 9))
    for k in range(n):
        message = noisy.say(k)
        assert message[0] == 1.0
        assert message[1] == k * H
        noise[k] = message[2:]
    noise[:, 8] -= GRAVITY
    unit = noise / np.repeat([0.01, 0.02, 0.05], 3)
    for axis in unit.T:
        assert stats.kstest(axis, "norm").pvalue > 1e-3
    # Neither correlated between outputs nor from tick to tick (5 standard errors).
    assert np.max(np.abs(np.corrcoef(unit.T) - np.eye(9))) < 5 / np.sqrt(n)
    assert np.max(np.abs(unit[1:].T @ unit[:-1] / n)) < 5 / np.sqrt(n)


def test_noise_belongs_to_the_seed() -> None:
    messages = [imu(Settings(angle_sd=1.0, rate_sd=1.0, specific_force_sd=1.0), seed).say(60) for seed in (1, 1, 2)]
    np.testing.assert_array_equal(messages[0], messages[1])
    assert np.all(messages[0][2:] != messages[2][2:])
