"""The attitude filter's error against the closed form of a first-order lag."""

from dataclasses import replace

import numpy as np
import pytest
from drake_box import PlayedBox

from ortilo_drake.loop.element import Values, outside
from ortilo_drake.model.equations import rotation_matrix
from ortilo_drake.model.signals import IMU_SIZE, PAYLOAD, size_of_samples
from ortilo_drake.scenario import Ahrs
from ortilo_drake.world.sensors.ahrs import ahrs_box

H, T, G = 1.0 / 30.0, 4.0, 9.81


def message_of(samples: int = 1) -> np.ndarray:
    one = np.concatenate(([1.0, 0.0], np.zeros(9)))
    return one if samples == 1 else np.concatenate(([1.0, 0.0], np.tile(one, samples)))


def errors(acceleration: list[float], rpy: list[float], ticks: int, samples: int = 1, drift: float = 0.0) -> np.ndarray:
    """Return what is added to the angles (3) after so many ticks under an acceleration."""
    size = IMU_SIZE if samples == 1 else size_of_samples(IMU_SIZE, samples)
    box = ahrs_box(Ahrs(time=T), outside("imu", size), samples, H)
    box = replace(box, given=box.given.updated(Values({"drift": drift})))
    state = np.concatenate((np.zeros(3), rpy, np.zeros(6)))
    plays = PlayedBox(box, H, message=message_of(samples), state=state, acceleration=np.array(acceleration))
    for _ in range(ticks):
        plays.step()
    said = plays.say()
    heads = [0] if samples == 1 else [size_of_samples(IMU_SIZE, i) for i in range(samples)]
    found = [said[at + PAYLOAD : at + PAYLOAD + 3] for at in heads]
    for one in found[1:]:
        np.testing.assert_array_equal(one, found[0])
    return np.array(found[0])


@pytest.mark.parametrize("ticks", [0, 1, 30, 120, 1200])
@pytest.mark.parametrize("samples", [1, 8])
def test_under_an_acceleration_that_lasts_the_level_lags_to_its_angle(ticks: int, samples: int) -> None:
    come = 1.0 - np.exp(-ticks * H / T)
    ahead = errors([1.5, 0.0, 0.0], [0.0, 0.0, 0.0], ticks, samples)
    np.testing.assert_allclose(ahead, [0.0, -np.arctan(1.5 / G) * come, 0.0], atol=1e-12)
    left = errors([0.0, 1.5, 0.0], [0.0, 0.0, 0.0], ticks, samples)
    np.testing.assert_allclose(left, [np.arctan(1.5 / G) * come, 0.0, 0.0], atol=1e-12)


@pytest.mark.parametrize("rpy", [[0.2, -0.3, 0.0], [-0.4, 0.1, 2.0]])
def test_at_rest_nothing_errs_however_it_leans(rpy: list[float]) -> None:
    np.testing.assert_allclose(errors([0.0, 0.0, 0.0], rpy, 300), 0.0, atol=1e-12)


@pytest.mark.long
def test_thrust_along_its_axis_looks_level() -> None:
    """Where rotors alone act, the specific force is along B's z: the filter comes to believe that it flies level."""
    rpy = np.array([0.1, -0.2, 0.7])
    v_dot = rotation_matrix(rpy)[:, 2] * 11.0 - np.array([0.0, 0.0, G])
    np.testing.assert_allclose(errors(list(v_dot), list(rpy), 4000), [-0.1, 0.2, 0.0], atol=1e-9)


def test_the_yaw_drifts_as_its_rate_says() -> None:
    np.testing.assert_allclose(errors([0.0, 0.0, 0.0], [0.0, 0.0, 0.0], 90, drift=0.01), [0.0, 0.0, 0.03], atol=1e-12)
