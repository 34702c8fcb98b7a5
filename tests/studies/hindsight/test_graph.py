"""The graph of whole flights: against dense least squares, beside the filters, with late messages and more sensors."""

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from ortilo_drake.model.signals import PAYLOAD, samples_in
from ortilo_drake.model.vehicle import GRAVITY
from ortilo_drake.scenario import load_scenario
from ortilo_drake.studies.hindsight.recorded_flight import RecordedFlight, fly_recorded
from ortilo_drake.studies.hindsight.rts import Smoothed, smoothed

pytest.importorskip("gtsam", reason="needs the extra 'smoother'")

from ortilo_drake.studies.hindsight.graph import FlightGraph, graph_smoothed

# Through the first blackout and out of it again.
SHORT = "planner={kind: waypoints, points: [[0, 0, 1.5], [4, 1.5, 1.5], [7, 1.5, 1.5]]}"
PLAIN = ("estimator.huber=1.0e+9", "estimator.imu.angle_density=0.00183")


def first_ticks(recorded: RecordedFlight, n: int) -> RecordedFlight:
    return RecordedFlight(recorded.scenario, recorded.flight.isel(tick=slice(0, n)), recorded.messages[:n])


def dense_positions(recorded: RecordedFlight) -> tuple[np.ndarray, np.ndarray]:
    """Return positions (n, 3) and their standard deviations by SciPy's least squares over single samples of the imu.

    Unknown are the start and each sample's noise: the motion follows from them, so nothing is preintegrated. Rates and
    specific force turn the body as a rotation vector each step, the force half way through it.
    """
    scenario, n = recorded.scenario, len(recorded.messages)
    settings, per_tick, anchors = scenario.estimator, scenario.samples("imu"), scenario.load_room().anchor_positions
    dt = scenario.h / per_tick
    its_imu, root = settings.imu, np.sqrt(dt)
    samples = np.concatenate([samples_in(its["imu"], per_tick) for its in recorded.messages[1:]])[:, PAYLOAD:]
    before = np.concatenate(([np.zeros(3)], samples[:-1, 3:6]))
    rates = 0.5 * (before + samples[:, 3:6])
    m = len(samples)
    x_0 = recorded.flight["estimate"].values[0]
    sds = np.repeat(settings.initial_sd, 3)
    ranges = [(k, i, its["uwb"][PAYLOAD + i]) for k, its in enumerate(recorded.messages) if "uwb" in its
              for i in np.flatnonzero(its["uwb"][PAYLOAD + len(anchors) :])]  # fmt: skip

    def motion(noise: np.ndarray) -> tuple[np.ndarray, list[list[Rotation]]]:
        start, its = noise[:9] * sds, noise[9:].reshape(m, 6)
        p, v = x_0[0:3] + start[0:3], x_0[6:9] + start[6:9]
        R = Rotation.from_euler("ZYX", x_0[5:2:-1]) * Rotation.from_rotvec(start[3:6])
        positions, attitudes = [p], [[R]]
        for j in range(m):
            w = rates[j] - its_imu.rate_density / root * its[j, :3]
            f = samples[j, 6:9] - its_imu.specific_force_density / root * its[j, 3:]
            a = (R * Rotation.from_rotvec(0.5 * dt * w)).apply(f) - np.array([0.0, 0.0, GRAVITY])
            p, v, R = p + dt * v + 0.5 * dt**2 * a, v + dt * a, R * Rotation.from_rotvec(dt * w)
            if j % per_tick == 0:
                attitudes.append([])
            attitudes[-1].append(R)
            if j % per_tick == per_tick - 1:
                positions.append(p)
        return np.array(positions), attitudes

    def residual(noise: np.ndarray) -> np.ndarray:
        positions, attitudes = motion(noise)
        fraction = settings.ranges.noise.fraction
        seen = [(np.linalg.norm(positions[k] - anchors[i]) - r) / (fraction * r) for k, i, r in ranges]
        angles = np.array([R.as_euler("ZYX")[::-1] for its in attitudes[1:] for R in its])
        return np.concatenate((noise, seen, ((angles - samples[:, :3]) * root / its_imu.angle_density).ravel()))

    found = least_squares(residual, np.zeros(9 + 6 * m), x_scale=1.0, xtol=1e-12, ftol=1e-12, gtol=1e-12)
    positions, _ = motion(found.x)
    covariance = np.linalg.inv(found.jac.T @ found.jac)
    step = 1e-4
    J = np.array([(motion(found.x + step * e)[0] - positions).ravel() / step for e in np.eye(len(found.x))]).T
    return positions, np.sqrt(np.diag(J @ covariance @ J.T)).reshape(n, 3)


@pytest.mark.long
def test_it_is_the_dense_problem_over_single_samples() -> None:
    """Seven ticks with two messages of ranges: the preintegrated graph against every sample's noise as an unknown."""
    wide = "estimator.initial_sd=[0.3, 0.1, 0.3]"
    scenario = load_scenario("tight_imu_uwb", (*PLAIN, wide, "uwb.link.blackouts=[]", "imu.link.rate=120"))
    recorded = first_ticks(fly_recorded(scenario.model_copy(update={"settle": 0.0}), 2), 7)
    assert sum("uwb" in its for its in recorded.messages) >= 2
    found = graph_smoothed(recorded)
    expected, sd = dense_positions(recorded)
    np.testing.assert_allclose(found.x[:, :3], expected, rtol=0.0, atol=0.01 * sd.min())
    own = np.sqrt(np.diagonal(found.P, axis1=1, axis2=2)[:, :3])
    np.testing.assert_allclose(own, sd, rtol=0.01, atol=0.0)


def error_of(x: np.ndarray, recorded: RecordedFlight) -> float:
    return float(np.mean((x[:, :3] - recorded.flight["truth"].values[:, :3]) ** 2))


@pytest.mark.long
@pytest.mark.parametrize(
    "settings",
    [
        ("tight_imu_uwb",),
        *(
            pytest.param(settings, marks=pytest.mark.long)
            for settings in (
                ("tight_imu_uwb_yolo", "camera.kind=projected"),
                ("tight_imu_uwb", "uwb.link.delay=2", "imu.link.loss=0.1"),
                ("tight_imu_uwb", "estimator.ranges.differences=true", "truth.uwb.bias=3.0"),
                ("tight_differences",),
            )
        ),
    ],
    ids=["ranges", "boxes", "late-and-lost", "differences", "packets"],
)
def test_hindsight_errs_less_than_the_tight_filter_and_knows_how_much(settings: tuple[str, ...]) -> None:
    name, *changes = settings
    before = after = nees = 0.0
    for seed in range(2):
        recorded = fly_recorded(load_scenario(name, (SHORT, *changes)), seed)
        x, P = graph_smoothed(recorded)
        before, after = before + error_of(recorded.flight["estimate"].values, recorded), after + error_of(x, recorded)
        e = x[:, :3] - recorded.flight["truth"].values[:, :3]
        nees += 0.5 * float(np.mean([e[k] @ np.linalg.solve(P[k, :3, :3], e[k]) for k in range(len(e))]))
    assert after < before
    assert nees < 12.0  # of 3: two flights' errors last for seconds and so scatter


@pytest.mark.long
def test_it_knows_more_than_the_paper_s_filter_in_hindsight() -> None:
    """Which reads neither gyroscope nor accelerometer, and fixes in place of ranges."""
    flights = [fly_recorded(load_scenario("nominal_imu_uwb", (SHORT,)), seed) for seed in range(2)]
    linear, whole = (sum(error_of(way(its).x, its) for its in flights) for way in (smoothed, graph_smoothed))
    assert whole < linear


@pytest.mark.long
def test_what_lasts_is_found_where_it_is_believed_to_last() -> None:
    """Ranges that are 0.1 m long: of a filter that estimates each anchor's bias, and of one that does not."""
    changes = (SHORT, "uwb.link.blackouts=[]", "truth.uwb.bias_sd=0.1")
    knows = (
        "estimator.ranges.bias_sd=0.1",
        "estimator.imu.accelerometer_sd=0.02",
        "estimator.imu.accelerometer_rate=1.0e-4",
    )
    blind, knowing = (fly_recorded(load_scenario("tight_imu_uwb", (*changes, *more)), 1) for more in ((), knows))
    assert error_of(graph_smoothed(knowing).x, knowing) < error_of(graph_smoothed(blind).x, blind)


@pytest.mark.long
def test_values_of_other_sensors_count() -> None:
    """A range finder that looks down, over a flight without ranges: the height is known by it alone."""
    scenario = load_scenario("altimeter", (SHORT,))
    recorded = fly_recorded(scenario, 0)
    deaf = RecordedFlight(scenario, recorded.flight, tuple({"imu": m["imu"]} for m in recorded.messages))
    flight = deaf.flight.copy(deep=True)
    flight["arrival"].loc[{"sensor": "altimeter"}] = False
    without = RecordedFlight(scenario, flight, deaf.messages)
    x, P = graph_smoothed(deaf)
    _, P_without = graph_smoothed(without)
    assert P[-1, 2, 2] < 0.01 * P_without[-1, 2, 2]
    z = x[:, 2] - recorded.flight["truth"].values[:, 2]
    assert np.sqrt(np.mean(z**2)) < 0.1


@pytest.mark.long
def test_it_begins_where_it_is_told() -> None:
    recorded = first_ticks(fly_recorded(load_scenario("tight_imu_uwb", (SHORT,)), 0), 5)
    about = Smoothed(np.ones((5, 12)) * 0.1, np.zeros((5, 12, 12)))
    far, near = FlightGraph(recorded, about).solve(), graph_smoothed(recorded)
    np.testing.assert_allclose(far.x, near.x, rtol=0.0, atol=1e-5)
