"""The covariances of fixes at a place are those that fly, and those of the textbook."""

import numpy as np
import pytest

from ortilo_drake.flight.flight import fly
from ortilo_drake.model.hover import discretize, disturbance_W, hover_A, hover_B
from ortilo_drake.scenario import Scenario, load_scenario
from ortilo_drake.sensors.imu import attitude_covariance
from ortilo_drake.studies.loop.fix_covariance import fix_noise
from ortilo_drake.studies.loop.hover_loop import steady_predictor

STILL = (
    "camera.kind=projected",
    "settle=0.0",
    "planner={kind: waypoints, points: [[0.0, 0.0, 1.5], [0.7, 0.4, 1.5]]}",
    "uwb.link.blackouts=[]",
)
AT = np.array([3.0, 1.0, 1.5, *[0.0] * 9])  # hovering


def scenario_with(*settings: str) -> Scenario:
    return load_scenario("nominal_imu_uwb_yolo", (*STILL, *settings))


@pytest.mark.long
def test_covariances_are_those_of_a_flight_without_errors() -> None:
    # Ranges and boxes without noise, and a prior for the attitude that is given: the log must agree to rounding.
    scenario = scenario_with(
        "uwb.noise={kind: constant, sd: 0.0}",
        "multilateration.noise={kind: constant, sd: 0.05}",
        "imu.angle_density=0.0",
        "world.disturbance={force_density: 0.0, torque_density: 0.0}",
        "camera.errors={kind: parametric, edge_sd: 0, miss_base: 0, miss_per_metre: 0, false_boxes: 0}",
        "camera.latency=0",
        "landmark_fix.prior_sd=[0.3, 0.02]",
    )
    flight = fly(scenario)
    checked = 0
    for k in range(0, flight.sizes["tick"], 15):
        V, there = fix_noise(scenario, flight["truth"].values[k])
        np.testing.assert_array_equal(list(there.values()), flight["arrival"].values[k])
        # The estimate that the fix is linearised at is not quite the truth: the feed-forward is that of hover.
        for s, sensor in enumerate(("uwb", "camera")):
            flown = flight["measurement_covariance"].values[k, s]
            np.testing.assert_allclose(V[sensor], flown, rtol=0.02, atol=1e-6)
            checked += int(there[sensor])
    assert checked >= 10


@pytest.mark.long
def test_covariances_are_about_those_of_a_flight_with_errors() -> None:
    scenario = scenario_with("seed=3")
    flight = fly(scenario)
    found: dict[int, list[float]] = {0: [], 1: []}
    for s, sensor, latency in ((0, "uwb", 0), (1, "camera", 1)):
        for k in np.flatnonzero(flight["arrival"].values[:, s]):
            V, there = fix_noise(scenario, flight["truth"].values[k - latency])
            flown = flight["measurement_covariance"].values[k, s]
            error = float(np.linalg.norm(V[sensor] - flown) / np.linalg.norm(flown))
            found[s].append(error if there[sensor] else np.inf)
    assert np.median(found[0]) < 0.1  # noise of the ranges is in their weights
    assert np.median(found[1]) < 0.15  # the filter's own attitude covariance is in the camera's


def test_uwb_covariance_is_the_inverse_of_the_information() -> None:
    scenario = Scenario()
    to_anchors = AT[:3] - scenario.load_room().anchor_positions
    distance = np.linalg.norm(to_anchors, axis=1)
    J = to_anchors / distance[:, None]
    expected = np.linalg.inv(J.T @ np.diag((0.0075 * distance) ** -2.0) @ J)
    V, there = fix_noise(scenario, AT)
    assert there["uwb"]
    np.testing.assert_allclose(V["uwb"], expected, rtol=1e-6)


def test_constant_V_stands_in_for_the_geometry() -> None:
    V, there = fix_noise(load_scenario("paper_imu_uwb"), AT)
    assert there["uwb"]
    np.testing.assert_array_equal(V["uwb"], 0.05 * np.eye(3))


@pytest.mark.parametrize("pose", [(21.0, -3.2, 1.5, 0.0, 0.0, 0.0), (0.0, 0.0, 1.5, 0.0, 0.0, np.pi)])
def test_no_landmark_in_sight_is_no_fix(pose: tuple[float, ...]) -> None:
    V, there = fix_noise(Scenario(), np.array([*pose, *[0.0] * 6]))
    assert not there["camera"]
    np.testing.assert_array_equal(V["camera"], np.eye(3))


def test_too_few_ranges_are_no_fix() -> None:
    assert not fix_noise(load_scenario("nominal_imu_uwb", ("uwb.max_distance=1.0",)), AT)[1]["uwb"]


def test_attitude_covariance_is_that_of_the_steady_filter() -> None:
    # Attitude and rates alone are a detectable system, whose DARE SciPy solves.
    scenario = Scenario()
    Phi, _ = discretize(hover_A(), hover_B(scenario.vehicle), scenario.h)
    W = disturbance_W(scenario.vehicle, scenario.h, 0.27, 0.005)
    part = np.ix_([3, 4, 5, 9, 10, 11], [3, 4, 5, 9, 10, 11])
    _, P = steady_predictor(Phi[part], np.eye(3, 6), W[part], 1e-4 * np.eye(3))
    np.testing.assert_allclose(attitude_covariance(scenario), P[:3, :3], rtol=1e-5, atol=1e-12)
