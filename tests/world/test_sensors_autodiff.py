"""The world's sensors and links on AutoDiffXd: the values of floats, and the slopes of differences."""

from dataclasses import replace

import numpy as np
import pytest
from drake_box import PlayedBox
from pydrake.autodiffutils import ExtractGradient, ExtractValue, InitializeAutoDiff

from ortilo_drake.loop.element import Box, Values, outside
from ortilo_drake.model.signals import IMU_SIZE
from ortilo_drake.model.vehicle import M100
from ortilo_drake.onboard.ranging.sighted import sighted_box
from ortilo_drake.scenario import Ahrs, Disturbance, Imu, Link, Uwb, load_scenario
from ortilo_drake.scenario import CommandLink as CommandLinkSettings
from ortilo_drake.world.noise import random_walk
from ortilo_drake.world.radio.command_link import command_link_box
from ortilo_drake.world.radio.link import delivery_box
from ortilo_drake.world.sensors.ahrs import ahrs_box
from ortilo_drake.world.sensors.imu import imu_box
from ortilo_drake.world.sensors.range_paths import paths_box
from ortilo_drake.world.sensors.sensor_clock import clock_box
from ortilo_drake.world.sensors.sensor_errors import SensorErrors, errors_box
from ortilo_drake.world.sensors.true_velocity import velocity_box
from ortilo_drake.world.sensors.uwb import uwb_box
from ortilo_drake.world.vehicle.disturbance import disturbance_box, drag_box
from ortilo_drake.world.vehicle.rotors import wrench_error_box, wrench_matrix

H = 1.0 / 30.0
ROOM = load_scenario("nominal_imu_uwb").load_room()
X = np.array([4.0, -1.0, 1.4, 0.1, -0.2, 0.6, 0.3, -0.4, 0.2, 0.5, -0.3, 0.4])
U, V_DOT = np.array([27.0, 0.1, -0.2, 0.05]), np.array([0.3, -0.2, 0.1])
NOISY_IMU = Imu(angle_density=0.002, rate_density=0.004, specific_force_density=0.01)
MESSAGE = np.array([1.0, 0.1, 3.0, 2.0])
WALLS = {"kind": "bias", "per_wall": 0.2}

PATHS = Uwb.model_validate({"walls": {"kind": "excess"}, "round": 0.04, "behind_walls": "left_out"})
AT_X = np.concatenate(([1.0, 0.1], np.linalg.norm(X[:3] - ROOM.anchor_positions, axis=1), np.ones(len(ROOM.anchors))))

SENT = {"sent": np.zeros(1)}
RANGES = np.array([1.0, 0.1, 3.0, 2.0, 1.0, 0.0])
SLOW = SensorErrors(random_walk(np.zeros(2), H), flagged=True)


def with_given(box: Box, given: Values) -> Box:
    return replace(box, given=box.given.updated(given))


BOXES = {
    "imu": (imu_box(NOISY_IMU, H, True), SENT | {"state": X, "acceleration": V_DOT}),
    "uwb": (uwb_box(Uwb.model_validate({"walls": WALLS}), ROOM, H), SENT | {"state": X}),
    "velocity": (velocity_box(H), {"state": X}),
    "sent": (delivery_box("uwb", outside("message", 4), Link()), {"delay": np.zeros(1), "message": MESSAGE}),
    "command_link": (command_link_box(CommandLinkSettings(), M100.hover_thrust, H), {"control": U}),
    "wrench_error": (
        with_given(wrench_error_box(), Values(tables={"wrench": wrench_matrix(0.97, np.array([0.01, -0.02]))})),
        {"control": U},
    ),
    "sensor_clock": (with_given(clock_box("uwb", H), Values({"offset": 0.01, "drift": 0.002})), {"state": X}),
    "message_errors": (
        with_given(errors_box("uwb", outside("message", 6), SLOW, 1, H), Values(tables={"bias": np.array([0.2, 0.3])})),
        {"message": RANGES},
    ),
    "uwb_paths": (
        with_given(paths_box(PATHS, ROOM, H), Values(start={"x": np.linspace(0.5, 1.5, 2 * len(ROOM.anchors))})),
        {"message": AT_X, "state": X},
    ),
    "uwb_sighted": (sighted_box(PATHS, ROOM), {"message": AT_X, "belief": np.concatenate((X, np.zeros(228)))}),
    "imu_ahrs": (
        with_given(ahrs_box(Ahrs(), outside("imu", IMU_SIZE), 1, H), Values(start={"e": np.array([0.1, 0.2, 0.3])})),
        {"message": np.ones(IMU_SIZE), "state": X, "acceleration": V_DOT},
    ),
    "drag": (drag_box((0.5, 0.4, 0.3)), {"disturbance": np.ones(6), "state": X}),
    "disturbance": (disturbance_box(Disturbance(), H), {}),
}
SWITCHES = ("sent", "delay")  # what is read of them is their sign


@pytest.mark.parametrize("name", BOXES)
def test_a_box_gives_the_values_of_floats_and_the_slopes_of_differences(name: str) -> None:
    box, inputs = BOXES[name]
    played = PlayedBox(box, H, 7, **inputs)
    other, smooth = played.on_autodiff(7), {name: v for name, v in inputs.items() if name not in SWITCHES}
    point, edges = np.concatenate([*smooth.values(), []]), np.cumsum([len(v) for v in smooth.values()])[:-1]

    def parts(z: np.ndarray) -> dict[str, np.ndarray]:
        return dict(zip(smooth, np.split(z, edges), strict=True)) if smooth else {}

    found = other.say(3, **parts(InitializeAutoDiff(point[:, None])[:, 0] if smooth else point))
    at_point = played.say(3)
    np.testing.assert_array_equal(ExtractValue(found[:, None])[:, 0], at_point)
    assert np.max(np.abs(at_point)) > 0.0
    if not smooth:
        return  # the disturbance is drawn, and a constant
    size = 1e-6
    slopes = [(played.say(3, **parts(point + d)) - played.say(3, **parts(point - d))) / (2 * size)
              for d in size * np.eye(len(point))]  # fmt: skip
    np.testing.assert_allclose(ExtractGradient(found[:, None]), np.column_stack(slopes), rtol=0.0, atol=1e-8)


def test_the_slope_of_a_range_is_the_direction_from_its_anchor() -> None:
    receiver = PlayedBox(uwb_box(Uwb(), ROOM, H), H, 7, **SENT, state=X).on_autodiff(7)
    message = receiver.say(3, state=InitializeAutoDiff(X[:, None])[:, 0])
    away = X[:3] - ROOM.anchor_positions
    d = np.linalg.norm(away, axis=1)
    # A range is d + fraction d v: its noise, a constant v, scales it.
    ranges, n = ExtractValue(message[:, None])[2:, 0], len(d)
    there = ranges[n:] == 1.0
    assert there.any()
    slopes = ExtractGradient(message[:, None])[2 : 2 + n, :3]
    expected = (ranges[:n] / d)[:, None] * away / d[:, None]
    np.testing.assert_allclose(slopes[there], expected[there], rtol=1e-12)


def test_a_message_in_flight_keeps_its_derivatives() -> None:
    box = delivery_box("uwb", outside("message", 3), Link(delay=2))
    delivery = PlayedBox(box, H, delay=np.array([2.0]), message=np.zeros(3)).on_autodiff()
    delivery.fix(message=InitializeAutoDiff(np.array([[1.0], [0.1], [3.0]]))[:, 0])
    for k in range(2):
        assert not ExtractValue(delivery.say(k)[:, None]).any()
        delivery.step()
    delivered = delivery.say(2)[:, None]
    np.testing.assert_array_equal(ExtractValue(delivered)[:, 0], [1.0, 0.1, 3.0])
    np.testing.assert_array_equal(ExtractGradient(delivered), np.eye(3))


def test_a_delayed_command_keeps_its_derivatives() -> None:
    box = command_link_box(CommandLinkSettings(delay=1), M100.hover_thrust, H)
    link = PlayedBox(box, H, 7, control=U).on_autodiff(7)
    hover = link.say(control=InitializeAutoDiff(U[:, None])[:, 0])[:, None]
    np.testing.assert_array_equal(ExtractValue(hover)[:, 0], [M100.hover_thrust, 0.0, 0.0, 0.0])
    link.step()
    applied = link.say(1)[:, None]
    np.testing.assert_array_equal(ExtractValue(applied)[:, 0], U)
    np.testing.assert_array_equal(ExtractGradient(applied), np.eye(4))
