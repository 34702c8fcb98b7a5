"""The tight filter as elements: what it says of a tick, and where plain mechanics take it."""

import numpy as np
import pytest
from plain_box import PlainBox

from ortilo_drake.diagrams.wiring.tight import tight_boxes
from ortilo_drake.loop.element import constant
from ortilo_drake.model.signals import DETECTIONS_SIZE, IMU_SIZE, PAYLOAD, uwb_size
from ortilo_drake.model.vehicle import GRAVITY
from ortilo_drake.onboard.estimator.resume import initial_estimate
from ortilo_drake.scenario import Scenario, load_scenario

R_0 = np.array([5.0, 1.0, 1.5])

NO_FIXES = {"fixes": np.zeros(0)}


def scenario_of(name: str, *changes: str) -> Scenario:
    return load_scenario(name, ("camera.kind=projected", *changes))


def made(scenario: Scenario) -> tuple[PlainBox, PlainBox]:
    """The box of what it hears, and the filter's."""
    flying = [name for name in scenario.measurement.sensors if name in scenario.sensors]
    messages = {name: constant(name, np.zeros(PAYLOAD)) for name in flying}  # only their names are read
    heard, kalman, *_ = tight_boxes(scenario, scenario.load_room(), initial_estimate(scenario, R_0), messages)
    return PlainBox(heard, helpers=True), PlainBox(kalman, helpers=True)


def messages_at(scenario: Scenario, stamp: float) -> dict[str, np.ndarray]:
    sizes = {"imu": IMU_SIZE, "uwb": uwb_size(len(scenario.load_room().anchors)), "camera": DETECTIONS_SIZE}
    said = {name: np.array([1.0, stamp, *np.linspace(0.1, 0.9, size - PAYLOAD)]) for name, size in sizes.items()}
    return said | NO_FIXES


def test_what_it_hears_is_what_the_filter_can_use() -> None:
    scenario = scenario_of("tight_imu_uwb_yolo", "imu.link.rate=30")
    measurement, (heard, _) = scenario.measurement, made(scenario)
    p, s = measurement.sizes["y"], measurement.sizes["delta"]
    said = messages_at(scenario, 8 * scenario.h)
    y, delta, V2 = np.split(heard.say(k=9, **said), [p, p + s])  # of the tick before: kept with horizon 0.07 s
    assert delta.tolist() == [1.0, 1.0, 1.0]
    assert np.isnan(y[measurement.rows_of("uwb")]).all()
    assert np.isnan(y[measurement.rows_of("camera")]).all()
    np.testing.assert_array_equal(y[measurement.rows_of("imu")], said["imu"][PAYLOAD : PAYLOAD + 3])
    angle_sd = (scenario.estimator.imu.angle_density or 0.0) / np.sqrt(scenario.h / scenario.samples("imu"))
    np.testing.assert_allclose(V2[measurement.block_of("imu")], angle_sd**2 * np.eye(3).ravel())
    said["uwb"][0] = 0.0
    y, delta, _ = np.split(heard.say(k=12, **said), [p, p + s])  # boxes older than any pose that is kept
    assert delta.tolist() == [float(name == "imu") for name in measurement.sensors]
    assert not y[measurement.rows_of("camera")].any()


@pytest.mark.parametrize("samples", [1, 2])
def test_it_falls_as_mechanics_have_it_and_sums_up_its_error(samples: int) -> None:
    scenario = scenario_of("tight_imu_uwb", f"imu.link.rate={30 * samples}")
    _, kalman = made(scenario)
    h, m, belief = scenario.h, scenario.vehicle.mass, kalman.state["belief"]
    np.testing.assert_array_equal(belief[:15], [*R_0, 0.0, 0.0, scenario.yaw, *np.zeros(9)])
    rest = np.array([0.0, 0.0, scenario.yaw, 0.0, 0.0, 0.0, 0.0, 0.0, GRAVITY])
    rows = [[1.0, (i + 1 - samples) * h / samples, *rest] for i in range(samples)]
    imu = np.array(rows[0] if samples == 1 else [1.0, 0.0, *np.ravel(rows)])
    silent = {"uwb": np.zeros(uwb_size(len(scenario.load_room().anchors))), "camera": np.zeros(PAYLOAD)} | NO_FIXES
    reference = np.array([*(R_0 + [0.5, -0.25, 0.125]), *np.zeros(6)])
    less = np.array([m * (GRAVITY - 0.3), 0.0, 0.0, 0.0])  # thrust for a fall with 0.3 m/s^2
    kalman.step(k=0, imu=imu, control=less, reference=reference, **silent)
    np.testing.assert_allclose(belief[0:3], R_0 - [0.0, 0.0, 0.3 * h**2 / 2.0], atol=1e-12)
    np.testing.assert_allclose(belief[6:9], [0.0, 0.0, -0.3 * h], atol=1e-12)
    np.testing.assert_allclose(belief[12:15], [0.5, -0.25, 0.125])
    P = belief[15:].reshape(15, 15)
    np.testing.assert_array_equal(P, P.T)
    assert np.all(np.linalg.eigvalsh(P[:12, :12]) > 0.0)
    assert not P[12:].any()
