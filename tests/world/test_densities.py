"""The world is the same at every control rate: spectra by Welch's method and variances of means, against density^2."""

import numpy as np
import pytest
from drake_box import PlayedBox
from scipy import stats
from scipy.signal import welch

from ortilo_drake.model.white_noise import USUAL_PERIOD, USUAL_ROOT, white_sd, white_variances
from ortilo_drake.onboard.estimator.filter_model import process_noise
from ortilo_drake.scenario import Disturbance, Imu, load_scenario
from ortilo_drake.world.sensors.imu import imu_box
from ortilo_drake.world.vehicle.disturbance import disturbance_box

RATES = (20.0, 30.0, 120.0)
DURATION, SEGMENT = 240.0, 4.0  # s
DISTURBANCE, IMU = Disturbance(), Imu()
DENSITIES = np.repeat([DISTURBANCE.force_density, DISTURBANCE.torque_density], 3)
IMU_DENSITIES = np.repeat([IMU.angle_density, IMU.rate_density, IMU.specific_force_density], 3)


def disturbance_at(rate: float) -> np.ndarray:
    """Return what pushes the vehicle in each tick, of densities of 1 (n, 6)."""
    box = PlayedBox(disturbance_box(DISTURBANCE, 1.0 / rate), 1.0 / rate, seed=5)
    return np.array([box.say(k) for k in range(int(DURATION * rate))]) / DENSITIES


def imu_noise_at(rate: float) -> np.ndarray:
    """Return the noise of an imu at rest in each tick, of densities of 1 (n, 9)."""
    inputs = {"sent": np.zeros(1), "state": np.zeros(12), "acceleration": np.array([0.0, 0.0, -9.81])}
    box = PlayedBox(imu_box(IMU, 1.0 / rate, whole=True), 1.0 / rate, 5, **inputs)
    return np.array([box.say(k)[2:] for k in range(int(DURATION * rate))]) / IMU_DENSITIES


@pytest.mark.family
@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("noise_at", [disturbance_at, imu_noise_at])
def test_the_two_sided_spectrum_is_the_density_squared_at_every_control_rate(noise_at: object, rate: float) -> None:
    noise = noise_at(rate)  # type: ignore[operator]
    found, spectrum = welch(noise, rate, "boxcar", int(SEGMENT * rate), 0, detrend=False, return_onesided=False, axis=0)
    below = (found > 0.0) & (found < 9.0)  # what all rates can show
    assert below.sum() == 35
    # Segments that do not overlap are independent, and so are their frequencies: a mean of chi-squares of 2 degrees.
    averaged = below.sum() * DURATION / SEGMENT
    low, high = stats.chi2.ppf([1e-5, 1.0 - 1e-5], 2 * averaged) / (2 * averaged)
    mean = spectrum[below].mean(axis=0)
    assert ((low < mean) & (mean < high)).all(), mean


@pytest.mark.family
@pytest.mark.parametrize("rate", RATES)
def test_the_momentum_given_in_a_tenth_of_a_second_is_as_large_at_every_control_rate(rate: float) -> None:
    """Means over T have the variance D^2 / T."""
    per = round(rate * 0.1)
    means = disturbance_at(rate).reshape(-1, per, 6).mean(axis=1)
    n = means.size
    low, high = stats.chi2.ppf([1e-5, 1.0 - 1e-5], n)
    assert low < (means**2).sum() * 0.1 < high


@pytest.mark.parametrize("rate", RATES)
def test_the_filter_believes_in_the_same_white_force_at_every_control_rate(rate: float) -> None:
    """A force of density D held over each tick h gives v_z the variance D^2 h / m^2 a tick, the same a second."""
    scenario = load_scenario("nominal_imu_uwb", (f"control_rate={rate}",))
    W, h = process_noise(scenario.estimator, scenario.vehicle, scenario.h), scenario.h
    expected = (scenario.world.disturbance.force_density / scenario.vehicle.mass) ** 2
    np.testing.assert_allclose(W[8, 8] / h, expected, rtol=1e-12)
    expected = (scenario.world.disturbance.torque_density / np.array(scenario.vehicle.inertia)) ** 2
    np.testing.assert_allclose(np.diag(W)[9:12] / h, expected, rtol=1e-12)


def test_a_diagonal_process_noise_and_the_noise_of_measurements_follow_the_tick() -> None:
    h, twice = (load_scenario("paper_imu_uwb", (f"control_rate={rate}",)) for rate in (30.0, 60.0))
    np.testing.assert_allclose(
        process_noise(twice.estimator, twice.vehicle, twice.h), process_noise(h.estimator, h.vehicle, h.h) / 2.0
    )
    np.testing.assert_allclose(white_variances((1.0, 2.0), USUAL_PERIOD / 4.0), [4.0, 8.0])


@pytest.mark.parametrize("sd", [0.27, 0.005, 0.01, 0.001, 0.05])
def test_at_30_hz_the_usual_densities_are_the_usual_deviations_to_the_last_bit(sd: float) -> None:
    assert white_sd(sd * USUAL_ROOT, 1.0 / 30.0) == sd
