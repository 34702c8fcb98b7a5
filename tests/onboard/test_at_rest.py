"""The first covariance after standing still is that of least squares over every sample of the phase."""

import numpy as np
import pytest

from ortilo_drake.diagrams.wiring.intermittent import filtering_of
from ortilo_drake.model.signals import STATE_NAMES
from ortilo_drake.model.vehicle import GRAVITY
from ortilo_drake.model.white_noise import USUAL_PERIOD, USUAL_ROOT
from ortilo_drake.onboard.estimator.at_rest import Rest, rest_of
from ortilo_drake.onboard.estimator.extra_states import names_of
from ortilo_drake.onboard.estimator.filter_model import initial_covariance
from ortilo_drake.onboard.estimator.tight import model as tight
from ortilo_drake.onboard.estimator.tight.layout import ACCEL, GYRO
from ortilo_drake.scenario import load_scenario

LEVEL_SD, NOISE = 0.01, {"angles": 0.012, "rates": 0.003, "forces": 0.07}
SAMPLES = 7
STILL = ("imu.standstill=0.25", "estimator.walks={accelerometer_rate: 0, gyroscope_rate: 0}")
LASTING = ("landmark_fix.method=pose", f"estimator.biases={{level_sd: {LEVEL_SD}, imu_time: 1.0e+12}}")
MEASURED = ("estimator.force=measured", "estimator.rates=measured")


def least_squares(yaw: float) -> np.ndarray:
    """Covariance of [roll and pitch biases of the imu, b, c] (8): each sample by itself, nothing known of the tilt.

    A body at rest that is rolled by phi and pitched by theta feels g [-theta, phi, 1], to first order; b is told in
    axes that are turned by the yaw. Unknowns: [phi, theta, beta_phi, beta_theta, b, c].
    """
    c, s = np.cos(yaw), np.sin(yaw)
    turned = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    angles = np.hstack((np.eye(2), np.eye(2), np.zeros((2, 6))))
    felt = GRAVITY * np.array([[0.0, -1.0], [1.0, 0.0], [0.0, 0.0]])
    forces = np.hstack((turned @ felt, np.zeros((3, 2)), np.eye(3), np.zeros((3, 3))))
    rates = np.hstack((np.zeros((3, 7)), np.eye(3)))
    parts = [angles / NOISE["angles"], forces / NOISE["forces"], rates / NOISE["rates"]] * SAMPLES
    prior = np.hstack((np.zeros((2, 2)), np.eye(2) / LEVEL_SD, np.zeros((2, 6))))
    A = np.vstack((*parts, prior))
    return np.asarray(np.linalg.inv(A.T @ A)[2:, 2:])


@pytest.mark.parametrize("yaw", [0.0, 0.7, -2.0])
def test_the_filters_first_covariance_is_that_of_least_squares(yaw: float) -> None:
    noise = (("imu", "angles"), ("rates", "rates"), ("specific_force", "forces"))
    V = ", ".join(f"{name}: [{', '.join([f'{NOISE[of] ** 2:.9f}'] * 3)}]" for name, of in noise)
    changes = ("sensors=[uwb, camera, imu]", f"estimator.V={{{V}}}", f"servo.yaw={yaw}", *STILL, *MEASURED, *LASTING)
    scenario = load_scenario("nominal_imu_uwb", changes)
    its = filtering_of(scenario)
    P = initial_covariance(scenario.estimator, its.extras, rest_of(scenario), scenario.yaw)
    assert rest_of(scenario) == Rest(SAMPLES, 0.25, USUAL_PERIOD)
    names = [*STATE_NAMES, *names_of(its.extras)]
    chosen = [
        names.index(name) for name in ("bias_phi_imu", "bias_theta_imu", *(f"{b}_{a}" for b in "bc" for a in "xyz"))
    ]
    np.testing.assert_allclose(P[np.ix_(chosen, chosen)], least_squares(yaw), rtol=1e-9, atol=1e-15)
    others = [i for i in range(len(P)) if i not in chosen]
    assert not P[np.ix_(others, chosen)].any()
    without = initial_covariance(scenario.estimator, its.extras)
    np.testing.assert_array_equal(P[np.ix_(others, others)], without[np.ix_(others, others)])


def test_the_tight_filters_first_covariance_is_that_of_least_squares() -> None:
    walks = "gyroscope_rate: 0, accelerometer_rate: 0, angles_rate: 0"
    imu = f"{{level_sd: {LEVEL_SD}, angle_density: {NOISE['angles'] * USUAL_ROOT}, {walks}}}"
    scenario = load_scenario("tight_imu_uwb", ("imu.link.rate=30", "imu.standstill=0.25", f"estimator.imu={imu}"))
    layout = tight.layout_of(scenario.estimator, scenario.load_room(), ("anchors",), scenario.h)
    P = tight.initial_covariance(scenario.estimator, layout, rest_of(scenario), (NOISE["rates"], NOISE["forces"]))
    chosen = [layout.angles, layout.angles + 1, *range(ACCEL, ACCEL + 3), *range(GYRO, GYRO + 3)]
    np.testing.assert_allclose(P[np.ix_(chosen, chosen)], least_squares(0.0), rtol=1e-9, atol=1e-15)


def test_a_bias_that_walks_is_known_as_its_mean_over_the_phase_is() -> None:
    """Of a random walk w over [0, T], w(T) less its mean has the variance q^2 T / 3: by the walk's own covariance."""
    n, T, q = 2000, 4.0, 0.3
    t = (np.arange(n) + 0.5) * T / n
    K = q**2 * np.minimum.outer(t, t)
    a = np.full(n, -1.0 / n)
    a[-1] += 1.0
    np.testing.assert_allclose(Rest(10, T, T / 10).variance(0.0, q), a @ K @ a, rtol=2e-3)


@pytest.mark.parametrize("name", ["nominal_imu_uwb", "tight_imu_uwb"])
def test_noise_of_a_density_leaves_as_much_of_a_phase_of_any_number_of_samples(name: str) -> None:
    def first(rate: int) -> np.ndarray:
        settings = (*MEASURED, "estimator.V.rates=[1.0e-5, 2.0e-5, 3.0e-5]") if name == "nominal_imu_uwb" else ()
        scenario = load_scenario(name, (f"imu.link.rate={rate}", "imu.standstill=2", *settings))
        if name == "nominal_imu_uwb":
            its = filtering_of(scenario)
            return initial_covariance(scenario.estimator, its.extras, rest_of(scenario), scenario.yaw)
        layout = tight.layout_of(scenario.estimator, scenario.load_room(), ("anchors",), scenario.h)
        noise = tight.sample_sds(scenario.estimator, scenario.samples("imu"), scenario.h)
        return tight.initial_covariance(scenario.estimator, layout, rest_of(scenario), noise)

    np.testing.assert_allclose(first(240), first(30), rtol=1e-12)


@pytest.mark.parametrize(
    ("settings", "samples"),
    [
        ((), 0),
        (("imu.standstill=30",), 900),
        (("imu.standstill=30", "imu.link.rate=10"), 300),
        (("imu.standstill=30", "imu.link.rate=240"), 7200),
        (("imu.standstill=0.001",), 1),
        (("imu.standstill=30", "sensors=[uwb]"), 0),
    ],
)
def test_the_samples_are_those_of_the_imus_rate(settings: tuple[str, ...], samples: int) -> None:
    assert load_scenario("nominal_imu_uwb", settings).belief.samples_at_rest == samples
