"""Metrics of a flight, against plain loops and closed forms on made-up flights."""

import json
from collections.abc import Callable
from dataclasses import asdict
from functools import cache

import numpy as np
import pytest
import xarray as xr
from scipy.stats import chi2

from ortilo_drake.flight.efficiency import (
    Ratio,
    efficiency,
    floor_at_ticks,
    mean_floor,
    ratio_of_means,
    tick_efficiency,
)
from ortilo_drake.flight.flight import fly, scenario_of
from ortilo_drake.flight.metrics import (
    arrival_rates,
    estimation_mse,
    fix_errors,
    nis,
    path_distance_mse,
    path_mse,
    position_nees,
    reference_distance,
    summary,
)
from ortilo_drake.flight.summary import Loss, read_summary, summary_text
from ortilo_drake.floor.cramer_rao import arrived
from ortilo_drake.scenario import load_scenario
from ortilo_drake.scenario.scenario import FORMAT

SENSORS = ["uwb", "camera", "imu"]
STATES_SEEN = {"uwb": (0, 1, 2), "camera": (0, 1, 2), "imu": (3, 4, 5)}


def made_up_flight(n: int = 60, seed: int = 0) -> xr.Dataset:
    """Return a Dataset of random numbers with random, positive definite covariances."""
    rng = np.random.default_rng(seed)

    def covariances(*shape: int) -> np.ndarray:
        A = rng.normal(size=shape)
        return A @ np.swapaxes(A, -1, -2) + 0.1 * np.eye(shape[-1])

    arrival = rng.random((n, 3)) < [0.4, 0.3, 0.9]
    innovation = np.where(np.repeat(arrival, 3, axis=1), rng.normal(size=(n, 9)), np.nan)
    return xr.Dataset(
        {
            "truth": (("tick", "state"), rng.normal(size=(n, 12))),
            "estimate": (("tick", "xbar"), rng.normal(size=(n, 15))),
            "covariance": (("tick", "xbar", "xbar_column"), covariances(n, 15, 15)),
            "reference": (("tick", "axis"), rng.normal(size=(n, 3))),
            "innovation": (("tick", "output"), innovation),
            "measurement": (("tick", "output"), 2.0 * innovation),
            "measurement_covariance": (("tick", "sensor", "row", "column"), covariances(n, 3, 3, 3)),
            "arrival": (("tick", "sensor"), arrival),
            "due": (("tick", "sensor"), np.ones((n, 3), dtype=bool)),
        },
        coords={"sensor": SENSORS},
        attrs={
            "scenario": load_scenario("nominal_imu_uwb").model_dump_json(),
            "format": FORMAT,
            "seed": 0,
            "lost": "null",
            "real_time_factor": 1.0,
        },
    )


def flight_along(reference: np.ndarray, actual: np.ndarray) -> xr.Dataset:
    flight = made_up_flight(len(reference))
    flight["reference"].values[:] = reference
    flight["truth"].values[:, :3] = actual
    return flight


def test_fix_errors_are_the_distances_of_the_fixes_that_were_used() -> None:
    n = 40
    rng = np.random.default_rng(3)
    truth, arrival = np.zeros((n, 12)), rng.random((n, 3)) < 0.5
    truth[:, :3] = rng.normal(size=(n, 3))
    off = rng.normal(size=(n, 6))
    measurement = np.full((n, 9), np.nan)
    for k in range(2):
        there = arrival[:, k]
        measurement[there, 3 * k : 3 * k + 3] = (truth[:, :3] + off[:, 3 * k : 3 * k + 3])[there]
    flight = xr.Dataset(
        {
            "truth": (("tick", "state"), truth),
            "measurement": (("tick", "output"), measurement),
            "arrival": (("tick", "sensor"), arrival),
        },
        coords={"sensor": ["uwb", "camera", "imu"]},
        attrs={"scenario": load_scenario("nominal_imu_uwb").model_dump_json(), "format": FORMAT},
    )
    found = fix_errors(flight)
    for k, sensor in enumerate(("uwb", "camera")):
        distances = sorted(np.sqrt((off[arrival[:, k], 3 * k : 3 * k + 3] ** 2).sum(axis=1)))
        middle = len(distances) // 2
        expected = distances[middle] if len(distances) % 2 else (distances[middle - 1] + distances[middle]) / 2
        assert found[sensor].median == pytest.approx(expected)
        assert distances[int(0.95 * (len(distances) - 1))] <= found[sensor].p95 <= distances[-1]
    nothing = flight.assign(arrival=(("tick", "sensor"), np.zeros((n, 3), dtype=bool)))
    assert fix_errors(nothing) == {}


def test_estimation_mse_is_the_mean_over_ticks_of_each_squared_error() -> None:
    flight = made_up_flight()
    x, xhat = flight["truth"].values, flight["estimate"].values
    expected = {a: sum((xhat[k, i] - x[k, i]) ** 2 for k in range(60)) / 60 for i, a in enumerate("xyz")}
    assert estimation_mse(flight) == pytest.approx(expected, rel=1e-12)


def test_position_nees_and_nis_equal_plain_loops() -> None:
    flight = made_up_flight()
    P, V = flight["covariance"].values, flight["measurement_covariance"].values
    for k, value in enumerate(position_nees(flight)):
        e = flight["estimate"].values[k, :3] - flight["truth"].values[k, :3]
        assert value == pytest.approx(e @ np.linalg.inv(P[k][:3, :3]) @ e, rel=1e-9)
    for s, sensor in enumerate(SENSORS):
        rows = np.flatnonzero(flight["arrival"].values[:, s])
        found = nis(flight, sensor)
        assert len(found) == len(rows) > 5
        for k, value in zip(rows, found, strict=True):
            H = np.eye(15)[list(STATES_SEEN[sensor])]
            e = flight["innovation"].values[k, 3 * s : 3 * s + 3]
            assert value == pytest.approx(e @ np.linalg.inv(H @ P[k] @ H.T + V[k, s]) @ e, rel=1e-9)


@pytest.mark.long
def test_nis_of_a_fix_that_gives_more_is_that_of_its_position(flown: Callable[..., xr.Dataset]) -> None:
    """`pose` fixes have six rows; chi-square with 3 degrees of freedom is what the position's are compared with."""
    changes = ("camera.kind=projected", "landmark_fix.method=pose", "settle=0", "planner={kind: hover, duration: 1.0}")
    flight = flown("nominal_imu_uwb_yolo", changes)
    rows = np.flatnonzero(flight["arrival"].sel(sensor="camera").values)
    P, xhat = flight["covariance"].values[:, :3, :3], flight["estimate"].values[:, :3]
    V = flight["measurement_covariance"].sel(sensor="camera").values[:, :3, :3]
    column = [f"{axis}_cam" for axis in "xyz"]
    y = np.stack([flight["measurement"].sel(output=name).values for name in column], axis=1)
    found = nis(flight, "camera")
    assert len(found) == len(rows) > 5
    for k, value in zip(rows, found, strict=True):
        e = y[k] - xhat[k]
        assert value == pytest.approx(e @ np.linalg.inv(P[k] + V[k]) @ e, rel=1e-9)


def test_nis_of_sensors_of_fewer_rows_equals_plain_loops(flown: Callable[..., xr.Dataset]) -> None:
    """An altimeter sees z, optical flow the velocities x and y; their covariances stand padded in the flight."""
    flight = flown("flow", ("settle=0", "planner={kind: hover, duration: 1.0}"))
    columns = {"altimeter": [9], "flow": [10, 11]}
    states = {"altimeter": [2], "flow": [6, 7]}
    P, y, xhat = flight["covariance"].values, flight["measurement"].values, flight["estimate"].values
    for sensor, column in columns.items():
        m, H = len(column), np.eye(15)[states[sensor]]
        V = flight["measurement_covariance"].sel(sensor=sensor).values
        assert np.isfinite(V[:, :m, :m]).all()
        assert np.isnan(V[:, m:]).all()
        assert np.isnan(V[:, :, m:]).all()
        rows = np.flatnonzero(flight["arrival"].sel(sensor=sensor).values)
        found = nis(flight, sensor)
        assert len(found) == len(rows) > 5
        for k, value in zip(rows, found, strict=True):
            e = y[k, column] - H @ xhat[k]
            np.testing.assert_allclose(flight["innovation"].values[k, column], e, rtol=1e-9)
            assert value == pytest.approx(e @ np.linalg.inv(H @ P[k] @ H.T + V[k, :m, :m]) @ e, rel=1e-9)
    assert set(fix_errors(flight)) == {"uwb"}  # of the sensors that flew, the only one that gives a position
    found = summary(flight)
    assert set(found.nis) == {"uwb", "imu", *columns}
    assert read_summary(summary_text(found)) == found


def test_nees_of_errors_drawn_from_the_covariance_is_chi_square_with_three_degrees() -> None:
    flight = made_up_flight(4000)
    rng = np.random.default_rng(5)
    P = flight["covariance"].values[:, :3, :3]
    errors = np.array([np.linalg.cholesky(block) @ rng.normal(size=3) for block in P])
    flight["estimate"].values[:, :3] = flight["truth"].values[:, :3] + errors
    nees = position_nees(flight)
    assert nees.mean() == pytest.approx(3.0, abs=4.0 * np.sqrt(6.0 / 4000))
    share = np.mean(nees > chi2.ppf(0.95, 3))
    assert share == pytest.approx(0.05, abs=4.0 * np.sqrt(0.05 * 0.95 / 4000))


def test_the_authors_path_error_of_a_sideways_offset_is_its_square() -> None:
    x = np.linspace(0.0, 20.0, 401)
    planned = np.column_stack([x, 0.05 * x**2, np.full_like(x, 1.5)])
    assert path_mse(flight_along(planned, planned + [0.0, 0.2, 0.7])) == pytest.approx(0.04, rel=1e-9)
    assert path_mse(flight_along(planned, planned)) == pytest.approx(0.0, abs=1e-24)


def test_the_authors_path_error_knows_no_time_and_no_height() -> None:
    x = np.linspace(0.0, 20.0, 401)
    planned = np.column_stack([x, np.sin(x), np.full_like(x, 1.5)])
    late = planned[np.maximum(np.arange(401) - 30, 0)] + [0.0, 0.0, 1.0]  # a second late and a metre too high
    assert path_mse(flight_along(planned, late)) == pytest.approx(0.0, abs=1e-24)


def test_the_authors_path_error_interpolates_the_planned_path_at_the_actual_x() -> None:
    x = np.linspace(0.0, 10.0, 101)
    planned = np.column_stack([x, 0.3 * x, np.full_like(x, 1.5)])
    planned = np.vstack([planned, np.tile(planned[-1], (50, 1))])  # the time to settle at the goal
    rng = np.random.default_rng(2)
    actual = planned + np.column_stack([rng.uniform(-0.5, 0.0, 151), rng.normal(0.0, 0.1, 151), np.zeros(151)])
    inside = np.clip(actual[:, 0], 0.0, 10.0)  # before its start the path has its first y
    expected = sum((y - 0.3 * at) ** 2 for y, at in zip(actual[:, 1], inside, strict=True)) / 151
    assert path_mse(flight_along(planned, actual)) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("kind", ["back", "still", "sideways"])
def test_there_is_no_authors_path_error_where_x_does_not_run_forward(kind: str) -> None:
    s = np.linspace(0.0, 1.0, 50)
    x = {"back": 1.0 - np.abs(2.0 * s - 1.0), "still": np.zeros(50), "sideways": np.zeros(50)}[kind]
    y = {"back": s, "still": np.zeros(50), "sideways": s}[kind]
    planned = np.column_stack([x, y, np.full(50, 1.5)])
    flight = flight_along(planned, planned + 0.1)
    assert np.isnan(path_mse(flight))
    assert summary(flight).path_mse is None


def test_distance_to_the_path_is_the_least_over_all_planned_points() -> None:
    flight = made_up_flight(80)
    planned, actual = flight["reference"].values, flight["truth"].values[:, :3]
    expected = np.mean([min(np.sum((p - r) ** 2) for r in planned) for p in actual])
    assert path_distance_mse(flight) == pytest.approx(expected, rel=1e-12)


def test_distance_to_a_straight_path_is_the_offset_across_it() -> None:
    s = np.linspace(0.0, 5.0, 501)
    planned = np.column_stack([0.6 * s, 0.8 * s, np.full_like(s, 1.5)])
    across = 0.3 * np.array([-0.8, 0.6, 0.0]) + [0.0, 0.0, 0.4]
    assert path_distance_mse(flight_along(planned, planned + across)) == pytest.approx(0.25, rel=1e-9)


def test_distance_to_the_reference_is_taken_tick_by_tick() -> None:
    flight = made_up_flight(20)
    planned, actual = flight["reference"].values, flight["truth"].values[:, :3]
    expected = [np.sqrt(sum((actual[k, i] - planned[k, i]) ** 2 for i in range(3))) for k in range(20)]
    np.testing.assert_allclose(reference_distance(flight), expected, rtol=1e-12)
    assert summary(flight).max_reference_distance == pytest.approx(max(expected))


def test_arrival_rates_are_fixes_used_over_ticks_due() -> None:
    flight = made_up_flight(30)
    due, arrival = np.zeros((30, 3), dtype=bool), np.zeros((30, 3), dtype=bool)
    due[::3, 0] = True
    arrival[[0, 3, 6, 12, 15, 21, 27], 0] = True
    flight["due"].values[:], flight["arrival"].values[:] = due, arrival
    assert arrival_rates(flight) == {"uwb": 0.7, "camera": None}


def test_a_sensor_that_is_due_but_never_arrives_has_rate_zero() -> None:
    flight = made_up_flight(30)
    flight["arrival"].values[:, 1] = False
    assert arrival_rates(flight)["camera"] == 0.0
    assert "camera" not in summary(flight).nis


def test_the_summary_holds_every_figure_and_is_plain_json() -> None:
    flight = made_up_flight()
    found = summary(flight)
    assert found.mse == estimation_mse(flight)
    assert found.nees == pytest.approx(np.mean(position_nees(flight)))
    assert found.nis == {s: pytest.approx(np.mean(nis(flight, s))) for s in SENSORS}
    assert found.path_distance_mse == path_distance_mse(flight)
    for axis in "xyz":
        assert found.efficiency[axis] == pytest.approx(found.mse[axis] / found.floor[axis])
    assert read_summary(summary_text(found)) == found


def test_a_diverged_flight_has_a_summary_too() -> None:
    flight = made_up_flight()
    flight["truth"].values[-1] = np.nan
    flight["estimate"].values[-2:] = np.nan
    flight.attrs["lost"] = json.dumps({"time": 2.0, "cause": "diverged"})
    found = summary(flight)
    assert "NaN" not in summary_text(found)
    assert found.lost == Loss(2.0, "diverged")


HOVER = (
    "planner.kind=hover",
    "planner.point=[1.0, 0.0, 1.5]",
    "planner.duration=6.0",
    "settle=0.0",
)
OUTAGE = "uwb.link.blackouts=[{kind: time, start: 2.5, end: 3.5}]"


@cache
def hovering(seed: int, *settings: str) -> xr.Dataset:
    return fly(load_scenario("nominal_imu_uwb", (*HOVER, OUTAGE, *settings), seed=seed))


@cache
def over_the_floor(seed: int, *settings: str) -> tuple[list[float], list[float]]:
    """Return efficiency and tick_efficiency, x, y and z."""
    flight = hovering(seed, *settings)
    floor = floor_at_ticks(flight)
    both = efficiency(estimation_mse(flight), mean_floor(floor)), tick_efficiency(flight, floor)
    return tuple([value for value in found.values() if value is not None] for found in both)  # type: ignore[return-value]


@pytest.mark.long
@pytest.mark.parametrize("tick_by_tick", [False, True])
def test_no_ensemble_beats_the_floor_and_the_tuned_filter_sits_on_it(tick_by_tick: bool) -> None:
    """The filter of 'nominal_imu_uwb' knows the world's noise, and near hover all is linear, but for z from ranges."""
    ratios = np.array([over_the_floor(seed)[tick_by_tick] for seed in range(20)])
    assert ratios.shape == (20, 3)
    se = ratios.std(axis=0, ddof=1) / np.sqrt(20)
    assert np.all(se < 0.4)
    assert np.all(ratios.mean(axis=0) > 1.0 - 3.5 * se)
    assert np.all(ratios.mean(axis=0) < 1.2 + 3.5 * se)


@pytest.mark.long
def test_the_papers_filter_is_well_above_the_floor() -> None:
    papers = (
        "estimator.W={kind: diagonal, position: 1.0, angle: 1.0, velocity: 1.0, rate: 1.0}",
        "estimator.V={uwb: [0.05, 0.05, 0.05], imu: [0.01, 0.01, 0.01]}",
        "servo.velocities=truth",
    )
    found = np.array([over_the_floor(seed, *papers) for seed in range(5)])
    assert found.shape == (5, 2, 3)
    assert np.all(found.mean(axis=0) > 2.0)


def test_the_filters_own_covariance_meets_the_floor_where_it_knows_everything() -> None:
    small = ("uwb.noise.fraction=0.002", "multilateration.noise.fraction=0.002")
    flight = hovering(0, "estimator.initial_sd=[1.0e-6, 1.0e-6, 1.0e-6, 1.0e-6]", *small)
    floor, P = floor_at_ticks(flight), np.diagonal(flight["covariance"].values, axis1=1, axis2=2)[:, :3]
    assert floor is not None
    # It takes a fix's covariance from the measured place, not the true one, hence the small noise.
    np.testing.assert_allclose(P, floor, rtol=0.03, atol=1e-8)


@pytest.mark.family("{kind: bernoulli, probability: 0.4}")
@pytest.mark.parametrize(
    "loss", ["{kind: gilbert_elliott, good_to_bad: 0.2, bad_to_good: 0.2}", "{kind: bernoulli, probability: 0.4}"]
)
def test_arrivals_made_again_from_the_truth_are_those_of_the_flight(loss: str) -> None:
    flight = hovering(3, f"uwb.link.loss={loss}", f"imu.link.loss={loss}")
    truth = flight["truth"].values
    for sensor in ("uwb", "camera", "imu"):
        expected = flight["arrival"].sel(sensor=sensor).values
        np.testing.assert_array_equal(arrived(scenario_of(flight), sensor, truth), expected)
    assert 0.3 < flight["arrival"].sel(sensor="imu").values.mean() < 0.9


def test_arrivals_by_position_are_made_again_and_late_ones_count_where_they_were_true() -> None:
    blackout = "uwb.link.blackouts=[{kind: position, axis: x, start: 0.99, end: 1.01}]"
    flight = fly(load_scenario("nominal_imu_uwb", (*HOVER, blackout, "uwb.link.delay=2"), seed=1))
    used = flight["arrival"].sel(sensor="uwb").values
    seen = arrived(scenario_of(flight), "uwb", flight["truth"].values)
    assert 3 < used.sum() < 55
    np.testing.assert_array_equal(seen[:-2], used[2:])


def test_a_summary_holds_floor_and_efficiency_of_its_flight() -> None:
    flight = hovering(0)
    found = summary(flight)
    floor = floor_at_ticks(flight)
    assert floor is not None
    assert found.floor == mean_floor(floor) == pytest.approx(dict(zip("xyz", floor.mean(axis=0), strict=True)))
    e = flight["estimate"].values[:, :3] - flight["truth"].values[:, :3]
    for i, axis in enumerate("xyz"):
        assert found.efficiency[axis] == pytest.approx(found.mse[axis] / found.floor[axis])
        ratios = [e[k, i] ** 2 / floor[k, i] for k in range(60, len(e))]  # after 2 s
        assert found.tick_efficiency[axis] == pytest.approx(sum(ratios) / len(ratios))
    json.dumps(asdict(found), allow_nan=False)


def test_without_disturbance_nothing_is_uncertain_and_there_is_no_efficiency() -> None:
    flight = hovering(0, "world.disturbance.force_density=0.0", "world.disturbance.torque_density=0.0")
    found = summary(flight)
    assert found.floor == {"x": 0.0, "y": 0.0, "z": 0.0}
    assert found.efficiency == found.tick_efficiency == {"x": None, "y": None, "z": None}


def test_an_unknown_floor_has_no_efficiency() -> None:
    assert mean_floor(None) is None
    assert tick_efficiency(hovering(0), None) == {"x": None, "y": None, "z": None}
    assert efficiency({"x": 1.0, "y": 2.0}, None) == {"x": None, "y": None}
    assert efficiency({"x": 1.0, "y": 2.0}, {"x": 0.5, "y": 0.0}) == {"x": 2.0, "y": None}


def test_the_ratio_of_means_draws_whole_flights() -> None:
    rng = np.random.default_rng(2)
    floors = rng.gamma(3.0, 0.01, 20)
    errors = floors * rng.gamma(3.0, 0.5, 20)
    found = ratio_of_means(errors.tolist(), floors.tolist())
    assert found.value == pytest.approx(errors.mean() / floors.mean())
    picks = rng.integers(0, 20, (4000, 20))
    drawn = errors[picks].sum(axis=1) / floors[picks].sum(axis=1)
    np.testing.assert_allclose(found.interval, np.quantile(drawn, [0.025, 0.975]), atol=4.0 * 0.042 * drawn.std())
    assert ratio_of_means([], []) == Ratio(None, None)
    assert ratio_of_means([1.0], [2.0]) == Ratio(0.5, None)
    assert ratio_of_means([1.0, 1.0], [0.0, 0.0]) == Ratio(None, None)
