"""The likelihood against SciPy's multivariate normal; the fit against data whose noise is known."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from ortilo_drake.model.hover import discretize, disturbance_W, hover_A, hover_B, output_C
from ortilo_drake.model.measurement import make_measurement
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.model.vehicle import GRAVITY
from ortilo_drake.onboard.estimator.intermittent_filter import INTEGRATOR_ESTIMATE, FilterModel, filter_step
from ortilo_drake.scenario import Scenario
from ortilo_drake.studies.tuning import fit_noise as module
from ortilo_drake.studies.tuning.fit_noise import fit_noise, near_hover
from ortilo_drake.studies.tuning.noise_likelihood import Record, log_likelihood, refilter
from ortilo_drake.studies.tuning.noise_settings import noise_model, noise_numbers, with_numbers

TRUE = Scenario(sensors=("uwb", "imu"))
PHI, GAMMA = discretize(hover_A(), hover_B(TRUE.vehicle), TRUE.h)
UWB = np.array([[0.004, 0.001, 0.0], [0.001, 0.003, 0.0005], [0.0, 0.0005, 0.006]])


def simulate(rng: np.random.Generator, ticks: int, camera: bool = False, doublet: float = 0.0) -> Record:
    """Return a record of the linear model with the noise of TRUE, held level, UWB at a third of the ticks.

    A doublet of pitching torque [N m] tilts the vehicle from tick 100 to 140, and tilted it loses lift.
    """
    W = disturbance_W(TRUE.vehicle, TRUE.h, 0.27, 0.005)
    P_0 = np.diag(np.repeat([0.05, 0.02, 0.05, 0.05], 3) ** 2)
    V2 = np.broadcast_to(np.array([UWB, 2.0 * UWB, 1e-4 * np.eye(3)]), (ticks, 3, 3, 3)).copy()
    delta = np.ones((ticks, 3))
    delta[:, 0] = rng.random(ticks) < 0.33
    delta[:, 1] = (rng.random(ticks) < 0.33) * camera
    x = rng.multivariate_normal(np.zeros(12), P_0)
    y, u, w = np.zeros((ticks, 9)), rng.normal(size=(ticks, 4)) * [0.1, 1e-3, 1e-3, 1e-3], np.linalg.svd(W)
    if doublet > 0.0:
        u[100:140, 2] += doublet * np.repeat([1.0, -1.0, -1.0, 1.0], 10)
    root = w[0] * np.sqrt(w[1])
    for k in range(ticks):
        v = np.concatenate([np.linalg.cholesky(V2[k, s]) @ rng.normal(size=3) for s in range(3)])
        y[k] = (output_C() @ x + v) * np.repeat(delta[k], 3)
        u[k, 1:] -= np.array(TRUE.vehicle.inertia) * (9.0 * x[3:6] + 6.0 * x[9:12])
        lift_lost = GRAVITY * (1.0 - np.cos(x[3]) * np.cos(x[4])) * (doublet > 0.0)
        x = PHI @ x + GAMMA @ u[k] + root @ rng.normal(size=12)
        x[2] -= 0.5 * TRUE.h**2 * lift_lost
        x[8] -= TRUE.h * lift_lost
    return Record(y, delta, V2, u, np.zeros(12), P_0, make_measurement().layout)


@pytest.mark.parametrize("counted", [("uwb", "camera", "imu"), ("uwb", "imu")])
def test_the_likelihood_is_the_joint_normal_density(counted: tuple[str, ...]) -> None:
    record = simulate(np.random.default_rng(1), 6, camera=True)
    scenario = Scenario()
    noise = noise_model(scenario, scenario, counted)
    # All measurements of all ticks as one linear function of x_0, the w_k and the v_k.
    H = [output_C()[np.repeat(d, 3) > 0] for d in record.delta]
    means, maps, x, F = [], [], np.zeros(12), np.eye(12)
    carried = [F]
    for k in range(6):
        means.append(H[k] @ x)
        maps.append(np.hstack([H[k] @ c for c in carried] + [np.zeros((len(H[k]), 12))] * (6 - len(carried))))
        x = PHI @ x + GAMMA @ record.u[k]
        carried = [PHI @ c for c in carried] + [np.eye(12)]
    prior = np.zeros((72, 72))
    prior[:12, :12] = record.P_0
    for k in range(1, 6):
        prior[12 * k : 12 * k + 12, 12 * k : 12 * k + 12] = noise.W
    M, mean = np.vstack(maps), np.concatenate(means)
    covariance = M @ prior @ M.T
    y = np.concatenate([record.y[k][np.repeat(record.delta[k], 3) > 0] for k in range(6)])
    tick, sensor, row = [], [], 0
    for k in range(6):
        for s in np.flatnonzero(record.delta[k]):
            covariance[row : row + 3, row : row + 3] += record.V2[k, s] if s < 2 else 1e-4 * np.eye(3)
            tick += [k] * 3
            sensor += [("uwb", "camera", "imu")[s]] * 3
            row += 3
    ticks, is_counted = np.array(tick), np.isin(sensor, counted)
    expected = 0.0  # by the chain rule, log p(counted y_k, all y before) - log p(all y before)
    for k in range(6):
        past = ticks < k
        both = past | ((ticks == k) & is_counted)
        for rows, sign in ((both, 1.0), (past, -1.0)):
            if rows.any():
                density = multivariate_normal(mean[rows], covariance[np.ix_(rows, rows)])
                expected += sign * density.logpdf(y[rows])
    assert log_likelihood(record, noise, PHI, GAMMA, np.ones(6, dtype=bool)) == pytest.approx(expected, rel=1e-8)


def test_it_is_the_flying_filter() -> None:
    record = simulate(np.random.default_rng(2), 300, camera=True)
    noise = noise_model(Scenario(), Scenario())
    xhat, P = refilter(record, noise, PHI, GAMMA)
    x, Pbar = np.zeros(15), np.zeros((15, 15))
    Pbar[:12, :12] = record.P_0
    for k in range(300):
        np.testing.assert_allclose(xhat[k], x[:12], atol=1e-11)
        np.testing.assert_allclose(P[k], Pbar[:12, :12], atol=1e-12)
        given = record.y[k], record.delta[k], record.V2[k].ravel(), record.u[k], np.zeros(9)
        model = FilterModel.of(PHI, GAMMA, noise.W, INTEGRATOR_ESTIMATE)
        out = filter_step(np.concatenate([x, Pbar.ravel()]), *given, model, record.layout)
        x, Pbar = out[:15], out[15:].reshape(15, 15)


@pytest.mark.long
def test_the_known_noise_is_found_within_its_errors() -> None:
    rng = np.random.default_rng(3)
    records = [simulate(rng, 450) for _ in range(8)]
    wrong = with_numbers(
        TRUE,
        {
            "estimator.W.force_density": 0.00986,
            "estimator.W.torque_density": 0.00456,
            "multilateration.noise.fraction": 0.03,
            "estimator.V.imu.0": 2.5e-3,
        },
    )
    fit = fit_noise(wrong, records, 0)
    # The record's UWB covariance is true, so the fraction that leaves it alone is the wrong one itself.
    true = noise_numbers(TRUE) | {"multilateration.noise.fraction": 0.03}
    z = np.array([(fit.numbers[name].after - true[name]) / fit.numbers[name].standard_error for name in true])
    assert not any(number.stays for number in fit.numbers.values())
    assert np.max(np.abs(z)) < 3.5
    assert fit.log_likelihood.after > fit.log_likelihood.before
    for name, number in fit.numbers.items():
        assert 0.3 < number.robust_error / number.standard_error < 3.0, name


@pytest.mark.long
def test_a_tilt_is_not_taken_for_a_disturbance(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(7)
    records = [simulate(rng, 320, doublet=1.0) for _ in range(8)]
    fit = fit_noise(TRUE, records, 90)
    name = "estimator.W.force_density"
    true = noise_numbers(TRUE)[name]
    assert abs(fit.numbers[name].after - true) < 3.0 * fit.numbers[name].standard_error
    # Of the 230 ticks after the start those of the tilt, some 60 at most, and the 90 after it.
    assert 90 / 230 < fit.tilted < 150 / 230
    monkeypatch.setattr(module, "LIFT_LOST", 2.0)  # no tilt loses that much
    naive = fit_noise(TRUE, records, 90)
    assert naive.tilted == 0.0
    assert naive.numbers[name].after - true > 3.0 * naive.numbers[name].standard_error


def test_near_hover_is_that_long_after_any_tilt() -> None:
    xhat = np.zeros((12, 12))
    xhat[5, 3] = xhat[5, 4] = 0.12  # each within 0.141 rad, where 1 % of the lift is lost, but not both together
    xhat[9, 3] = -0.14
    assert near_hover(xhat, 0).tolist() == [True] * 5 + [False] + [True] * 6
    assert near_hover(xhat, 2).tolist() == [False] * 2 + [True] * 3 + [False] * 3 + [True] * 4


def test_a_flight_that_is_never_near_hover_is_refused() -> None:
    record = simulate(np.random.default_rng(8), 60)
    with pytest.raises(InputError, match=r"near hover \(less than 1% of the lift lost to tilt for 2\.0 s\)"):
        fit_noise(TRUE, [record], 60)


@pytest.mark.long
def test_a_sensor_that_never_arrived_keeps_its_noise() -> None:
    records = [simulate(np.random.default_rng(4), 400) for _ in range(2)]
    fit = fit_noise(Scenario(), records, 0)
    assert fit.numbers["landmark_fix.center_sd"].stays == "camera never arrived"
    assert fit.scenario.landmark_fix.center_sd == Scenario().landmark_fix.center_sd


@pytest.mark.long
def test_a_disturbance_of_which_nothing_shows_stays() -> None:
    record = simulate(np.random.default_rng(5), 120)
    record.delta[:, 0] = 0.0  # angles alone say nothing of a force
    fit = fit_noise(TRUE, [record], 0)
    assert {name for name, number in fit.numbers.items() if number.stays} >= {
        "estimator.W.force_density",
        "multilateration.noise.fraction",
    }
    assert fit.numbers["estimator.W.force_density"].after == pytest.approx(0.27 * np.sqrt(TRUE.h), rel=1e-15)


def test_nothing_arrived() -> None:
    record = simulate(np.random.default_rng(6), 50)
    record.delta[:] = 0.0
    with pytest.raises(InputError, match="no measurement arrived"):
        fit_noise(TRUE, [record], 0)


def test_numbers_go_into_the_scenario_and_back() -> None:
    numbers = {name: 1.25 * value for name, value in noise_numbers(Scenario()).items()}
    assert noise_numbers(with_numbers(Scenario(), numbers)) == numbers
