"""The report of the commands that acted: against what the link applied, and against the failsafe's own account."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from ortilo_drake.diagrams.world import make_world
from ortilo_drake.flight.stepped_halves import WorldHalf
from ortilo_drake.model.signals import ACT_SIZE, ACTED_SIZE, ACTS, PAYLOAD
from ortilo_drake.scenario import load_scenario
from ortilo_drake.world.vehicle.acted_report import NO_COMMAND, acts_after

ACTED = ("estimator.delay=replay", "commands.filter=acted", "planner={kind: hover, duration: 5}")
H = 1.0 / 30.0


def rows(message: np.ndarray) -> np.ndarray:
    return message[PAYLOAD:].reshape(ACTS, ACT_SIZE)


def command(k: int) -> np.ndarray:
    return np.array([26.0 + 0.01 * k, 1e-4 * k, 0.0, 0.0])


def test_without_the_setting_nothing_is_reported() -> None:
    assert not make_world(load_scenario("nominal_imu_uwb")).HasOutputPort("acted")


@pytest.mark.long
@pytest.mark.parametrize("link", ["{}", "{delay: 3}", "{delay: 2, loss: 0.4}", "{loss: 0.4}"])
def test_it_tells_what_the_link_applied(link: str) -> None:
    world = WorldHalf(load_scenario("nominal_imu_uwb", (*ACTED, f"command_link={link}")))
    acted: dict[int, np.ndarray] = {}
    for k in range(30):
        message = world.sample()["acted"]
        assert message[0] == 1.0
        assert message[1] == pytest.approx(k * H)
        for since, stamp, *u in rows(message):
            if since >= 0.0:
                acted[round(since / H)] = np.array([stamp, *u])
                assert since < k * H - 0.5 * H or k == 0
        world.advance(command(k))
    late = 3 if "3" in link else 2 if "2" in link else 0
    if "loss" not in link:
        assert sorted(acted) == list(range(late, 29))
    else:
        assert 8 < len(acted) < 26
    for k, (stamp, *u) in acted.items():
        assert round(stamp / H) == k - late
        np.testing.assert_array_equal(u, command(k - late))


@pytest.mark.long
def test_in_real_time_it_tells_the_millisecond_and_who_flies() -> None:
    world = WorldHalf(load_scenario("nominal_imu_uwb", ACTED), 1e-3)
    u = np.array([26.5, 0.0, 0.0, 0.0])
    world.advance_to(0.010, np.array([load_scenario("nominal_imu_uwb").vehicle.hover_thrust, 0.0, 0.0, 0.0, 0.0]))
    world.advance_to(0.020, np.append(u, 0.010), 0.0)
    world.advance_to(0.35, np.append(u, 0.010), 0.0)
    newest = rows(world.sample()["acted"])
    first = newest[newest[:, 1] >= 0.0]
    np.testing.assert_allclose(first, [[0.010, 0.0, *u]], atol=1e-12)
    failsafe = newest[(newest[:, 1] == NO_COMMAND) & (newest[:, 0] >= 0.0)]
    assert world.failsafe_mode == "hold"
    assert np.all(np.diff(-failsafe[:, 0]) >= H * (1 - 1e-6))  # once a tick, from 0.2 s after the command on
    assert failsafe[-1, 0] == pytest.approx(0.211, abs=2e-3)


def test_a_held_command_is_told_once_and_hover_after_a_loss_too() -> None:
    none = np.tile([-1.0, NO_COMMAND, 26.0, 0.0, 0.0, 0.0], (ACTS, 1))
    u, hover = command(3), np.array([26.0, 0.0, 0.0, 0.0])
    acts = acts_after(none, 0.1, 0.1, u, H)
    np.testing.assert_array_equal(acts_after(acts, 0.2, NO_COMMAND, u, H), acts)  # held
    zero = acts_after(acts, 0.2, NO_COMMAND, hover, H)
    np.testing.assert_array_equal(zero[:2], [[0.2, NO_COMMAND, *hover], acts[0]])


@pytest.mark.long
def test_the_report_s_link_loses_and_delays_it() -> None:
    world = make_world(load_scenario("nominal_imu_uwb", (*ACTED, "report_link={delay: 2, loss: 0.5}")))
    simulator = Simulator(world)
    world.GetInputPort("control").FixValue(simulator.get_mutable_context(), command(1))
    arrived = []
    for k in range(1, 60):
        simulator.AdvanceTo(k * H)
        message = world.GetOutputPort("acted").Eval(simulator.get_context())
        assert message.size == ACTED_SIZE
        if message[0]:
            assert message[1] == pytest.approx((k - 2) * H)
            arrived.append(k)
    assert 15 < len(arrived) < 45
