"""Maps of the bounds: against single points computed from scratch, monotone, and infinite where nothing is seen."""

import json
import time

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from ortilo_drake.model.as_data import as_data
from ortilo_drake.model.hover import disturbance_W
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.model.vehicle import M100
from ortilo_drake.scenario import Scenario, load_scenario
from ortilo_drake.studies.arrivals.arrival_map import arrival_report, burst_map, filter_model, rate_map
from ortilo_drake.studies.command_link.command_flights import hover_V
from ortilo_drake.studies.loop.hover_loop import filter_V, hover_loop
from ortilo_drake.theory.arrivals.arrivals import pattern_probabilities
from ortilo_drake.theory.arrivals.expected_riccati import ROTATION, TRANSLATION, upper_bound, vehicle_model

H = 1.0 / 30.0
V = np.diag(np.repeat([0.05, 0.08, 0.01], 3))
SMALL_W = 1e-4 * np.eye(12)
TUNED_W = disturbance_W(M100, H, 0.27, 0.005)
RATES = np.linspace(0.0, 1.0, 21)


@pytest.mark.long
def test_the_whole_map_in_time_and_as_its_points() -> None:
    W = TUNED_W
    rate_map(vehicle_model(W, V, H), [0.0, 0.5], [0.0, 0.5])  # compiles
    start = time.process_time()
    found = rate_map(vehicle_model(W, V, H), RATES, RATES)
    assert time.process_time() - start < 40.0  # of both cores together: 20 s on two
    assert found.upper.shape == found.lower.shape == (21, 21, 12)
    assert np.all(found.lower <= found.upper * (1.0 + 1e-8))
    model = vehicle_model(W, V, H)
    for i, j in ((0, 1), (1, 0), (10, 10), (20, 0), (20, 20), (3, 17)):
        alone = np.diag(upper_bound(model, pattern_probabilities(RATES[i], RATES[j])))
        np.testing.assert_allclose(found.upper[i, j], alone, rtol=2e-9)
    for axis in (0, 1):
        ahead, behind = np.delete(found.upper, 0, axis), np.delete(found.upper, -1, axis)
        assert np.all(ahead <= behind * (1.0 + 1e-8))


def test_without_position_only_attitude_is_bounded() -> None:
    found = rate_map(vehicle_model(SMALL_W, V, H), [0.0], [0.0])
    assert np.all(np.isinf(found.upper[0, 0, TRANSLATION]))
    assert np.all(np.isinf(found.lower[0, 0, TRANSLATION]))
    model = vehicle_model(SMALL_W, V, H)
    A, C = model.A[np.ix_(ROTATION, ROTATION)], model.C[6:, ROTATION]
    P = solve_discrete_are(A.T, C.T, 1e-4 * np.eye(6), V[6:, 6:])
    np.testing.assert_allclose(found.upper[0, 0, ROTATION], np.diag(P), rtol=1e-8)


def test_bounds_meet_where_nothing_is_left_to_chance() -> None:
    found = rate_map(vehicle_model(TUNED_W, V, H), [0.0, 1.0], [1.0])
    np.testing.assert_allclose(found.upper, found.lower, rtol=1e-8)


def test_bursts_of_the_shortest_independent_kind_and_longer_ones() -> None:
    """At rate l, bursts of 1 / l ticks are independent losses; longer ones are worse, shorter ones better."""
    rate = 0.4
    independent = rate_map(vehicle_model(SMALL_W, V, H), [rate], [0.3]).upper[0, 0]
    bursts = np.array([1.51, 1.0 / rate, 5.0, 30.0, 150.0]) * H  # ticks: a bad stay lasts 1 / b, here b = rate
    found = burst_map(SMALL_W, V, H, [0.0, rate, 1.0], bursts, other_rate=0.3)
    np.testing.assert_allclose(found.upper[1, 1], independent, rtol=1e-8)
    assert np.all(np.diff(found.upper[1, :, 0]) > 0.0)
    np.testing.assert_allclose(found.upper[2, :, 0], found.upper[2, 0, 0], rtol=1e-8)
    camera_only = rate_map(vehicle_model(SMALL_W, V, H), [0.0], [0.3]).upper[0, 0]
    np.testing.assert_allclose(found.upper[0, 2], camera_only, rtol=1e-8)
    assert np.all(found.lower <= found.upper * (1.0 + 1e-8))


@pytest.mark.long
def test_neighbours_that_are_alike_settle_although_only_rounding_moves() -> None:
    """At rate 1 the length of bursts changes nothing, so each point starts at its answer."""
    found = burst_map(
        TUNED_W, np.diag(np.repeat([9e-4, 1e-2, 1e-4], 3)), H, [1.0, 0.5], np.linspace(H, 5.0, 21), other_rate=1 / 3
    )
    np.testing.assert_allclose(found.upper[0], np.tile(found.upper[0, 0], (21, 1)), rtol=1e-9)


def test_bursts_that_cannot_be_are_nan_and_without_a_sensor_inf() -> None:
    found = burst_map(SMALL_W, V, H, [0.0, 0.1], [H, 1.0], sensor="camera")
    assert np.all(np.isnan(found.upper[1, 0]))
    assert np.all(np.isfinite(found.upper[1, 1]))
    assert np.all(np.isinf(found.upper[0][:, TRANSLATION]))


def test_the_report_is_plain() -> None:
    loop = hover_loop(Scenario())._replace(W=SMALL_W)
    report = arrival_report(loop, V, [0.0, 0.5], [0.0, 0.5])
    json.dumps(as_data(report), allow_nan=False)
    assert report.upper[0][0][0] == np.inf
    assert round(report.upper[1][1][0], 6) == 0.006898
    assert report.critical_rate.rate == 0.0
    assert report.without_position_sensors == ["eigenvalue 1 (6 times) in x, y, z, x_dot, y_dot, z_dot"]


@pytest.mark.long
@pytest.mark.parametrize("name", ["imu_uwb", "imu_uwb_yolo"])
def test_a_filter_with_more_states_is_bounded_too(name: str) -> None:
    """Always everything is SciPy's DARE; at a rate between, the mean of P over random arrivals lies between."""
    scenario = load_scenario(name, ("camera.kind=projected",))
    loop, V_all = hover_loop(scenario), filter_V(scenario, hover_V(scenario))
    rates_camera = [1.0] if "camera" in scenario.sensors else [0.0]
    report = arrival_report(loop, V_all, [0.3, 1.0], rates_camera)
    model = filter_model(loop, V_all)
    rows = model.rows[3 if "camera" in scenario.sensors else 1]
    P = solve_discrete_are(model.A.T, model.C[rows].T, model.W, model.V[np.ix_(rows, rows)])
    np.testing.assert_allclose(report.upper[1, 0], np.diag(P)[:12], rtol=1e-6)
    np.testing.assert_allclose(report.lower[1, 0], np.diag(P)[:12], rtol=1e-6)
    rng, total, count = np.random.default_rng(1), np.zeros(12), 0
    for k in range(6000):
        seen = model.rows[2 * (rates_camera[0] == 1.0) + (rng.random() < 0.3)]
        H = model.C[seen]
        K = np.linalg.solve(H @ P @ H.T + model.V[np.ix_(seen, seen)], H @ P @ model.A.T).T
        P = model.A @ P @ model.A.T + model.W - K @ H @ P @ model.A.T
        P = (P + P.T) / 2.0
        if k >= 1000:
            total, count = total + np.diag(P)[:12], count + 1
    mean = total / count
    assert np.all(mean < 1.01 * report.upper[0, 0])
    assert np.all(mean > 0.99 * report.lower[0, 0])


def test_bad_input_is_refused() -> None:
    with pytest.raises(InputError, match=r"arrival rate of uwb: 1\.5"):
        rate_map(vehicle_model(SMALL_W, V, H), [1.5], [0.5])
    with pytest.raises(InputError, match=r"arrival rate of camera: -0\.5"):
        rate_map(vehicle_model(SMALL_W, V, H), [0.5], [-0.5])
    with pytest.raises(InputError, match="sensor: imu: must be uwb or camera"):
        burst_map(SMALL_W, V, H, [0.5], [1.0], sensor="imu")
    with pytest.raises(InputError, match="at least a tick"):
        burst_map(SMALL_W, V, H, [0.5], [0.01])
    with pytest.raises(InputError, match="arrival rate of the other sensor: 2"):
        burst_map(SMALL_W, V, H, [0.5], [1.0], other_rate=2.0)
