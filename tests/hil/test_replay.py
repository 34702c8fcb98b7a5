"""A log in which a goal came is replayed: with the way that was found in flight, all else must come out the same."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.systems.primitives import TrajectorySource

from ortilo_drake.hil.halves import OnboardHalf, Signals, WorldHalf
from ortilo_drake.hil.replay import path_about, replay_log
from ortilo_drake.logs.writer import LogWriter
from ortilo_drake.onboard.goal_path import brake, then
from ortilo_drake.onboard.planner import plan
from ortilo_drake.scenario import GcsPlanner, load_scenario

SCENARIO = load_scenario("imu_uwb", ("settle=0", "planner={kind: gcs, start: [0, 0], goal: [8, 0]}"))
TICKS, BRAKES, GOES, GOAL = 130, 40, 75, (0.0, 0.0)


def fly(log: Path, goal_ticks: dict[int, tuple[float, float]]) -> None:
    """Fly both halves; at BRAKES the onboard half brakes, at GOES the way to a goal is there."""
    world, onboard = WorldHalf(SCENARIO), OnboardHalf(SCENARIO)
    with LogWriter(log, SCENARIO) as writer:
        for k in range(TICKS):
            t = k * SCENARIO.h
            if k == BRAKES:
                stop = brake(onboard.path, t, SCENARIO.planner.acceleration)
                onboard.fly_path(stop)
            if k == GOES:
                x, y, height = stop.value(stop.end_time())[:, 0]
                settings = GcsPlanner(start=(x, y), goal=GOAL, height=height)
                onboard.fly_path(then(stop, plan(settings, SCENARIO.load_room(), SCENARIO.vehicle), t))
            messages: Signals = world.sample()
            onboard.take(messages)
            outputs = onboard.outputs()
            if k in goal_ticks:
                messages = messages | {"goal": np.array(goal_ticks[k])}
            writer.write_tick(k, None, messages, outputs)
            onboard.advance()
            world.advance(outputs["control"])


def test_from_the_goal_on_the_reference_is_the_log_s_and_all_else_is_identical(tmp_path: Path) -> None:
    fly(tmp_path / "log", {BRAKES: GOAL})
    assert replay_log(tmp_path / "log") == {
        "ticks": TICKS,
        "identical": True,
        "first_difference": None,
        "largest_difference": 0.0,
        "references_from_log": TICKS - BRAKES,
    }


@pytest.mark.parametrize(("goal_ticks", "given"), [({}, 0), ({BRAKES + 5: GOAL}, TICKS - BRAKES - 5)])
def test_a_way_that_no_goal_explains_is_found_out(
    tmp_path: Path, goal_ticks: dict[int, tuple[float, float]], given: int
) -> None:
    fly(tmp_path / "log", goal_ticks)
    result = replay_log(tmp_path / "log")
    assert not result["identical"]
    assert BRAKES <= result["first_difference"] <= BRAKES + 2  # a path's braking begins with r, r_dot, r_ddot as it was
    assert result["references_from_log"] == given


def test_the_log_of_a_half_that_joined_in_flight_is_replayed_from_there(tmp_path: Path) -> None:
    world, onboard, first, u = WorldHalf(SCENARIO), OnboardHalf(SCENARIO), 20, np.array([26.487, 0.0, 0.0, 0.0])
    with LogWriter(tmp_path / "log", SCENARIO) as writer:
        for k in range(first + 30):
            messages = world.sample()
            if k == first:
                onboard.resume(first, None, np.inf)
            if k >= first:
                onboard.take(messages)
                outputs = onboard.outputs()
                writer.write_tick(k, None, messages, outputs)
                onboard.advance()
                u = outputs["control"]
            world.advance(u)
    result = replay_log(tmp_path / "log")
    assert (result["ticks"], result["identical"]) == (30, True)


@given(
    t=st.floats(0.0, 1e4),
    reference=st.lists(st.floats(-1e6, 1e6, allow_subnormal=False), min_size=9, max_size=9).map(np.array),
)
def test_the_path_about_a_reference_has_its_bits(t: float, reference: np.ndarray) -> None:
    source = TrajectorySource(path_about(t, reference), 2, True)
    context = source.CreateDefaultContext()
    context.SetTime(t)
    assert source.get_output_port().Eval(context).tolist() == reference.tolist()
