"""An IMU's errors by the truth: the path's rates and force are those of the formula, densities are found again."""

import numpy as np
import pytest
from made_up_motion import GRAVITY, attitude, place
from scipy.spatial.transform import Rotation

from ortilo_drake.interop.recorded.map_file import Map
from ortilo_drake.interop.recorded.recording import Imu, Recording, Truth
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.studies.fit.fit import _of_recordings
from ortilo_drake.studies.fit.sensor_errors import _density, block_means, body_path, imu_errors, mount_of
from ortilo_drake.studies.recorded.calibrate import Calibration

T = np.arange(0.0, 40.0, 0.004)
BY = Calibration(0.0, "map", np.eye(3), np.zeros(3), None, np.zeros(3), np.zeros(4), np.zeros((4, 3)), 0.0, 0.0)
MAP = Map.model_construct(airborne=None)


def truth(noise: float = 0.0) -> Truth:
    rng = np.random.default_rng(0)
    return Truth(T, place(T) + noise * rng.standard_normal((len(T), 3)), attitude(T).as_matrix())


def exact(t):
    h = 1e-3
    a_W = (place(t + h) - 2 * place(t) + place(t - h)) / h**2
    rates = (attitude(t - h).inv() * attitude(t + h)).as_rotvec() / (2 * h)
    return rates, attitude(t).inv().apply(a_W + [0, 0, GRAVITY])


def test_a_path_rounded_to_a_millimetre_says_what_an_ideal_imu_does() -> None:
    path, t = body_path("x", truth(noise=3e-4), BY), np.arange(2.0, 38.0, 0.01)
    rates, force = exact(t)
    assert np.abs(path.rates(t) - rates).max() < 0.005
    assert np.sqrt(np.mean((path.force(t) - force) ** 2)) < 0.15
    means = block_means(t, path.force(t) - force, 0.5)
    assert np.abs(means).max() < 0.03


def test_beyond_its_ends_a_path_stands_still_and_so_says_its_imu() -> None:
    path, t = body_path("x", truth(), BY), np.array([-5.0, -0.1, 40.1, 50.0])
    np.testing.assert_array_equal(path.rates(t), 0.0)
    np.testing.assert_allclose(path.attitude(t).apply(path.force(t)), np.tile([0, 0, GRAVITY], (4, 1)), atol=1e-12)
    assert (path.position(t)[2:] == path.position(t[3:])).all()


def test_a_truth_without_attitude_is_refused_in_a_line() -> None:
    with pytest.raises(InputError, match=r"truth\.rotation"):
        body_path("x", truth()._replace(R=None), BY)


def test_densities_biases_mount_and_a_faulty_axis_are_found() -> None:
    rng, turned = np.random.default_rng(1), Rotation.from_rotvec([0.0, 0.0, 0.1])
    rates, force = exact(T)
    white = rng.standard_normal((2, len(T), 3)) / np.sqrt(0.004)
    rates = turned.inv().apply(rates) + [0.01, 0.0, -0.01] + 0.005 * white[0]
    force = turned.inv().apply(force) + [0.0, 0.2, 0.1] + 0.03 * white[1]
    force[::8, 0] -= 12.0
    recording = Recording("x", None, Imu(T, rates, force, None), truth(), np.zeros((4, 3)), 0.0, 0.0, [], {})
    path = body_path("x", recording.truth, BY)
    mount = mount_of(recording, path, BY, MAP)
    np.testing.assert_allclose(mount.as_rotvec(), [0.0, 0.0, 0.1], atol=0.01)
    found = imu_errors(recording, path, turned, BY, MAP)
    np.testing.assert_allclose(found.rotation, 0.005, rtol=0.3)
    np.testing.assert_allclose(found.force[1:], 0.03, rtol=0.3)
    assert np.isnan(found.force[0])
    np.testing.assert_allclose(found.rotation_bias, [0.01, 0.0, -0.01], atol=0.003)
    np.testing.assert_allclose(found.force_bias[1:], [0.2, 0.1], atol=0.03)


def test_a_density_is_as_uncertain_as_it_is_told_to_be() -> None:
    t, rng = np.arange(0.0, 40.0, 0.05), np.random.default_rng(4)
    samples = rng.standard_normal((400, len(t), 3))
    found = [_density(t, one, 0.25) for one in samples]
    scatter = np.log([density for density, _ in found]).std(axis=0)
    np.testing.assert_allclose(scatter, found[0][1], rtol=0.1)


def test_the_interval_of_a_density_widens_where_recordings_differ() -> None:
    sds = np.array([0.1, 0.1])
    alike, apart = _of_recordings(np.array([1.0, 1.0]), sds), _of_recordings(np.array([0.5, 2.0]), sds)
    assert np.log(alike.high / alike.low) == pytest.approx(2 * 1.959964 * 0.1 / np.sqrt(2.0))
    assert np.log(apart.high / apart.low) == pytest.approx(
        12.7062 * np.log(4.0)
    )  # Student's t of one degree of freedom
    assert _of_recordings(np.array([0.0]), sds[:1]) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("recordings", [2, 3, 5, 10])
def test_of_recordings_that_differ_the_interval_of_a_density_holds_the_usual_one(recordings: int) -> None:
    """With normal intervals it was 70, 78, 84 and 87 % of all cases."""
    rng, sds = np.random.default_rng(0), np.full(recordings, 0.05)
    drawn = np.exp(0.5 * rng.standard_normal((2000, recordings)))
    held = [_of_recordings(values, sds).holds(1.0) for values in drawn]
    assert 0.935 < np.mean(held) < 0.965
