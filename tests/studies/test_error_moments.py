"""How far errors of the world move the vehicle at hover: closed forms, the frequency domain, and flights."""

from pathlib import Path

import numpy as np
import pytest

from ortilo_drake.model.hover import discretize, hover_A, hover_B_d
from ortilo_drake.model.signals import ARRIVED, PAYLOAD
from ortilo_drake.onboard.ranging.survey_bank import log_likelihood
from ortilo_drake.scenario import load_scenario
from ortilo_drake.sensors import camera
from ortilo_drake.sensors.camera_theory import likely_detections
from ortilo_drake.sensors.described import as_learned
from ortilo_drake.sensors.imu import attitude_covariance
from ortilo_drake.sensors.learned_survey import mean_log_likelihood, share_learned
from ortilo_drake.sensors.unknown_error import walk
from ortilo_drake.studies.command_link.command_flights import command_cases, command_flights, hover_V
from ortilo_drake.studies.loop.error_moments import (
    Drive,
    drive_of,
    error_inputs,
    errors_of_rows,
    left_out,
    merged_components,
    position_moments,
)
from ortilo_drake.studies.loop.hover_loop import closed_loop_matrix, filter_measurement, hover_loop, steady_predictor

PLACE = (3.0, 1.0, 1.5)
AT = np.array([*PLACE, *[0.0] * 9])  # hovering
LONG = 6000  # ticks, after which the integral has done its work
SURVEY = "truth.survey={anchors: [0.02, 0.0, 0.01], anchors_sd: 0.03}"
LASTING = ("truth.uwb={bias: 0.02, bias_sd: 0.05}", SURVEY)
FITTED = ("truth.uwb.bias=0.02", SURVEY, "uwb.errors=fitted", "uwb.fitted={white: 0.1, constants_sd: 0.05}")


@pytest.mark.family("nominal_imu_uwb_yolo-lasting0")
@pytest.mark.parametrize("lasting", [LASTING, FITTED])
@pytest.mark.parametrize("name", ["nominal_imu_uwb", "nominal_imu_uwb_yolo"])
def test_what_lasts_of_the_ranges_errors_moves_the_vehicle_as_least_squares_says(
    name: str, lasting: tuple[str, ...]
) -> None:
    # The integral takes the ranges' fix where there is one: what a camera says beside it changes nothing in the end.
    scenario = load_scenario(name, (*lasting, "camera.kind=projected"))
    to_anchors = AT[:3] - scenario.load_room().anchor_positions
    distance = np.linalg.norm(to_anchors, axis=1)
    J = to_anchors / distance[:, None]
    weights = np.diag((0.0075 * distance) ** -2.0)
    G = np.linalg.solve(J.T @ weights @ J, J.T @ weights)
    every, shifted = np.ones(len(distance)), np.array([0.02, 0.0, 0.01])
    c = np.outer(every, every) * 0.02**2 + np.eye(len(distance)) * (0.05**2 + 0.03**2)
    expected = G @ c @ G.T + np.diag(shifted**2)  # anchors that are moved move the fix
    moments = position_moments(scenario, hover_V(scenario, PLACE), error_inputs(scenario, AT), LONG)
    np.testing.assert_array_equal(moments[0], 0.0)
    np.testing.assert_allclose(moments[-1], expected, rtol=0.02, atol=1e-8)


def test_a_world_as_believed_moves_nothing() -> None:
    scenario = load_scenario("nominal_imu_uwb")
    assert not position_moments(scenario, hover_V(scenario, PLACE), error_inputs(scenario, AT), 3).any()


def test_gusts_move_the_vehicle_by_the_loops_frequency_response() -> None:
    sd, time, count = 0.3, 2.0, 4096
    settings = (f"truth.force={{gust_sd: {sd}, gust_time: {time}}}", "uwb.link.rate=null")
    scenario = load_scenario("nominal_imu_uwb", settings)
    V, loop, delta = hover_V(scenario, PLACE), hover_loop(scenario), np.array([1.0, 0.0, 1.0])
    rows = loop.measurement.by_row(delta) > 0.0
    K = np.zeros((12, 9))
    K[:, rows], _ = steady_predictor(loop.Phi, loop.C[rows], loop.W, V[np.ix_(rows, rows)])
    A = closed_loop_matrix(loop, K, delta)
    _, Gamma_d = discretize(hover_A(), hover_B_d(scenario.vehicle), scenario.h)
    B = np.vstack([Gamma_d[:, :3], np.zeros((15, 3))])
    z, keeps = np.exp(2j * np.pi * np.arange(count) / count), np.exp(-scenario.h / time)
    H = np.linalg.solve(z[:, None, None] * np.eye(27) - A, np.broadcast_to(B, (count, 27, 3)).astype(complex))[:, :3]
    spectrum = sd**2 * (1.0 - keeps**2) / np.abs(z - keeps) ** 2
    expected = np.mean(spectrum[:, None, None] * (H @ H.conj().transpose(0, 2, 1)), axis=0).real
    found = position_moments(scenario, V, error_inputs(scenario, AT), LONG)[-1]
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-9)


def test_a_camera_fix_goes_with_the_camera_and_against_the_landmarks() -> None:
    settings = ("camera.kind=projected", "truth.survey.landmarks=[0.02, 0.02, 0.02]", "truth.camera.position_sd=0.01")
    scenario = load_scenario("nominal_imu_uwb_yolo", settings)
    measurement = filter_measurement(scenario)
    rows = measurement.rows_of("camera")
    seen = [C[rows][:3] for error, C in errors_of_rows(scenario, measurement, AT) if error.sd.any()]
    landmarks, mounting = seen
    np.testing.assert_allclose(landmarks, -np.eye(3), atol=0.03)
    np.testing.assert_allclose(mounting, np.eye(3), atol=0.03)


def test_a_fix_of_landmarks_known_by_their_sizes_has_the_onboard_solvers_covariance() -> None:
    by_sizes, by_outlines = (
        load_scenario("realistic", ("camera.kind=projected", f"landmark_fix={{shapes: {its}, center_growth: 0.14}}"))
        for its in ("boxes", "outlines")
    )
    room, P = by_sizes.load_room(), np.zeros((15, 15))
    P[3:6, 3:6] = attitude_covariance(by_sizes)
    boxes = likely_detections(by_sizes, room, AT)
    onboard = camera.make_solver(by_sizes, room).fix_at(boxes, np.append(AT, np.zeros(3)), P.ravel())
    found, other = camera.covariance(by_sizes, room, AT), camera.covariance(by_outlines, room, AT)
    np.testing.assert_array_equal(np.ravel(found), onboard[PAYLOAD + 3 :])
    assert onboard[ARRIVED]
    assert np.trace(found) > 1.05 * np.trace(other)  # which is another covariance


def test_fewer_errors_have_the_same_covariance() -> None:
    rng = np.random.default_rng(2)
    sd, C = rng.uniform(0.1, 1.0, 7), np.vstack([rng.normal(size=(3, 7)), np.zeros((2, 7))])
    found = merged_components(Drive(sd, 0.5 * sd, np.full(7, 0.9), np.zeros((4, 7)), C))
    assert len(found.sd) == 3
    np.testing.assert_allclose(found.C @ np.diag(found.sd**2) @ found.C.T, C @ np.diag(sd**2) @ C.T, atol=1e-12)
    np.testing.assert_allclose(found.step_sd, 0.5 * found.sd)


def test_walks_that_begin_at_nothing_are_not_dropped() -> None:
    scenario = load_scenario("nominal_imu_uwb")
    error = walk(np.zeros(4), 0.1, {}, np.eye(12, 4))
    found = drive_of(error, np.zeros((9, 4)), hover_loop(scenario))
    np.testing.assert_array_equal(found.step_sd, np.full(4, 0.1))


def test_the_mean_likelihood_is_that_of_drawn_errors() -> None:
    rng, s, world_sd = np.random.default_rng(3), np.array([0.0, 0.02, 0.05]), 0.03
    root = rng.normal(size=(5, 5))
    Lambda = 2000.0 * root @ root.T
    likely = np.zeros((500, 3))
    for k in range(len(likely)):
        eta = Lambda @ (world_sd * rng.normal(size=5)) + np.linalg.cholesky(Lambda) @ rng.normal(size=5)
        gathered = np.column_stack([Lambda, eta])
        likely[k] = [log_likelihood(gathered, each, np.zeros((5, 5)), np.zeros(5)) for each in s]
    expected = mean_log_likelihood(s, np.linalg.eigvalsh(Lambda), world_sd)
    spread = likely.std(axis=0) / np.sqrt(len(likely))
    assert (np.abs(likely.mean(axis=0) - expected) <= 4.0 * spread + 1e-12).all()


@pytest.mark.parametrize(("world_sd", "share"), [(0.0, 0.0), (0.02, 0.4), (0.05, 1.0)])
def test_a_bank_settles_on_what_the_world_has(world_sd: float, share: float) -> None:
    found = share_learned(np.array([0.0, 0.4, 1.0]), 0.05, np.full(30, 1e5), world_sd)
    assert found == pytest.approx(share, abs=0.01)


def test_constants_that_were_fitted_are_learned_as_a_survey_is() -> None:
    fitted = load_scenario("imu_uwb", ("uwb.errors=fitted", "uwb.fitted={white: 0.05, constants_sd: 0.05}"))
    surveyed = load_scenario("imu_uwb", ("truth.survey.anchors_sd=0.05", "uwb.noise={kind: constant, sd: 0.05}"))
    learned = as_learned(fitted, AT)
    assert learned.multilateration.bias_sd == as_learned(surveyed, AT).multilateration.bias_sd > 0.0
    assert as_learned(load_scenario("imu_uwb"), AT).multilateration.bias_sd < 0.2 * learned.multilateration.bias_sd


@pytest.mark.parametrize("factor", [0.5, 1.0, 2.0])
def test_the_scale_of_the_ranges_noise_is_learned(factor: float) -> None:
    noise = f"uwb.noise={{kind: affine, sd: {0.03 * factor}, fraction: {0.002 * factor}}}"
    believed = "multilateration.noise={kind: affine, sd: 0.03, fraction: 0.002}"
    scenario = load_scenario("imu_uwb", (noise, believed))
    learned = as_learned(scenario, AT).multilateration
    np.testing.assert_allclose(learned.noise.sds, (0.03 * factor, 0.002 * factor), rtol=1e-9)
    assert learned.noise_scale is None
    assert left_out(scenario) == []
    assert left_out(load_scenario("imu_uwb", (believed,))) == ["uwb.noise"]


def test_a_filter_without_banks_learns_nothing() -> None:
    scenario = load_scenario("nominal_imu_uwb")
    assert as_learned(scenario, AT) is scenario


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "setting"),
    [
        ("realistic", None),
        ("realistic_flow", None),
        ("realistic_altimeter", None),
        ("imu_uwb", None),
        ("imu_uwb", "uwb.noise.fraction=0.015"),
        ("imu_uwb_yolo", None),
        ("datasheet_imu_uwb", None),
    ],
)
def test_flights_hover_within_15_percent_of_what_is_predicted(name: str, setting: str | None, tmp_path: Path) -> None:
    scenario = load_scenario(name, ("camera.kind=projected", *([] if setting is None else [setting])))
    flights = 200 if name == "realistic" else 60  # most of its error is along z, so that 60 tell it to 9 % alone
    (case,) = command_flights(scenario, command_cases((0.0,), ("hold",), ()), range(flights), tmp_path).cases
    assert case.lost == 0
    assert case.predicted_rms is not None
    # The offsets of that many flights tell their rms to about 6 %.
    assert case.flown_rms == pytest.approx(case.predicted_rms, rel=0.15)
