"""The handler: stacking, Delta, H and E in every pattern of arrivals, gates against SciPy, covariances."""

from itertools import product

import numpy as np
import pytest
from played_box import PlayedBox
from scipy.spatial.distance import mahalanobis
from scipy.stats import chi2

from ortilo_drake.model.hover import output_C
from ortilo_drake.model.measurement import PAPER, Measurement, make_measurement, row
from ortilo_drake.model.signals import SENSORS
from ortilo_drake.onboard.estimator.kalman import innovation, squared_distance
from ortilo_drake.onboard.estimator.measurement_handler import (
    handler_box,
    incoming_of,
    oldest_used,
)

H = 1.0 / 30.0
HORIZON = 4 * H  # of 'replay'
PATTERNS = [np.array(p) for p in product([0.0, 1.0], repeat=3)]
P_UWB, P_CAMERA, RPY = np.array([1.0, 2.0, 3.0]), np.array([1.1, 1.9, 3.2]), np.array([0.1, -0.2, 0.3])
V_UWB = np.array([[0.04, 0.01, 0.0], [0.01, 0.09, 0.02], [0.0, 0.02, 0.16]])
V_CAMERA = np.diag([0.01, 0.02, 0.03])
Noise = dict[str, np.ndarray | None]
FIXED: Noise = {
    "uwb": np.diag([0.5, 0.6, 0.7]),
    "camera": np.diag([0.8, 0.9, 1.0]),
    "imu": np.diag([1e-4, 2e-4, 3e-4]),
}
FROM_FIX: Noise = {"uwb": None, "camera": None, "imu": np.diag([1e-4, 1e-4, 1e-4])}
MEASUREMENT = make_measurement()
SIZES = {"uwb": 14, "camera": 14, "imu": 11}


def fix(arrived: float, p: np.ndarray, V: np.ndarray) -> np.ndarray:
    return np.concatenate([[arrived, 0.0], p, V.ravel()])


def handler(
    noise: Noise,
    gates: dict[str, float],
    delay: str = "ignore",
    sizes: dict[str, int] = SIZES,
    measurement: Measurement = MEASUREMENT,
) -> PlayedBox:
    incoming = incoming_of(measurement, sizes, noise, gates, oldest_used(delay, HORIZON, H))
    return PlayedBox(handler_box(incoming, measurement.layout, delay != "ignore", H), H)


def belief(xhat: np.ndarray | None = None, P: np.ndarray | None = None) -> np.ndarray:
    return np.concatenate([np.zeros(15) if xhat is None else xhat, (np.eye(15) if P is None else P).ravel()])


def handle(
    delta: np.ndarray,
    gates: dict[str, float],
    noise: Noise,
    xhat: np.ndarray | None = None,
    P: np.ndarray | None = None,
    sensors: tuple[str, ...] = SENSORS,
) -> dict[str, np.ndarray]:
    """What the handler makes of the fixes above, each there or not."""
    imu = np.concatenate([[delta[2], 0.0], RPY, np.zeros(3), [0.0, 0.0, 9.81]])
    said = {"uwb": fix(delta[0], P_UWB, V_UWB), "camera": fix(delta[1], P_CAMERA, V_CAMERA), "imu": imu}
    its = handler(noise, gates, sizes={s: SIZES[s] for s in sensors})
    return its.parts(messages=np.concatenate([np.zeros(0), *(said[s] for s in sensors)]), belief=belief(xhat, P))


@pytest.mark.parametrize("delta", PATTERNS, ids=str)
def test_what_arrived_is_stacked_and_the_rest_is_zero(delta: np.ndarray) -> None:
    measurement = handle(delta, {}, FIXED)
    everything = np.concatenate([P_UWB, P_CAMERA, RPY])
    np.testing.assert_array_equal(measurement["delta"], delta)
    np.testing.assert_array_equal(measurement["y"], MEASUREMENT.arrival_matrix(delta) @ everything)
    for name in ("uwb", "camera", "imu"):
        j = ("uwb", "camera", "imu").index(name)
        V = measurement["V2"].reshape(3, 3, 3)[j]
        np.testing.assert_array_equal(V, FIXED[name])


@pytest.mark.parametrize("delta", PATTERNS, ids=str)
def test_H_and_E_are_the_papers(delta: np.ndarray) -> None:
    H = MEASUREMENT.arrival_matrix(delta) @ output_C()
    E = MEASUREMENT.selection_matrix(delta)
    seen = np.zeros((9, 12))
    for i, state in enumerate([0, 1, 2, 0, 1, 2, 3, 4, 5]):
        seen[i, state] = delta[i // 3]
    np.testing.assert_array_equal(H, seen)
    np.testing.assert_array_equal(MEASUREMENT.layout.C, output_C())
    # E C is the position wherever there is a fix, else nothing; UWB goes before the camera, the IMU has no part.
    there = float(delta[0] or delta[1])
    np.testing.assert_array_equal(E @ output_C(), there * np.eye(3, 12))
    np.testing.assert_array_equal(E[:, 0:3], delta[0] * np.eye(3))
    np.testing.assert_array_equal(E[:, 6:9], np.zeros((3, 3)))
    np.testing.assert_array_equal(E @ MEASUREMENT.arrival_matrix(delta), E)


def test_nothing_arrived_leaves_a_finite_message_of_zeros() -> None:
    measurement = handle(np.zeros(3), {"uwb": 0.99, "camera": 0.99}, FROM_FIX)
    assert not np.any(measurement["y"])
    assert not np.any(measurement["delta"])
    V2 = measurement["V2"].reshape(3, 3, 3)
    assert all(np.all(np.linalg.eigvalsh(V) > 0.0) for V in V2)  # the full-size formula can still use it


@pytest.mark.parametrize("from_fix", list(product([True, False], repeat=2)))
def test_covariances_come_with_the_fix_or_from_the_scenario(from_fix: tuple[bool, bool]) -> None:
    noise = FIXED | {name: None for name, own in zip(SENSORS, from_fix, strict=False) if own}
    V2 = handle(np.ones(3), {}, noise)["V2"].reshape(3, 3, 3)
    np.testing.assert_array_equal(V2[0], V_UWB if from_fix[0] else FIXED["uwb"])
    np.testing.assert_array_equal(V2[1], V_CAMERA if from_fix[1] else FIXED["camera"])
    np.testing.assert_array_equal(V2[2], FIXED["imu"])


def random_P(rng: np.random.Generator) -> np.ndarray:
    root = rng.normal(size=(15, 15))
    return 0.01 * root @ root.T


def distance_of(p: np.ndarray, xhat: np.ndarray, P: np.ndarray, V: np.ndarray) -> float:
    """Return the squared distance of a position from its prediction."""
    S, GT, states = np.empty((3, 3)), np.empty((3, 13)), np.arange(3)[:, None]
    innovation(xhat, P, p, V.ravel(), 3, 0, states, np.ones((3, 1)), S, GT)
    return squared_distance(S, GT, 3)


def test_distance_is_scipys_mahalanobis() -> None:
    rng = np.random.default_rng(21)
    for _ in range(20):
        P, xhat = random_P(rng), rng.normal(size=15)
        V = random_P(rng)[:3, :3]
        p = xhat[:3] + rng.normal(size=3)
        expected = mahalanobis(p, xhat[:3], np.linalg.inv(P[:3, :3] + V)) ** 2
        assert distance_of(p, xhat, P, V) == pytest.approx(expected, rel=1e-10)


@pytest.mark.parametrize(("sensor", "first"), [("camera", 3), ("imu", 6)])
@pytest.mark.parametrize("off", [0.0, 100.0])
def test_a_gate_reads_the_value_of_a_sensor_before_which_others_do_not_fly(sensor: str, first: int, off: float) -> None:
    its = {"camera": P_CAMERA, "imu": RPY}[sensor]
    xhat = np.zeros(15)
    xhat[{"camera": 0, "imu": 3}[sensor] :][:3] = its + off
    flying = SENSORS[SENSORS.index(sensor) :]
    sharp = FIXED | {sensor: 1e-6 * np.eye(3)}
    said = handle(np.ones(3), {sensor: 0.99}, sharp, xhat, 1e-6 * np.eye(15), flying)
    assert said["delta"][SENSORS.index(sensor)] == float(off == 0.0)
    np.testing.assert_array_equal(said["y"][first : first + 3], its if off == 0.0 else np.zeros(3))


@pytest.mark.parametrize("sensor", [0, 1])
@pytest.mark.parametrize("gate", [0.5, 0.9, 0.999])
def test_gate_stands_at_the_chi_square_quantile(sensor: int, gate: float) -> None:
    rng = np.random.default_rng(22)
    P = random_P(rng)
    p, V = ((P_UWB, V_UWB), (P_CAMERA, V_CAMERA))[sensor]
    direction = rng.normal(size=3)
    direction /= np.sqrt(direction @ np.linalg.solve(P[:3, :3] + V, direction))  # of Mahalanobis length 1
    limit = np.sqrt(chi2.ppf(gate, df=3))
    gates = {SENSORS[sensor]: gate}
    for length, passes in ((limit * 0.999, 1.0), (limit * 1.001, 0.0)):
        xhat = np.concatenate([p - length * direction, np.zeros(12)])
        measurement = handle(np.ones(3), gates, FROM_FIX, xhat, P)
        expected = np.ones(3)
        expected[sensor] = passes
        np.testing.assert_array_equal(measurement["delta"], expected)
        np.testing.assert_array_equal(measurement["y"][3 * sensor : 3 * sensor + 3], passes * p)


@pytest.mark.parametrize("delta", PATTERNS, ids=str)
def test_a_sensor_that_does_not_fly_is_one_that_never_arrives(delta: np.ndarray) -> None:
    flown = tuple(sensor for sensor, there in zip(SENSORS, delta, strict=True) if there)
    grounded = handle(np.ones(3), {}, FIXED, sensors=flown)
    for name, value in handle(delta, {}, FIXED).items():
        np.testing.assert_array_equal(grounded[name], value)


@pytest.mark.parametrize("where", ["position", "covariance"])
def test_a_fix_is_infinitely_far_from_a_prediction_that_is_no_number(where: str) -> None:
    xhat, P = np.ones(15), np.eye(15)
    (xhat if where == "position" else P[1])[1] = np.nan
    assert distance_of(np.ones(3), xhat, P, np.eye(3)) == np.inf


def test_without_gates_the_handler_does_not_ask_the_filter() -> None:
    astray = np.full(15, np.nan), np.full((15, 15), np.nan)
    for sensors in (SENSORS, ("imu",)):
        blind, asked = (handle(np.ones(3), {}, FROM_FIX, *its, sensors=sensors) for its in (astray, ()))
        for name, value in asked.items():
            np.testing.assert_array_equal(blind[name], value)
    gated = handle(np.ones(3), {"camera": 0.99}, FROM_FIX, *astray)
    np.testing.assert_array_equal(gated["delta"], [1.0, 0.0, 1.0])


def handled(delay: str, ages: tuple[int, ...], k: int = 50) -> dict[str, np.ndarray]:
    """What the handler gives at tick k of messages that old, one for each sensor."""
    messages = [
        np.concatenate([[1.0, (k - age) * H, 1.0, 2.0, 3.0], np.ones(size - 5)])
        for age, size in zip(ages, SIZES.values(), strict=True)
    ]
    return handler(FROM_FIX, {}, delay).parts(k, messages=np.concatenate(messages), belief=belief())


@pytest.mark.parametrize("ages", [(0, 1, 2), (2, 0, 1), (1, 5, 0), (3, 3, 3), (1, 1, 1)])
def test_drop_uses_nothing_older_than_a_tick(ages: tuple[int, ...]) -> None:
    found = handled("drop", ages)
    recent = np.array([float(age <= 1) for age in ages])
    np.testing.assert_array_equal(found["delta"], recent)
    np.testing.assert_array_equal(found["y"], np.repeat(recent, 3) * np.tile([1.0, 2.0, 3.0], 3))
    kept = handled("ignore", ages)
    np.testing.assert_array_equal(kept["delta"], np.ones(3))


def test_stamps_are_given_to_replay() -> None:
    found = handled("replay", (0, 4, 2))
    np.testing.assert_array_equal(found["stamps"], np.array([50, 46, 48]) * H)
    for name, value in handled("ignore", (0, 4, 2)).items():
        np.testing.assert_array_equal(found[name], value)


def test_replay_counts_nothing_that_is_older_than_its_horizon() -> None:
    """It was counted as used, though the filter keeps no such tick: a flight without one fix said 70 %."""
    found = handled("replay", (5, 4, 0))
    np.testing.assert_array_equal(found["delta"], [0.0, 1.0, 1.0])


@pytest.mark.parametrize("delay", ["ignore", "drop", "replay"])
def test_what_is_given_follows_what_comes_and_when(delay: str) -> None:
    """Drake keeps an output until something that it names as needed changes."""
    its = handler(FROM_FIX, {}, delay)
    for k, stamped in [(10, 10), (11, 11), (12, 9), (14, 14)]:
        messages = [
            np.concatenate([[1.0, stamped * H], np.full(size - 2, float(k + i))])
            for i, size in enumerate(SIZES.values())
        ]
        given = its.parts(k, messages=np.concatenate(messages), belief=belief())
        dropped = delay == "drop" and k - stamped > 1
        np.testing.assert_array_equal(given["y"], 0.0 * np.arange(9) if dropped else k + np.arange(9) // 3)
        np.testing.assert_array_equal(given["stamps"], np.full(3, stamped * H))


def test_values_of_any_size_are_stacked_with_their_covariances_and_gated_by_what_they_see() -> None:
    """An altimeter whose message is its value, a two-row sensor that is a fix with more behind it, and a gate on it."""
    rows = (PAPER[2], ("alt", (row("z_alt", z=1.0),)), ("flow", (row("v_x", x_dot=1.0), row("mix", x=0.6, y=0.8))))
    measurement, V_flow = make_measurement(rows), np.array([[0.04, 0.01], [0.01, 0.09]])
    sizes = {"alt": 3, "flow": 2 + 2 + 4 + 1}
    rng = np.random.default_rng(23)
    P, e = random_P(rng), rng.normal(size=2)
    C = np.zeros((2, 12))
    C[0, 6], C[1, 0], C[1, 1] = 1.0, 0.6, 0.8
    e /= np.sqrt(e @ np.linalg.solve(C @ P[:12, :12] @ C.T + V_flow, e))
    xhat = rng.normal(size=15)
    for length, passes in ((0.999, 1.0), (1.001, 0.0)):
        V = {"imu": np.eye(3), "alt": np.array([[0.25]]), "flow": None}
        value = C @ xhat[:12] + length * np.sqrt(chi2.ppf(0.9, df=2)) * e
        messages = np.array([1.0, 0.0, 1.7, 1.0, 0.0, *value, *V_flow.ravel(), 123.0])
        its = handler(V, {"flow": 0.9}, sizes=sizes, measurement=measurement)
        y, delta, V2, _ = its.parts(messages=messages, belief=belief(xhat, P)).values()
        np.testing.assert_array_equal(delta, [0.0, 1.0, passes])
        np.testing.assert_array_equal(y, [0.0, 0.0, 0.0, 1.7, *(passes * value)])
        np.testing.assert_array_equal(measurement.matrix(V2)[3:, 3:], np.diag([0.25, 0, 0]) + np.pad(V_flow, (1, 0)))
