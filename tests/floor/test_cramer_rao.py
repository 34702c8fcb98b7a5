"""The Cramer-Rao floor against dense algebra over whole trajectories, numerical scores, and a filter that knows all."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba import njit
from scipy.interpolate import PchipInterpolator
from scipy.linalg import solve_discrete_are
from scipy.spatial.transform import Rotation
from scipy.stats import norm

from ortilo_drake.floor.cramer_rao import arrived, position_floor, state_bound
from ortilo_drake.floor.information_filter import predicted_bound
from ortilo_drake.model.hover import discretize, disturbance_W, hover_A, hover_B, hover_B_d
from ortilo_drake.model.room import Room
from ortilo_drake.model.vehicle import M100
from ortilo_drake.model.white_noise import USUAL_ROOT
from ortilo_drake.scenario import Scenario, Uwb, load_scenario
from ortilo_drake.scenario.camera import MeasuredErrors
from ortilo_drake.sensors.information_camera import camera_rows, camera_tables, center_errors
from ortilo_drake.sensors.information_rows import (
    AMPLITUDE,
    GRADIENT,
    ROW_SIZE,
    SLOW,
    VARIANCE,
    by_tick,
    information,
    rows_of,
)
from ortilo_drake.sensors.information_uwb import range_rows
from ortilo_drake.world.noise import persistent_normals, stream_id
from ortilo_drake.world.sensors.camera_calibration import load_calibration
from ortilo_drake.world.sensors.uwb import receiver_of, uwb_message

H = 1.0 / 30.0
FORCE, TORQUE = 0.27, 0.005
PHI, _ = discretize(hover_A(), hover_B(M100), H)
_, GAMMA_D = discretize(hover_A(), hover_B_d(M100), H)
B = GAMMA_D * np.repeat([FORCE, TORQUE], 3)  # x_{k+1} = Phi x_k + B d_k, d_k standard normal
W = disturbance_W(M100, H, FORCE, TORQUE)
NOTHING = np.zeros((12, 12))
ROOM = load_scenario("nominal_imu_uwb").load_room()
COMPARED = [0, 1, 8, 15, 27]  # ticks


def angle_rows(seen: np.ndarray, sd: float) -> np.ndarray:
    """Return the rows of an IMU's three angles, of that sd [rad], in the ticks where it is seen (n)."""
    ticks = np.repeat(np.flatnonzero(seen), 3)
    return rows_of(ticks, np.tile(np.eye(12)[3:6], (len(ticks) // 3, 1)), np.full(len(ticks), sd**2))


def random_rows(rng: np.random.Generator, ticks: int, count: int, slow: int = 0) -> np.ndarray:
    """Return rows at random ticks, some with one of that many slow errors in them."""
    rows = rows_of(
        rng.integers(0, ticks, count),
        rng.normal(size=(count, 12)),
        rng.uniform(1e-4, 1e-2, count),
    )
    rows[:, SLOW] = rng.integers(-1, slow, count) if slow else -1.0
    rows[:, AMPLITUDE] = np.where(rows[:, SLOW] >= 0, rng.uniform(0.01, 0.1, count), 0.0)
    return by_tick(rows)


def dense_bound(rows: np.ndarray, ticks: int, spacing: int, slow: int, P_0: np.ndarray) -> np.ndarray:
    """Return the bounds COMPARED by one information matrix over all that is random: x_0, every d_k, every node."""
    nodes = (ticks - 1) // spacing + 2
    root = np.linalg.cholesky(P_0 + 1e-300 * np.eye(12)) if P_0.any() else NOTHING
    size = 12 + 6 * ticks + slow * nodes
    A = np.zeros((ticks, 12, size))  # x_k = A_k theta, theta standard normal
    A[0, :, :12] = root
    for k in range(1, ticks):
        A[k] = PHI @ A[k - 1]
        A[k, :, 12 + 6 * (k - 1) : 12 + 6 * k] += B
    J, bounds, at = np.eye(size), [], 0
    for k in range(ticks):
        if k in COMPARED:
            bounds.append(A[k] @ np.linalg.solve(J, A[k].T))
        for row in rows[rows[:, 0] == k]:
            h = row[GRADIENT] @ A[k]
            if row[SLOW] >= 0:
                a = (k % spacing) / spacing
                first = 12 + 6 * ticks + int(row[SLOW]) * nodes + k // spacing
                h[first : first + 2] += row[AMPLITUDE] * np.array([1.0 - a, a]) / np.hypot(1.0 - a, a)
            J += np.outer(h, h) / row[VARIANCE]
            at += 1
    assert at == len(rows)
    return np.array(bounds)


@pytest.mark.parametrize(("slow", "spacing"), [(0, 1), (3, 7), (2, 1), (5, 13)])
@pytest.mark.parametrize(
    "P_0", [NOTHING, np.diag(np.repeat([0.05, 0.02, 0.05, 0.05], 3) ** 2)], ids=["known", "unsure"]
)
def test_the_recursion_equals_dense_algebra_over_the_whole_trajectory(slow: int, spacing: int, P_0: np.ndarray) -> None:
    ticks = 28
    rows = random_rows(np.random.default_rng(slow), ticks, 80, slow)
    found = predicted_bound(rows, ticks, PHI, W, P_0, spacing)[COMPARED]
    expected = dense_bound(rows, ticks, spacing, slow, P_0)
    scale = np.sqrt(np.einsum("ki,kj->kij", *2 * [np.diagonal(expected, axis1=1, axis2=2)])) + 1e-30
    np.testing.assert_allclose(found / scale, expected / scale, atol=1e-8)


def test_with_everything_always_on_it_is_the_steady_kalman_predictor() -> None:
    C, V = np.eye(6, 12), np.diag([1e-2] * 3 + [1e-4] * 3)
    ticks = 3000
    rows = rows_of(np.repeat(np.arange(ticks), 6), np.tile(np.eye(6, 12), (ticks, 1)), np.tile(np.diag(V), ticks))
    found = predicted_bound(rows, ticks, PHI, W, NOTHING, 1)[-1]
    np.testing.assert_allclose(found, solve_discrete_are(PHI.T, C.T, W, V), rtol=1e-6, atol=1e-12)


def test_without_measurements_only_the_disturbance_adds_up() -> None:
    found = predicted_bound(np.empty((0, ROW_SIZE)), 50, PHI, W, NOTHING, 1)
    assert not found[0].any()
    expected = sum(np.linalg.matrix_power(PHI, j) @ W @ np.linalg.matrix_power(PHI, j).T for j in range(49))
    np.testing.assert_allclose(found[-1], expected, rtol=1e-10, atol=1e-20)


def test_a_measurement_without_noise_is_the_limit_of_small_noise() -> None:
    rows = random_rows(np.random.default_rng(1), 40, 30)
    rows[:, VARIANCE] = 0.0
    exact = predicted_bound(rows, 40, PHI, W, NOTHING, 1)
    rows[:, VARIANCE] = 1e-16
    np.testing.assert_allclose(exact, predicted_bound(rows, 40, PHI, W, NOTHING, 1), atol=1e-10)
    assert np.all(np.diagonal(exact, axis1=1, axis2=2) >= -1e-12)


@given(seed=st.integers(0, 10**6), keep=st.floats(0.0, 1.0), slow=st.sampled_from([0, 3]))
def test_more_measurements_never_raise_the_bound(seed: int, keep: float, slow: int) -> None:
    rng = np.random.default_rng(seed)
    rows = random_rows(rng, 40, 60, slow)
    fewer = rows[rng.random(len(rows)) < keep]
    low, high = (predicted_bound(r, 40, PHI, W, NOTHING, 7) for r in (rows, fewer))
    assert np.linalg.eigvalsh(high - low).min() > -1e-9 * np.abs(high).max()


@pytest.mark.long
@given(seed=st.integers(0, 10**6), anchors=st.integers(1, 12), keep=st.floats(0.0, 1.0))
def test_more_anchors_or_more_arrivals_never_raise_the_floor(seed: int, anchors: int, keep: float) -> None:
    rng = np.random.default_rng(seed)
    truth, seen = flown_along(rng, 40), rng.random(40) < 0.5

    def floor(room: Room, seen: np.ndarray) -> np.ndarray:
        rows = by_tick(range_rows(Uwb(), room, truth, seen), angle_rows(np.ones(40, dtype=bool), 0.01))
        return np.diagonal(predicted_bound(rows, 40, PHI, W, NOTHING, 1), axis1=1, axis2=2)[:, :3]

    poor = room_with(rng.permutation(ROOM.anchor_positions)[: max(anchors, 3)])
    all_of_it = floor(ROOM, seen)
    assert np.all(all_of_it <= floor(poor, seen) * (1.0 + 1e-9) + 1e-15)
    assert np.all(all_of_it <= floor(ROOM, seen & (rng.random(40) < keep)) * (1.0 + 1e-9) + 1e-15)


def room_with(anchors: np.ndarray) -> Room:
    return Room.model_validate(ROOM.model_dump() | {"anchors": tuple(map(tuple, anchors.tolist()))})


def flown_along(rng: np.random.Generator, ticks: int) -> np.ndarray:
    """Return states on a line through the room's middle, at small angles."""
    truth = np.zeros((ticks, 12))
    truth[:, :3] = [4.0, 1.0, 1.5] + np.linspace(0.0, 1.0, ticks)[:, None] * rng.uniform(-1.0, 1.0, 3)
    truth[:, 3:6] = rng.uniform(-0.1, 0.1, (ticks, 3))
    return truth


# Ranges


@pytest.mark.parametrize(
    "noise", [{"kind": "proportional", "fraction": 0.0075}, {"kind": "proportional", "fraction": 0.5},
              {"kind": "constant", "sd": 0.1}],
    ids=["proportional", "strongly proportional", "constant"],
)  # fmt: skip
def test_a_ranges_information_is_the_expected_square_of_the_score(noise: dict[str, Any]) -> None:
    settings, truth = Uwb.model_validate({"noise": noise}), flown_along(np.random.default_rng(3), 1)
    p = truth[0, :3]

    def log_likelihood(r: np.ndarray, p: np.ndarray, anchor: np.ndarray) -> np.ndarray:
        d = np.linalg.norm(p - anchor)
        return norm.logpdf(r, d, noise.get("sd", 0.0) + noise.get("fraction", 0.0) * d)

    v, weight = np.polynomial.hermite_e.hermegauss(40)
    expected = np.zeros((3, 3))
    for anchor in ROOM.anchor_positions:
        d = np.linalg.norm(p - anchor)
        r = d + (noise.get("sd", 0.0) + noise.get("fraction", 0.0) * d) * v
        steps = 1e-5 * np.eye(3)
        score = [(log_likelihood(r, p + e, anchor) - log_likelihood(r, p - e, anchor)) / 2e-5 for e in steps]
        expected += np.einsum("an,bn,n->ab", score, score, weight / weight.sum())
    found = information(range_rows(settings, ROOM, truth, np.ones(1, dtype=bool)))
    np.testing.assert_allclose(found[:3, :3], expected, rtol=1e-5, atol=1e-5 * np.abs(expected).max())
    assert not found[3:].any()


@pytest.mark.parametrize("walls", [{"kind": "none"}, {"kind": "block"}, {"kind": "bias", "per_wall": 0.3}])
def test_a_range_counts_where_the_world_gives_it(walls: dict[str, Any]) -> None:
    settings = Uwb.model_validate({"walls": walls, "max_distance": 12.0})
    rng = np.random.default_rng(5)
    truth = np.zeros((30, 12))
    truth[:, :3] = rng.uniform([0.0, -3.0, 1.0], [20.0, 3.0, 2.0], (30, 3))
    seen = rng.random(30) < 0.7
    rows, n = range_rows(settings, ROOM, truth, seen), len(ROOM.anchors)
    for k in range(30):
        message = uwb_message(truth[k], receiver_of(settings, ROOM), 0, stream_id("uwb"), k * H, H)
        assert np.sum(rows[:, 0] == k) == (message[2 + n :].sum() if seen[k] else 0)
    assert (len(rows) < seen.sum() * n) == (walls["kind"] == "block" or settings.max_distance < 20.0)


@pytest.mark.long
def test_a_filter_that_knows_everything_sits_on_the_floor() -> None:
    """An extended Kalman filter of the true noise, 600 flights of linear dynamics at once, true ranges."""
    rng, runs, ticks, f, sd = np.random.default_rng(8), 600, 90, 0.05, 0.01
    anchors = ROOM.anchor_positions
    uwb = np.arange(ticks) % 3 == 0
    settings = Uwb.model_validate({"noise": {"kind": "proportional", "fraction": f}})
    x = np.zeros((runs, ticks, 12))
    x[:, 0, :3] = [4.0, 1.0, 1.5]
    xhat, P = x[:, 0].copy(), np.zeros((runs, 12, 12))
    errors = np.zeros((runs, ticks, 3))
    for k in range(ticks):
        errors[:, k] = xhat[:, :3] - x[:, k, :3]
        d = np.linalg.norm(x[:, k, None, :3] - anchors, axis=2)
        expected = np.linalg.norm(xhat[:, None, :3] - anchors, axis=2)
        G = np.zeros((runs, len(anchors) + 3, 12))
        G[:, :-3, :3] = (xhat[:, None, :3] - anchors) / expected[:, :, None]
        G[:, -3:, 3:6] = np.eye(3)
        e = np.concatenate([d * (1.0 + f * rng.normal(size=d.shape)) - expected,
                            x[:, k, 3:6] - xhat[:, 3:6] + sd * rng.normal(size=(runs, 3))], axis=1)  # fmt: skip
        R = np.concatenate([(f * expected) ** 2, np.full((runs, 3), sd**2)], axis=1)
        if not uwb[k]:
            G, e, R = G[:, -3:], e[:, -3:], R[:, -3:]
        S = G @ P @ G.transpose(0, 2, 1) + R[:, :, None] * np.eye(R.shape[1])
        K = np.linalg.solve(S, G @ P).transpose(0, 2, 1)
        xhat = (xhat + np.einsum("nij,nj->ni", K, e)) @ PHI.T
        P = PHI @ (P - K @ G @ P) @ PHI.T + W
        if k + 1 < ticks:
            x[:, k + 1] = x[:, k] @ PHI.T + rng.normal(size=(runs, 6)) @ B.T
    floors = np.empty((runs, 3))
    for n in range(runs):
        rows = by_tick(range_rows(settings, ROOM, x[n], uwb), angle_rows(np.ones(ticks, dtype=bool), sd))
        bound = predicted_bound(rows, ticks, PHI, W, NOTHING, 1)
        floors[n] = np.diagonal(bound, axis1=1, axis2=2)[:, :3].mean(axis=0)
    excess = (errors**2).mean(axis=1) / floors.mean(axis=0) - 1.0
    se = excess.std(axis=0) / np.sqrt(runs)
    assert np.all(se < 0.06)
    np.testing.assert_array_less(np.abs(excess.mean(axis=0)), 4.0 * se)


# Boxes


def centers_seen(room: Room, width: int, state: np.ndarray) -> np.ndarray:
    """Return the centres of all landmarks' boxes (n, 2), by SciPy's rotations."""
    camera = room.camera.scaled_to(width)
    R = Rotation.from_euler("ZYX", state[5:2:-1]).as_matrix()
    points = room.landmark_positions[:, None] + room.landmark_outlines
    q = (points - state[:3]) @ R - np.array(camera.position)
    u = camera.center[0] - camera.focal_length * q[..., 1] / q[..., 0]
    v = camera.center[1] - camera.focal_length * q[..., 2] / q[..., 0]
    return np.stack([(u.min(1) + u.max(1)) / 2.0, (v.min(1) + v.max(1)) / 2.0], axis=1)


def parametric(**errors: float) -> Scenario:
    settings = [f"camera.errors.{key}={value}" for key, value in errors.items()]
    return load_scenario("nominal_imu_uwb_yolo", ("camera.kind=projected", "camera.errors.kind=parametric", *settings))


def rows_seen(scenario: Scenario, truth: np.ndarray) -> np.ndarray:
    tables = camera_tables(scenario, scenario.load_room())
    assert tables is not None
    return camera_rows(tables, scenario.load_room(), 320, truth, np.ones(len(truth), dtype=bool))


@pytest.mark.long
def test_box_gradients_agree_with_differences_of_projections() -> None:
    rng, room = np.random.default_rng(6), ROOM
    truth = np.repeat(flown_along(rng, 2), 4, axis=0)
    truth[:, 0] = rng.uniform(0.0, 15.0, 8)
    rows = rows_seen(load_scenario("nominal_imu_uwb_yolo", ("camera.kind=projected",)), truth)
    rows = rows[rows[:, SLOW] >= 0]  # these are numbered
    assert len(rows) > 20
    for row in rows:
        i, axis = divmod(int(row[SLOW]), 2)
        x = truth[int(row[0])]
        numeric = [
            (centers_seen(room, 320, x + e)[i, axis] - centers_seen(room, 320, x - e)[i, axis]) / 2e-6
            for e in 1e-6 * np.eye(12)
        ]
        np.testing.assert_allclose(row[GRADIENT], numeric, rtol=1e-5, atol=1e-3)


def test_a_box_of_given_noise_tells_by_its_edges_variance_and_its_rate() -> None:
    truth = np.zeros((1, 12))
    truth[0, :3] = [0.0, 0.0, 1.5]
    sure = rows_seen(parametric(edge_sd=1.3, miss_base=0.0, miss_per_metre=0.0), truth)
    rare = rows_seen(parametric(edge_sd=1.3, miss_base=0.75, miss_per_metre=0.0), truth)
    assert len(sure) > 4
    assert np.all(sure[:, SLOW] == -1.0)
    J = [sum(np.outer(r[GRADIENT], r[GRADIENT]) / r[VARIANCE] for r in rows) for rows in (sure, rare)]
    edges = sum(np.outer(r[GRADIENT], r[GRADIENT]) for r in sure) / (1.3**2 / 2.0)
    np.testing.assert_allclose(J[0], edges, rtol=1e-5, atol=1e-5 * np.abs(edges).max())
    np.testing.assert_allclose(J[1], J[0] / 4.0, rtol=1e-9)


@pytest.mark.family
@pytest.mark.parametrize("share", [0.0, 0.3, 0.8])
@pytest.mark.parametrize("axis", [0, 1])
def test_the_centers_information_is_the_expected_square_of_its_score(share: float, axis: int) -> None:
    tables = camera_tables(load_scenario("nominal_imu_uwb_yolo", ("camera.kind=projected",)), ROOM)
    assert tables is not None
    errors = center_errors(tables._replace(slow=np.array([[share, 29.0], [0.0, 1.0]])))
    q, q_inverse = measured_quantile(tables.quantiles[0], tables.quantiles[1 + axis])

    def log_likelihood(e: np.ndarray, s: np.ndarray) -> np.ndarray:
        z = q_inverse(e)
        slope = (q(z + 1e-6) - q(z - 1e-6)) / 2e-6
        return norm.logpdf(z, np.sqrt(share) * s, np.sqrt(1.0 - share)) - np.log(slope)

    grid = np.linspace(-5.0, 5.0, 301)
    chance = norm.pdf(grid) * (grid[1] - grid[0])
    s, v = (a.ravel() for a in np.meshgrid(grid, grid))
    e, h = q(np.sqrt(share) * s + np.sqrt(1.0 - share) * v), 1e-4
    score_c = (log_likelihood(e - h, s) - log_likelihood(e + h, s)) / (2.0 * h)  # a centre farther on
    score_s = (log_likelihood(e, s + h) - log_likelihood(e, s - h)) / (2.0 * h)
    weight = np.outer(chance, chance).ravel()
    expected = [[weight @ (a * b) for a in (score_c, score_s)] for b in (score_c, score_s)]
    r, a = (1.0 - share) / errors.gain[axis] ** 2, np.sqrt(share) / errors.gain[axis]
    found = np.array([[1.0 / r + errors.extra[axis], a / r], [a / r, a**2 / r]])
    np.testing.assert_allclose(found, expected, rtol=0.01, atol=1e-4)


def measured_quantile(normal: np.ndarray, quantiles: np.ndarray) -> tuple[Any, Any]:
    """Return q, straight beyond the knots, and its inverse by bisection in a fine table and Newton's steps."""
    cubic = PchipInterpolator(normal, quantiles)

    def q(z: np.ndarray) -> np.ndarray:
        inside = np.clip(z, normal[0], normal[-1])
        return np.asarray(cubic(inside) + cubic(inside, 1) * (z - inside))

    fine = np.linspace(-9.0, 9.0, 20001)

    def inverse(e: np.ndarray) -> np.ndarray:
        z = np.interp(e, q(fine), fine)
        for _ in range(3):
            z = z - (q(z) - e) / cubic(np.clip(z, normal[0], normal[-1]), 1)
        return np.asarray(z)

    return q, inverse


@pytest.mark.long
def test_the_slow_error_is_correlated_as_the_projected_camera_draws_it() -> None:
    """What the recursion takes for granted: cov(z_t, z_t') = w (c c' over common nodes), c = (1 - a, a) / norm."""
    share, spacing, runs = 0.6, 10, 6000
    ticks = (3, 8, 14)
    drawn, streams = njit(persistent_normals), (stream_id("a"), stream_id("b"))
    z = np.array([[drawn(n, np.full(2, n), *streams, t, share, spacing)[0] for t in ticks] for n in range(runs)])

    def weights(t: int) -> np.ndarray:
        a, w = (t % spacing) / spacing, np.zeros(3)
        w[t // spacing : t // spacing + 2] = np.array([1.0 - a, a]) / np.hypot(1.0 - a, a)
        return w

    expected = np.array([[share * weights(s) @ weights(t) + (1.0 - share) * (s == t) for t in ticks] for s in ticks])
    np.testing.assert_allclose(z.T @ z / runs, expected, atol=4.0 * np.sqrt(2.0 / runs))


# Whole scenarios


@pytest.mark.parametrize("detector", ["ours", "own"])
def test_there_is_no_floor_for_a_detector_that_nobody_measured(detector: str) -> None:
    scenario = load_scenario("nominal_imu_uwb_yolo")
    if detector == "own":
        own = scenario.detector.model_copy(update={"cfg": "a.cfg", "weights": "a.weights"})
        scenario = scenario.model_copy(update={"detector": own})
    found = position_floor(scenario, flown_along(np.random.default_rng(0), 20))
    assert (found is None) == (detector == "own")


def test_a_scenario_is_bounded_by_the_worlds_noise_and_not_by_what_the_filter_believes() -> None:
    truth = flown_along(np.random.default_rng(0), 60)
    floors = [
        position_floor(load_scenario(name), truth)
        for name in ("nominal_imu_uwb", "paper_imu_uwb")  # the paper's W = I and V
    ]
    np.testing.assert_array_equal(*floors)
    with_camera = position_floor(load_scenario("nominal_imu_uwb_yolo"), truth)
    assert with_camera is not None
    assert floors[0] is not None
    assert np.all(with_camera <= floors[0])
    assert with_camera[-1].sum() < 0.5 * floors[0][-1].sum()  # in the blackout
    assert np.all(floors[0][0] == 0.0)


def test_a_scenarios_bound_is_that_of_what_its_three_sensors_tell() -> None:
    settings = (
        "camera.kind=projected",
        f"imu.angle_density={0.02 * USUAL_ROOT}",
        "uwb.link.rate=7.5",
        f"camera.link.rate={30 / 7}",
        "imu.link.rate=15.0",
    )
    scenario, truth, n = load_scenario("nominal_imu_uwb_yolo", settings), flown_along(np.random.default_rng(0), 60), 60
    seen = {name: arrived(scenario, name, truth) for name in ("uwb", "camera", "imu")}
    assert len({tuple(there) for there in seen.values()}) == 3
    tables = camera_tables(scenario, ROOM)
    assert tables is not None
    rows = by_tick(
        range_rows(scenario.uwb, ROOM, truth, seen["uwb"]),
        camera_rows(tables, ROOM, 320, truth, seen["camera"]),
        angle_rows(seen["imu"], 0.02),
    )
    spacing = round(load_calibration(MeasuredErrors()).slow_errors.period / H)  # of the errors, not of the misses
    expected = predicted_bound(rows, n, PHI, W, NOTHING, spacing)
    np.testing.assert_allclose(state_bound(scenario, truth), expected, rtol=1e-12)
    np.testing.assert_array_equal(position_floor(scenario, truth), np.diagonal(expected, axis1=1, axis2=2)[:, :3])


def test_with_specific_force_and_rates_it_is_a_dense_filter_of_the_force_as_well() -> None:
    """A Kalman filter of [x; force of the step just flown], of angles, rates and that force, everything else known."""
    ticks = 300
    noise = (
        f"imu.angle_density={0.01 * USUAL_ROOT}",
        f"imu.rate_density={0.002 * USUAL_ROOT}",
        f"imu.specific_force_density={0.05 * USUAL_ROOT}",
        "sensors=[imu]",
        "imu.standstill=0",  # which leaves biases of the mean noise
    )
    scenario, truth = load_scenario("imu_uwb", noise), np.zeros((ticks, 12))
    truth[:, :3] = [8.0, 1.0, 1.5]
    bound = state_bound(scenario, truth)
    assert bound is not None
    m, o = scenario.vehicle.mass, np.zeros((3, 3))
    Phi = np.block([[PHI, np.zeros((12, 3))], [np.zeros((3, 15))]])
    by_noise = np.vstack([B, np.hstack([scenario.world.disturbance.sds(scenario.h)[0] * np.eye(3), o])])
    C = np.zeros((9, 15))
    C[:3, 3:6], C[3:6, 9:12], C[6:, 12:] = np.eye(3), np.eye(3), np.eye(3) / m
    V = np.diag(np.repeat([0.01**2, 0.002**2, 0.05**2], 3))
    P = np.zeros((15, 15))
    exact = np.empty((ticks, 12, 12))
    for k in range(ticks):
        exact[k] = P[:12, :12]
        K = P @ C.T @ np.linalg.inv(C @ P @ C.T + V)
        P = Phi @ (P - K @ C @ P) @ Phi.T + by_noise @ by_noise.T
    sd, exact_sd = (np.sqrt(np.diagonal(each, axis1=1, axis2=2)) for each in (bound, exact))
    assert np.all(sd <= exact_sd * (1.0 + 1e-9))
    np.testing.assert_allclose(sd[-1, :6], exact_sd[-1, :6], rtol=0.01)
    nominal = state_bound(load_scenario("nominal_imu_uwb", noise), truth)
    assert nominal is not None
    assert np.all(sd[-1, :3] < 0.7 * np.sqrt(np.diag(nominal[-1])[:3]))


def test_without_a_sensor_the_bound_is_the_disturbances_alone() -> None:
    scenario = load_scenario("nominal_imu_uwb", ("imu.link.loss.kind=bernoulli", "imu.link.loss.probability=1.0"))
    truth = flown_along(np.random.default_rng(0), 30)
    truth[:, 0] = 3.0  # in the blackout
    assert not arrived(scenario, "uwb", truth).any()
    assert not arrived(scenario, "camera", truth).any()
    bound = state_bound(scenario, truth)
    np.testing.assert_allclose(bound, predicted_bound(np.empty((0, ROW_SIZE)), 30, PHI, W, NOTHING, 1), rtol=1e-12)
