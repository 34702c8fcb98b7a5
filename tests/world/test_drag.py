"""Rotor drag against closed forms of a body that slides and of one that climbs."""

import numpy as np
import pytest
from drake_box import PlayedBox
from pydrake.systems.analysis import Simulator

from ortilo_drake.diagrams.world import make_world
from ortilo_drake.model.equations import rotation_matrix
from ortilo_drake.scenario import load_scenario
from ortilo_drake.world.vehicle.disturbance import drag_box

STILL = ("world.disturbance={force_density: 0.0, torque_density: 0.0}", "sensors=[imu]", "imu.link.rate=null")
DRAG = "world.drag=[0.6, 0.4, 0.9]"


@pytest.mark.parametrize("seed", range(3))
def test_drag_is_along_the_bodys_axes(seed: int) -> None:
    draw = np.random.default_rng(seed)
    rpy, v, d = draw.normal(size=3), draw.normal(size=3), draw.normal(size=6)
    state = np.concatenate((np.zeros(3), rpy, v, np.zeros(3)))
    said = PlayedBox(drag_box((0.6, 0.4, 0.9)), 1.0 / 30.0, disturbance=d, state=state).say()
    R = rotation_matrix(rpy)
    np.testing.assert_allclose(said[:3], d[:3] - R @ np.diag([0.6, 0.4, 0.9]) @ R.T @ v, rtol=1e-12)
    np.testing.assert_array_equal(said[3:], d[3:])


def velocity(thrust_share: float, v_0: list[float], ticks: int, *settings: str) -> np.ndarray:
    """Return v_WB after so many ticks, level, under a share of the hovering thrust."""
    scenario = load_scenario("nominal_imu_uwb", (*STILL, DRAG, *settings))
    world = make_world(scenario)
    simulator = Simulator(world)
    context = simulator.get_mutable_context()
    world.SetSeed(context, 0)
    world.SetState(context, np.array([8.0, 1.0, 1.5, 0.0, 0.0, 0.0, *v_0, 0.0, 0.0, 0.0]))
    world.GetInputPort("control").FixValue(context, [thrust_share * scenario.vehicle.hover_thrust, 0.0, 0.0, 0.0])
    simulator.AdvanceTo(ticks * scenario.h)
    return np.array(world.GetOutputPort("state").Eval(context)[6:9])


@pytest.mark.family
@pytest.mark.parametrize("settings", [(), ("world.plant=continuous",)])
def test_a_body_that_slides_slows_down_by_the_share_of_each_tick(settings: tuple[str, ...]) -> None:
    """The force is held over a tick: v_{k+1} = (1 - c h / m) v_k."""
    left = (1.0 - np.array([0.6, 0.4]) / 30.0 / 2.7) ** 60
    np.testing.assert_allclose(
        velocity(1.0, [2.0, -1.0, 0.0], 60, *settings), [2.0 * left[0], -left[1], 0.0], rtol=1e-9
    )


@pytest.mark.long
def test_more_thrust_than_weight_comes_to_the_terminal_velocity() -> None:
    """(f_T - m g) / c."""
    assert velocity(1.02, [0.0, 0.0, 0.0], 3000)[2] == pytest.approx(0.02 * 2.7 * 9.81 / 0.9, rel=1e-9)
