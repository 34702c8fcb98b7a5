"""Systems made of a sensor's plain functions say what those return; registering needs one form or the other."""

import numpy as np
import pytest

import ortilo_drake as od
from ortilo_drake.world.noise import normals, stream_id

H, SEED = 0.1, 7
X, P = np.arange(12.0), np.arange(225.0)


def test_a_state_sensor_says_what_its_function_returns_of_the_state_and_its_own_noise() -> None:
    def measure(x: np.ndarray, v: np.ndarray, t: float) -> list[float] | None:
        return [x[2] + 0.5 * v[0], x[5] + v[1]] if t < 0.45 else None

    sensor = od.StateSensor("depth", 2, 2, measure, SEED, H)
    context = sensor.CreateDefaultContext()
    sensor.GetInputPort("state").FixValue(context, X)
    context.SetTime(3 * H)
    v = normals(SEED, stream_id("depth"), 3, 2)
    expected = [1.0, 3 * H, 2.0 + 0.5 * v[0], 5.0 + v[1]]
    np.testing.assert_array_equal(sensor.GetOutputPort("depth").Eval(context), expected)
    context.SetTime(5 * H)
    np.testing.assert_array_equal(sensor.GetOutputPort("depth").Eval(context), np.zeros(4))


@pytest.mark.parametrize(("message", "fix"), [([1.0, 0.3, 4.0], [1.0, 0.3, 8.0, 16.0]), ([0.0, 0.0, 4.0], np.zeros(4))])
def test_a_fix_solver_says_value_and_covariance_of_what_arrived(message: list[float], fix: list[float]) -> None:
    solver = od.FixSolver("depth", 1, 1, lambda payload, xhat, P: (payload * xhat[2], P[1, 1:2]))
    context = solver.CreateDefaultContext()
    for name, value in (("depth", message), ("estimate", np.arange(15.0)), ("covariance", P)):
        solver.GetInputPort(name).FixValue(context, value)
    np.testing.assert_array_equal(solver.GetOutputPort("fix").Eval(context), fix)


def test_a_sensor_needs_a_system_or_a_compiled_share() -> None:
    class Settings(od.SensorSettings):
        """Settings."""

    sensor = od.Sensor("depth", Settings, (od.row("z_depth", z=1.0),), sd=lambda s, r, x: x)
    with pytest.raises(od.InputError, match="sensor: depth: needs make_world, which makes a System, or compiled"):
        od.register_sensor(sensor)
