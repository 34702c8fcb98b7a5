"""The world's sensors and links on AutoDiffXd: the values of floats, and the slopes of differences."""

from typing import Any

import numpy as np
import pytest
from pydrake.autodiffutils import ExtractGradient, ExtractValue, InitializeAutoDiff

from ortilo_drake.model.vehicle import M100
from ortilo_drake.scenario import CommandLink as CommandLinkSettings
from ortilo_drake.scenario import Disturbance, Imu, Link, Uwb, load_scenario
from ortilo_drake.world.radio.command_link import CommandLink_
from ortilo_drake.world.radio.link import SensorLink_
from ortilo_drake.world.sensors.imu import Imu_
from ortilo_drake.world.sensors.message_error import MessageError_
from ortilo_drake.world.sensors.sensor_clock import SensorClock_
from ortilo_drake.world.sensors.true_velocity import TrueVelocity_
from ortilo_drake.world.sensors.uwb import UwbRanging_
from ortilo_drake.world.vehicle.disturbance import DisturbanceSource_
from ortilo_drake.world.vehicle.wrench_error import WrenchError_

H = 1.0 / 30.0
ROOM = load_scenario("nominal_imu_uwb").load_room()
X = np.array([4.0, -1.0, 1.4, 0.1, -0.2, 0.6, 0.3, -0.4, 0.2, 0.5, -0.3, 0.4])
U, D = np.array([27.0, 0.1, -0.2, 0.05]), np.array([0.3, -0.2, 0.1, 0.01, 0.02, -0.03])
NOISY_IMU = Imu(angle_sd=0.01, rate_sd=0.02, specific_force_sd=0.05)
MESSAGE = np.array([1.0, 0.1, 3.0, 2.0])
WALLS = {"kind": "bias", "per_wall": 0.2}

SYSTEMS = {
    "imu": (lambda: Imu_[float](NOISY_IMU, M100.mass, 7, H), {"state": X, "control": U, "disturbance": D}),
    "uwb": (lambda: UwbRanging_[float](Uwb.model_validate({"walls": WALLS}), ROOM, 7, H), {"state": X}),
    "true_velocity": (lambda: TrueVelocity_[float](), {"state": X}),
    "link": (lambda: SensorLink_[float]("uwb", 4, Link(), 7, H), {"message": MESSAGE, "state": X}),
    "command_link": (lambda: CommandLink_[float](CommandLinkSettings(), M100, 7, H), {"control": U}),
    "wrench_error": (lambda: WrenchError_[float](), {"commanded": U}),
    "sensor_clock": (lambda: SensorClock_[float]("uwb_clock"), {"state": X}),
    "message_error": (
        lambda: MessageError_[float]("uwb_error", 6, 2, True),
        {"message": np.array([1.0, 0.1, 3.0, 2.0, 1.0, 0.0]), "error": np.array([0.2, 0.3])},
    ),
    "disturbance": (lambda: DisturbanceSource_[float](Disturbance(), 7, H), {}),
}


def output_at(system: Any, inputs: dict[str, np.ndarray], time: float = 3 * H) -> np.ndarray:
    context = system.CreateDefaultContext()
    context.SetTime(time)
    for name, value in inputs.items():
        system.GetInputPort(name).FixValue(context, value)
    return np.array(system.get_output_port(0).Eval(context))


@pytest.mark.parametrize("name", SYSTEMS)
def test_a_system_gives_the_values_of_floats_and_the_slopes_of_differences(name: str) -> None:
    make, inputs = SYSTEMS[name]
    system, point = make(), np.concatenate([*inputs.values(), []])
    system_ad, edges = system.ToAutoDiffXd(), np.cumsum([len(v) for v in inputs.values()])[:-1]

    def parts(z: np.ndarray) -> dict[str, np.ndarray]:
        return dict(zip(inputs, np.split(z, edges), strict=True)) if inputs else {}

    found = output_at(system_ad, parts(InitializeAutoDiff(point[:, None])[:, 0] if inputs else point))
    at_point = output_at(system, inputs)
    np.testing.assert_array_equal(ExtractValue(found[:, None])[:, 0], at_point)
    if not inputs:
        assert np.max(np.abs(at_point)) > 0.0  # the disturbance is drawn, and a constant
        return
    size = 1e-6
    slopes = [(output_at(system, parts(point + d)) - output_at(system, parts(point - d))) / (2 * size)
              for d in size * np.eye(len(point))]  # fmt: skip
    np.testing.assert_allclose(ExtractGradient(found[:, None]), np.column_stack(slopes), rtol=0.0, atol=1e-8)


def test_the_slope_of_a_range_is_the_direction_from_its_anchor() -> None:
    system = UwbRanging_[float](Uwb(), ROOM, 7, H).ToAutoDiffXd()
    message = output_at(system, {"state": InitializeAutoDiff(X[:, None])[:, 0]})
    away = X[:3] - ROOM.anchor_positions
    d = np.linalg.norm(away, axis=1)
    # A range is d + fraction d v: its noise, a constant v, scales it.
    ranges, n = ExtractValue(message[:, None])[2:, 0], len(d)
    there = ranges[n:] == 1.0
    assert there.any()
    slopes = ExtractGradient(message[:, None])[2 : 2 + n, :3]
    expected = (ranges[:n] / d)[:, None] * away / d[:, None]
    np.testing.assert_allclose(slopes[there], expected[there], rtol=1e-12)


def test_the_links_state_in_flight_keeps_its_derivatives() -> None:
    link = SensorLink_[float]("uwb", 3, Link(delay=2), 7, H).ToAutoDiffXd()
    context = link.CreateDefaultContext()
    link.GetInputPort("state").FixValue(context, X)
    message = InitializeAutoDiff(np.array([[1.0], [0.1], [3.0]]))[:, 0]
    link.GetInputPort("message").FixValue(context, message)
    for k in range(2):
        assert not ExtractValue(link.get_output_port().Eval(context)[:, None]).any()
        context.SetDiscreteState(link.EvalUniquePeriodicDiscreteUpdate(context).value())
        context.SetTime((k + 1) * H)
    delivered = link.get_output_port().Eval(context)[:, None]
    np.testing.assert_array_equal(ExtractValue(delivered)[:, 0], [1.0, 0.1, 3.0])
    np.testing.assert_array_equal(ExtractGradient(delivered), np.eye(3))


def test_a_delayed_command_keeps_its_derivatives() -> None:
    link = CommandLink_[float](CommandLinkSettings(delay=1), M100, 7, H).ToAutoDiffXd()
    context = link.CreateDefaultContext()
    link.GetInputPort("control").FixValue(context, InitializeAutoDiff(U[:, None])[:, 0])
    hover = link.get_output_port().Eval(context)[:, None]
    np.testing.assert_array_equal(ExtractValue(hover)[:, 0], [M100.hover_thrust, 0.0, 0.0, 0.0])
    context.SetDiscreteState(link.EvalUniquePeriodicDiscreteUpdate(context).value())
    context.SetTime(H)
    applied = link.get_output_port().Eval(context)[:, None]
    np.testing.assert_array_equal(ExtractValue(applied)[:, 0], U)
    np.testing.assert_array_equal(ExtractGradient(applied), np.eye(4))
