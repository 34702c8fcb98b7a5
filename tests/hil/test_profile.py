"""The profile of the onboard half: what it looks at, and that evaluating block by block changes no value."""

import re

import numpy as np
import pytest

from ortilo_drake.flight.stepped_halves import OnboardHalf, WorldHalf
from ortilo_drake.hil.real_time.profile import (
    REST,
    WHOLE,
    block_names,
    dataflow_order,
    leaves,
    profile_onboard,
    rows_of,
    time_blocks,
    updating_systems,
)
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario, load_scenario

LATE = ("camera.kind=projected", "estimator.delay=replay", "camera.link.delay=2")


def scenario_of(*settings: str) -> Scenario:
    return load_scenario("nominal_imu_uwb_yolo", settings)


@pytest.mark.parametrize("settings", [("camera.kind=projected",), LATE])
def test_every_output_comes_after_what_it_depends_on(settings: tuple[str, ...]) -> None:
    """Evaluating in the order, each port is the only one whose calculation Drake has still to do."""
    onboard = OnboardHalf(scenario_of(*settings), fused=False).diagram
    names = block_names(onboard)
    order = [(names[port.get_system().GetSystemPathname()], port.get_name()) for port in dataflow_order(onboard)]
    every = [(names[s.GetSystemPathname()], s.get_output_port(j).get_name()) for s in leaves(onboard) for j in
             range(s.num_output_ports())]  # fmt: skip
    assert sorted(order) == sorted(set(every))

    def comes(*chain: tuple[str, str]) -> bool:
        return [key for key in order if key in chain] == list(chain)

    handled = ("handler", "delta")
    assert comes(("uwb_fix", "uwb_fix"), handled)
    assert comes(("camera_fix", "camera_fix"), handled)
    assert comes(("planner", "y0"), ("servo", "servo"))
    assert "filter" in [names[system.GetSystemPathname()] for system in updating_systems(onboard)]
    if settings == LATE:  # a fix starts from the belief of when its message was true
        assert comes(("camera_belief_at_stamp", "camera_belief_at_stamp"), ("camera_fix", "camera_fix"), handled)


@pytest.mark.parametrize("scenario", [scenario_of(*LATE), load_scenario("flow")], ids=["late", "flow"])
def test_every_leaf_is_a_block_with_a_name_of_its_own(scenario: Scenario) -> None:
    """As many as Drake draws in a picture of the Diagram."""
    onboard = OnboardHalf(scenario, fused=False).diagram
    drawn = re.findall(r"^s\d+ \[shape=none, border=0", onboard.GetGraphvizString(), re.MULTILINE)
    names = block_names(onboard)
    assert len(set(names.values())) == len(names) == len(leaves(onboard)) == len(drawn)
    fixes = {f"{sensor}_fix" for sensor in set(scenario.sensors) - {"uwb", "camera", "imu"}}
    assert {"planner", "filter", "handler"} | fixes <= set(names.values())


def test_block_by_block_the_flight_is_the_same() -> None:
    scenario = scenario_of("camera.kind=projected")
    world = WorldHalf(scenario)
    plain, timed = OnboardHalf(scenario, fused=False), OnboardHalf(scenario, fused=False)
    ports, updating = dataflow_order(timed.diagram), updating_systems(timed.diagram)
    for _ in range(40):
        messages = world.sample()
        plain.receive(messages)
        timed.receive(messages)
        assert all(spent > 0.0 for spent in time_blocks(timed, ports, updating).values())
        control = plain.answer()
        np.testing.assert_array_equal(timed.answer(), control)
        plain.advance()
        timed.advance()
        np.testing.assert_array_equal(timed.state(), plain.state())
        world.advance(control)


def test_rows_sum_to_the_whole() -> None:
    spent = {"cheap": np.array([1e-6, 1e-6, 4e-6]), "dear": np.array([2e-6, 2e-6, 2e-6])}
    rows = rows_of(spent, np.array([4e-6, 5e-6, 7e-6]))
    assert [row.block for row in rows] == ["cheap", "dear", REST, WHOLE]
    assert [row.median_us for row in rows] == pytest.approx([1.0, 2.0, 1.0, 5.0])
    assert [row.share for row in rows] == pytest.approx([6 / 16, 6 / 16, 4 / 16, 1.0])
    assert rows[0].p99_us == pytest.approx(1.0 + 0.98 * 3.0)


def test_a_profile_finds_the_tick_in_its_blocks() -> None:
    """No limit in time: only that every block was timed, and that the shares make up the tick timed whole."""
    scenario = scenario_of("camera.kind=projected")
    rows = {row.block: row for row in profile_onboard(scenario, 60)}
    blocks = set(block_names(OnboardHalf(scenario, fused=False).diagram).values())
    assert set(rows) == blocks | {REST, WHOLE}
    assert sum(row.share for name, row in rows.items() if name != WHOLE) == pytest.approx(1.0)
    assert all(row.median_us > 0.0 for name, row in rows.items() if name in blocks)


@pytest.mark.long
@pytest.mark.egl
def test_a_rendered_camera_s_detector_is_a_block() -> None:
    rows = {row.block: row for row in profile_onboard(scenario_of(), 6)}
    assert rows["detector"].share == max(row.share for name, row in rows.items() if name not in (WHOLE, REST))


def test_no_ticks_are_refused() -> None:
    with pytest.raises(InputError, match="ticks: 0"):
        profile_onboard(scenario_of("camera.kind=projected"), 0)
