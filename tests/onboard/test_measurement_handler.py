"""The handler: stacking, Delta, H and E in every pattern of arrivals, gates against SciPy, covariances."""

from itertools import product

import numpy as np
import pytest
from pydrake.systems.framework import BasicVector
from scipy.spatial.distance import mahalanobis
from scipy.stats import chi2

from ortilo_drake.model.hover import output_C
from ortilo_drake.model.signals import MEASUREMENT_DELTA, MEASUREMENT_V2, MEASUREMENT_Y, SENSORS
from ortilo_drake.onboard.estimator.intermittent_filter import STATE_OF_ROW
from ortilo_drake.onboard.estimator.measurement_handler import (
    MeasurementHandler,
    arrival_matrix,
    selection_matrix,
    squared_distance,
)
from ortilo_drake.scenario import Noise
from ortilo_drake.scenario.onboard import Gates

H = 1.0 / 30.0

TICK = 1.0 / 30.0  # [s]
PATTERNS = [np.array(p) for p in product([0.0, 1.0], repeat=3)]
P_UWB, P_CAMERA, RPY = np.array([1.0, 2.0, 3.0]), np.array([1.1, 1.9, 3.2]), np.array([0.1, -0.2, 0.3])
V_UWB = np.array([[0.04, 0.01, 0.0], [0.01, 0.09, 0.02], [0.0, 0.02, 0.16]])
V_CAMERA = np.diag([0.01, 0.02, 0.03])
FIXED = Noise(uwb=(0.5, 0.6, 0.7), camera=(0.8, 0.9, 1.0), imu=(1e-4, 2e-4, 3e-4))


def fix(arrived: float, p: np.ndarray, V: np.ndarray) -> np.ndarray:
    return np.concatenate([[arrived, 0.0], p, V.ravel()])


def handle(
    delta: np.ndarray,
    gates: Gates,
    noise: Noise,
    xhat: np.ndarray | None = None,
    P: np.ndarray | None = None,
    sensors: tuple[str, ...] = SENSORS,
) -> np.ndarray:
    """What the handler makes of the fixes above, each there or not."""
    handler = MeasurementHandler(gates, noise, TICK, sensors)
    context = handler.CreateDefaultContext()
    imu = np.concatenate([[delta[2], 0.0], RPY, np.zeros(3), [0.0, 0.0, 9.81]])
    inputs = {
        "uwb": fix(delta[0], P_UWB, V_UWB),
        "camera": fix(delta[1], P_CAMERA, V_CAMERA),
        "imu": imu,
        "estimate": np.zeros(15) if xhat is None else xhat,
        "covariance": (np.eye(15) if P is None else P).ravel(),
    }
    for name, value in inputs.items():
        if handler.HasInputPort(name):
            handler.GetInputPort(name).FixValue(context, BasicVector(value))
    return handler.get_output_port().Eval(context).copy()


@pytest.mark.parametrize("delta", PATTERNS, ids=str)
def test_what_arrived_is_stacked_and_the_rest_is_zero(delta: np.ndarray) -> None:
    measurement = handle(delta, {}, FIXED)
    everything = np.concatenate([P_UWB, P_CAMERA, RPY])
    np.testing.assert_array_equal(measurement[MEASUREMENT_DELTA], delta)
    np.testing.assert_array_equal(measurement[MEASUREMENT_Y], arrival_matrix(delta) @ everything)
    for name in ("uwb", "camera", "imu"):
        j = ("uwb", "camera", "imu").index(name)
        V = measurement[MEASUREMENT_V2].reshape(3, 3, 3)[j]
        np.testing.assert_array_equal(V, np.diag(getattr(FIXED, name)))


@pytest.mark.parametrize("delta", PATTERNS, ids=str)
def test_H_and_E_are_the_papers(delta: np.ndarray) -> None:
    H = arrival_matrix(delta) @ output_C()
    E = selection_matrix(delta)
    seen = np.zeros((9, 12))
    for row, state in enumerate([0, 1, 2, 0, 1, 2, 3, 4, 5]):
        seen[row, state] = delta[row // 3]
    np.testing.assert_array_equal(H, seen)
    np.testing.assert_array_equal(STATE_OF_ROW, output_C() @ np.arange(12.0))
    # E C is the position wherever there is a fix, else nothing; UWB goes before the camera, the IMU has no part.
    there = float(delta[0] or delta[1])
    np.testing.assert_array_equal(E @ output_C(), there * np.eye(3, 12))
    np.testing.assert_array_equal(E[:, 0:3], delta[0] * np.eye(3))
    np.testing.assert_array_equal(E[:, 6:9], np.zeros((3, 3)))
    np.testing.assert_array_equal(E @ arrival_matrix(delta), E)


def test_nothing_arrived_leaves_a_finite_message_of_zeros() -> None:
    measurement = handle(np.zeros(3), {"camera": 0.99, "uwb": 0.99}, Noise())
    assert not np.any(measurement[MEASUREMENT_Y])
    assert not np.any(measurement[MEASUREMENT_DELTA])
    V2 = measurement[MEASUREMENT_V2].reshape(3, 3, 3)
    assert all(np.all(np.linalg.eigvalsh(V) > 0.0) for V in V2)  # the full-size formula can still use it


@pytest.mark.parametrize("from_fix", list(product([True, False], repeat=2)))
def test_covariances_come_with_the_fix_or_from_the_scenario(from_fix: tuple[bool, bool]) -> None:
    noise = Noise(uwb=None if from_fix[0] else FIXED.uwb, camera=None if from_fix[1] else FIXED.camera, imu=FIXED.imu)
    V2 = handle(np.ones(3), {}, noise)[MEASUREMENT_V2].reshape(3, 3, 3)
    np.testing.assert_array_equal(V2[0], V_UWB if from_fix[0] else np.diag(FIXED.uwb))
    np.testing.assert_array_equal(V2[1], V_CAMERA if from_fix[1] else np.diag(FIXED.camera))
    np.testing.assert_array_equal(V2[2], np.diag(FIXED.imu))


def random_P(rng: np.random.Generator) -> np.ndarray:
    root = rng.normal(size=(15, 15))
    return 0.01 * root @ root.T


def test_distance_is_scipys_mahalanobis() -> None:
    rng = np.random.default_rng(21)
    for _ in range(20):
        P, xhat = random_P(rng), rng.normal(size=15)
        V = random_P(rng)[:3, :3]
        p = xhat[:3] + rng.normal(size=3)
        expected = mahalanobis(p, xhat[:3], np.linalg.inv(P[:3, :3] + V)) ** 2
        measured = squared_distance(fix(1.0, p, V), xhat, P.ravel(), V.ravel(), 15)
        assert measured == pytest.approx(expected, rel=1e-10)


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
        measurement = handle(np.ones(3), gates, Noise(), xhat, P)
        expected = np.ones(3)
        expected[sensor] = passes
        np.testing.assert_array_equal(measurement[MEASUREMENT_DELTA], expected)
        np.testing.assert_array_equal(measurement[MEASUREMENT_Y][3 * sensor : 3 * sensor + 3], passes * p)


@pytest.mark.parametrize("delta", PATTERNS, ids=str)
def test_a_sensor_that_does_not_fly_is_one_that_never_arrives(delta: np.ndarray) -> None:
    flown = tuple(sensor for sensor, there in zip(SENSORS, delta, strict=True) if there)
    grounded = handle(np.ones(3), {}, FIXED, sensors=flown)
    np.testing.assert_array_equal(grounded, handle(delta, {}, FIXED))


@pytest.mark.parametrize("where", ["position", "covariance"])
def test_a_fix_is_infinitely_far_from_a_prediction_that_is_no_number(where: str) -> None:
    xhat, P = np.zeros(15), np.eye(15).ravel()
    (xhat if where == "position" else P)[1] = np.nan
    assert squared_distance(fix(1.0, np.ones(3), np.eye(3)), xhat, P, np.eye(3).ravel(), 15) == np.inf


def test_without_gates_the_handler_does_not_ask_the_filter() -> None:
    def inputs(gates: Gates, sensors: tuple[str, ...]) -> list[str]:
        handler = MeasurementHandler(gates, Noise(), TICK, sensors)
        ports = range(handler.num_input_ports())
        assert all(handler.HasDirectFeedthrough(i, 0) for i in ports)
        return [handler.get_input_port(i).get_name() for i in ports]

    assert inputs({}, SENSORS) == ["uwb", "camera", "imu"]
    assert inputs({}, ("imu",)) == ["imu"]
    assert inputs({"camera": 0.99}, SENSORS) == ["uwb", "camera", "imu", "estimate", "covariance"]


def handled(delay: str, ages: tuple[int, ...], k: int = 50) -> tuple[MeasurementHandler, dict[str, np.ndarray]]:
    """What the handler gives at tick k of messages that old, one for each sensor."""
    handler = MeasurementHandler({}, Noise(), H, SENSORS, delay)
    context = handler.CreateDefaultContext()
    context.SetTime(k * H)
    for name, age, size in zip(SENSORS, ages, (14, 14, 11), strict=True):
        message = np.concatenate([[1.0, (k - age) * H, 1.0, 2.0, 3.0], np.ones(size - 5)])
        handler.GetInputPort(name).FixValue(context, BasicVector(message))
    ports = [handler.get_output_port(i) for i in range(handler.num_output_ports())]
    return handler, {port.get_name(): port.Eval(context).copy() for port in ports}


@pytest.mark.parametrize("ages", [(0, 1, 2), (2, 0, 1), (1, 5, 0), (3, 3, 3), (1, 1, 1)])
def test_drop_uses_nothing_older_than_a_tick(ages: tuple[int, ...]) -> None:
    measurement = handled("drop", ages)[1]["measurement"]
    recent = np.array([float(age <= 1) for age in ages])
    np.testing.assert_array_equal(measurement[9:12], recent)
    np.testing.assert_array_equal(measurement[:9], np.repeat(recent, 3) * np.tile([1.0, 2.0, 3.0], 3))
    kept = handled("ignore", ages)[1]
    np.testing.assert_array_equal(kept["measurement"][9:12], np.ones(3))
    assert set(kept) == {"measurement"}


def test_stamps_are_given_to_replay() -> None:
    found = handled("replay", (0, 4, 2))[1]
    np.testing.assert_array_equal(found["stamps"], np.array([50, 46, 48]) * H)
    np.testing.assert_array_equal(found["measurement"], handled("ignore", (0, 4, 2))[1]["measurement"])


@pytest.mark.parametrize("delay", ["ignore", "drop", "replay"])
def test_what_is_given_follows_what_comes_and_when(delay: str) -> None:
    """Drake keeps an output until something that it names as needed changes."""
    handler = MeasurementHandler({}, Noise(), H, SENSORS, delay)
    context = handler.CreateDefaultContext()
    for k, stamped in [(10, 10), (11, 11), (12, 9), (14, 14)]:
        context.SetTime(k * H)
        for i, (name, size) in enumerate(zip(SENSORS, (14, 14, 11), strict=True)):
            values = np.concatenate([[1.0, stamped * H], np.full(size - 2, float(k + i))])
            handler.GetInputPort(name).FixValue(context, BasicVector(values))
        measurement = handler.GetOutputPort("measurement").Eval(context)
        dropped = delay == "drop" and k - stamped > 1
        np.testing.assert_array_equal(measurement[:9], 0.0 * np.arange(9) if dropped else k + np.arange(9) // 3)
        if delay == "replay":
            np.testing.assert_array_equal(handler.GetOutputPort("stamps").Eval(context), np.full(3, stamped * H))
