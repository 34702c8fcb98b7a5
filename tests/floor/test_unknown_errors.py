"""What a truth leaves unknown, in the Cramer-Rao floor: against dense algebra that writes every unknown out."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from ortilo_drake.flight.efficiency import floor_at_ticks
from ortilo_drake.flight.flight import FlightSimulator
from ortilo_drake.floor.cramer_rao import arrived, state_bound
from ortilo_drake.floor.unknown_errors import unknown_errors
from ortilo_drake.model.hover import discretize, hover_A, hover_B_d
from ortilo_drake.model.vehicle import GRAVITY
from ortilo_drake.model.white_noise import USUAL_ROOT
from ortilo_drake.scenario import load_scenario
from ortilo_drake.sensors.information_camera import camera_rows, camera_tables
from ortilo_drake.sensors.information_rows import GRADIENT, SOURCE, TICK

TICKS = 24
TRUTH = (
    "truth.vehicle={mass_factor: 1.03, thrust_factor_sd: 0.02, center_of_gravity: [0.004, 0.0], "
    "center_of_gravity_sd: 0.003}",
    "truth.force={mean: [0.06, 0.0, 0.0], mean_sd: 0.08, gust_sd: 0.05, gust_time: 0.7}",
    "truth.imu={level: [0.004, -0.004], level_walk: 0.001, yaw_sd: 0.02, yaw_walk: 0.002, rates_sd: 0.001, "
    "rates_walk: 0.0005, specific_force_sd: 0.05, specific_force_walk: 0.02}",
    "truth.uwb={bias: 0.02, bias_sd: 0.05, slow_sd: 0.035, slow_time: 0.4}",
    "truth.survey={anchors: [0.02, 0.0, 0.01], anchors_sd: 0.03}",
    "truth.start={position: [0.2, -0.2, 0.1], yaw_sd: 0.09}",
)
NOISE = (
    f"imu.angle_density={0.01 * USUAL_ROOT}",
    f"imu.rate_density={0.002 * USUAL_ROOT}",
    f"imu.specific_force_density={0.05 * USUAL_ROOT}",
)
FLYING = "imu.standstill=0"  # nothing was zeroed before take-off


def along(ticks: int) -> np.ndarray:
    truth = np.zeros((ticks, 12))
    truth[:, :3] = [8.0, 1.0, 1.5] + np.linspace(0.0, 1.0, ticks)[:, None] * np.array([1.0, 0.4, -0.2])
    return truth


class Unknowns:
    """Independent standard normal unknowns, numbered as they come."""

    def __init__(self) -> None:
        self.count = 0

    def new(self, *sd: float) -> Any:
        """Return an unknown of each sd as a function of how many there are in the end: rows (len(sd), count)."""
        first, self.count = self.count, self.count + len(sd)
        return [(first + i, s) for i, s in enumerate(sd)]


def dense(parts: list[list[tuple[int, float]]], count: int) -> np.ndarray:
    """Return the sum of unknowns as a matrix (e, count)."""
    found = np.zeros((len(parts[0]), count))
    for part in parts:
        for i, (number, s) in enumerate(part):
            found[i, number] += s
    return found


DATASHEET = (
    "world.drag=[0.5, 1.5, 0.2]",
    "uwb.round=0.2",
    "imu.ahrs={time: 0.4, drift_sd: 0.05}",
)


@pytest.mark.family
@pytest.mark.parametrize("more", [(), DATASHEET], ids=["", "as data sheets have it"])
def test_it_equals_dense_algebra_in_which_every_error_and_every_force_is_an_unknown(more: tuple[str, ...]) -> None:
    """No trick of the floor's: the specific force is a row of the step's force and its bias, all walks are summed.

    Drag is part of that force, ranges of a round are of where the vehicle was, and an attitude filter is drawn to the
    direction of the specific force.
    """
    scenario, truth = load_scenario("imu_uwb", (*TRUTH, *NOISE, FLYING, *more)), along(TICKS)
    bound = state_bound(scenario, truth)
    assert bound is not None
    room, h, m = scenario.load_room(), scenario.h, scenario.vehicle.mass
    anchors, disturbance = room.anchor_positions, scenario.world.disturbance
    Phi, _ = discretize(hover_A(), np.zeros((12, 4)), h)
    _, Gamma_d = discretize(hover_A(), hover_B_d(scenario.vehicle), h)
    n, unknown = len(anchors), Unknowns()

    def process(sds: list[float], walk: list[float] | None = None, time: float | None = None) -> list[Any]:
        """Return a process at every tick: a walk of those steps after 1 s, or Gauss-Markov noise, stationary."""
        at = [[unknown.new(*sds)]]
        keeps = 1.0 if time is None else np.exp(-h / time)
        for _ in range(TICKS - 1):
            step = [w * np.sqrt(h) for w in walk] if walk else [s * np.sqrt(1.0 - keeps**2) for s in sds]
            kept = [[(i, s * keeps) for i, s in part] for part in at[-1]]
            at.append([*kept, unknown.new(*step)] if any(step) else kept)
        return at

    x_0 = unknown.new(0.2, 0.2, 0.1, 0.0, 0.0, 0.09)
    weight = m * GRAVITY
    d = process([np.hypot(0.06, 0.08), 0.08, np.sqrt(0.08**2 + (0.03 * weight) ** 2 + (0.02 * weight) ** 2)])
    gust = process([0.05] * 3, time=0.7)
    torque = process([weight * 0.003, weight * 0.005])
    b_a = process([0.05] * 3, walk=[0.02] * 3)
    b_angle = process([0.004, 0.004, 0.02], walk=[0.001, 0.001, 0.002])
    b_rate = process([0.001] * 3, walk=[0.0005] * 3)
    common, own = process([0.02]), process([0.05] * n)
    slow, shift, survey = process([0.035] * n, time=0.4), process([0.02, 0.0, 0.01]), process([0.03] * (3 * n))
    w = [unknown.new(*np.repeat(disturbance.sds(h), 3)) for _ in range(TICKS)]
    ahrs, D = scenario.imu.ahrs, np.diag(scenario.world.drag)
    drift = unknown.new(ahrs.drift_sd if ahrs else 0.0)
    size, there = unknown.count, arrived(scenario, "uwb", truth)
    ages = scenario.uwb.round * (n - 1.0 - np.arange(n)) / n
    assert there.sum() > 5

    x, J = np.zeros((12, size)), np.eye(size)
    x[:6], off = dense([x_0], size), np.zeros((3, size))
    for k in range(TICKS):
        expected = x @ np.linalg.solve(J, x.T)
        scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected))) + 1e-30
        np.testing.assert_allclose(bound[k] / scale, expected / scale, atol=1e-7)
        force = dense([*d[k], *gust[k], w[k][:3]], size) - D @ x[6:9]
        rows = [(x[3:6] + dense(b_angle[k], size) + off, 0.01), (x[9:] + dense(b_rate[k], size), 0.002)]
        rows.append((force / m + dense(b_a[k], size), 0.05))
        distance = np.linalg.norm(truth[k, :3] - anchors, axis=1)
        u = (truth[k, :3] - anchors) / distance[:, None]
        ranges = u @ x[:3] - ages[:, None] * (u @ x[6:9])
        ranges += dense(common[k], size) + dense(own[k], size) + dense(slow[k], size)
        ranges -= u @ dense(shift[k], size)
        ranges -= np.einsum("ai,ain->an", u, dense(survey[k], size).reshape(n, 3, size))
        fraction = scenario.uwb.noise.fraction
        if there[k]:
            rows.append((ranges, fraction * distance[:, None] / np.sqrt(1.0 + 2.0 * fraction**2)))
        for row, sd in rows:
            scaled = row / sd
            J += scaled.T @ scaled
        moment = dense([*torque[k]], size)
        v = x[6:9]
        x = Phi @ x + Gamma_d[:, :3] @ force + Gamma_d[:, 3:] @ dense([w[k][3:]], size) + Gamma_d[:, 3:5] @ moment
        if ahrs:  # roll and pitch go to those of g e_z + acceleration, the yaw turns
            a, c = np.exp(-h / ahrs.time), (x[6:9] - v) / h
            off = np.vstack([a * off[0] + (1.0 - a) * c[1] / GRAVITY, a * off[1] - (1.0 - a) * c[0] / GRAVITY, off[2]])
            off[2] += h * dense([drift], size)[0]


@pytest.mark.long
@settings(max_examples=15)
@given(entry=st.sampled_from(TRUTH), share=st.floats(0.1, 0.9))
def test_one_error_more_never_lowers_the_floor(entry: str, share: float) -> None:
    truth = along(40)
    known = state_bound(load_scenario("imu_uwb"), truth)
    all_but = state_bound(load_scenario("imu_uwb", tuple(other for other in TRUTH if other != entry)), truth)
    every = state_bound(load_scenario("imu_uwb", TRUTH), truth)
    assert known is not None
    assert all_but is not None
    assert every is not None
    k = round(share * 39)
    assert np.linalg.eigvalsh(every[k] - all_but[k]).min() > -1e-9 * np.abs(every[k]).max()
    assert np.linalg.eigvalsh(all_but[k] - known[k]).min() > -1e-9 * np.abs(every[k]).max()


@pytest.mark.parametrize("entry", ["survey.landmarks", "survey.landmarks_sd", "camera.position", "camera.angles"])
def test_boxes_see_a_moved_landmark_or_camera_as_projections_do(entry: str) -> None:
    value = "0.01" if entry.endswith("_sd") else "[0.01, 0.01, 0.01]"
    scenario = load_scenario("imu_uwb_yolo", ("camera.kind=projected", FLYING, f"truth.{entry}={value}"))
    room, truth = scenario.load_room(), along(1)
    tables = camera_tables(scenario, room)
    assert tables is not None
    rows = camera_rows(tables, room, 320, truth, np.ones(1, dtype=bool))
    assert len(rows) > 4
    found = unknown_errors(scenario, room, 0.0).sees["camera"](rows)
    camera = room.camera.scaled_to(320)

    def center(i: int, axis: int, landmark: np.ndarray, position: np.ndarray, angles: np.ndarray) -> float:
        R = Rotation.from_euler("ZYX", angles[::-1]).as_matrix()
        points = room.landmark_positions[i] + landmark + room.landmark_outlines[i]
        q = (points - truth[0, :3] - position - np.array(camera.position)) @ R  # turned about its own centre
        seen = camera.center[axis] - camera.focal_length * q[:, 1 + axis] / q[:, 0]
        return float(seen.min() + seen.max()) / 2.0

    which = {"survey.landmarks": 0, "survey.landmarks_sd": 0, "camera.position": 1, "camera.angles": 2}[entry]
    for row, coefficients in zip(rows, found, strict=True):
        i, axis = divmod(int(row[SOURCE]), 2)
        numeric = []
        for e in 1e-6 * np.eye(3):
            moves = [np.zeros(3), np.zeros(3), np.zeros(3)]
            moves[which] = e
            back = [-move for move in moves]
            numeric.append((center(i, axis, *moves) - center(i, axis, *back)) / 2e-6)
        expected = np.zeros(found.shape[1])
        first = 3 * i if entry.endswith("_sd") else 0
        expected[first : first + 3] = numeric
        np.testing.assert_allclose(coefficients, expected, rtol=1e-4, atol=2e-2)


def test_nothing_unknown_adds_nothing() -> None:
    scenario = load_scenario("imu_uwb_yolo", ("camera.kind=projected", FLYING))
    errors = unknown_errors(scenario, scenario.load_room(), 0.5)
    assert errors.sd.size == 0
    assert errors.G.shape == (12, 0)


def test_of_biases_that_were_zeroed_at_rest_the_mean_noise_is_left() -> None:
    """60 samples of a level imu; what it drew is gone, and gravity stands as its angles say on average."""
    biases = "truth.imu={rates_sd: 0.1, specific_force_sd: 0.3}"
    scenario = load_scenario("imu_uwb", (biases, "imu.standstill=2", "imu.link.rate=30"))
    errors, imu = unknown_errors(scenario, scenario.load_room(), 0.0), scenario.imu
    turned = np.hypot(imu.specific_force_density, GRAVITY * imu.angle_density)
    left = np.array([turned, turned, imu.specific_force_density, *[imu.rate_density] * 3]) / np.sqrt(2.0)  # over 2 s
    np.testing.assert_allclose(errors.sd, left, rtol=1e-12)


def test_a_registered_sensor_errs_as_the_filter_believes() -> None:
    scenario = load_scenario("realistic_altimeter")
    errors = unknown_errors(scenario, scenario.load_room(), 0.0)
    rows = np.zeros((1, 17))
    rows[0, TICK], rows[0, GRADIENT] = 3.0, np.eye(12)[2]
    (column,) = np.flatnonzero(errors.sees["altimeter"](rows)[0])
    assert errors.sd[column] == 0.025


@pytest.mark.long
@pytest.mark.parametrize("name", ["realistic_flow", "realistic_altimeter"])
def test_no_ensemble_of_realistic_flights_beats_the_floor(name: str) -> None:
    hover = ("planner.kind=hover", "planner.point=[8.0, 1.0, 1.5]", "planner.duration=5.0", "settle=0.0")
    simulator, ratios = FlightSimulator(load_scenario(name, hover)), []
    for seed in range(16):
        flight = simulator.fly(seed)
        floor = floor_at_ticks(flight)
        assert floor is not None
        e2 = (flight["estimate"].values[60:, :3] - flight["truth"].values[60:, :3]) ** 2
        ratios.append(e2.mean(axis=0) / floor[60:].mean(axis=0))
    mean, se = np.mean(ratios, axis=0), np.std(ratios, axis=0, ddof=1) / 4.0
    assert np.all(mean > 1.0 - 3.5 * se)
    assert np.all(mean < 40.0)
