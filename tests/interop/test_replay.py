"""Every kind of log is replayed bit for bit, or refused with what to replay instead.

Where a goal came it is with the way that was found in flight; all else must come out the same.
"""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st
from pydrake.systems.primitives import TrajectorySource
from pydrake.trajectories import PiecewisePolynomial
from typer.testing import CliRunner

from ortilo_drake.commands.hil.app import hil_app
from ortilo_drake.flight.lockstep import fly_lockstep, in_this_process
from ortilo_drake.flight.signals import Record
from ortilo_drake.flight.stepped_halves import OnboardHalf, Signals, WorldHalf
from ortilo_drake.interop.log.logged_flight import fly_logged
from ortilo_drake.interop.log.reader import read_ticks
from ortilo_drake.interop.log.replay import ReplayReport, path_through, replay_log
from ortilo_drake.interop.log.writer import LogWriter
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.planner.goal_path import brake, join_paths
from ortilo_drake.onboard.planner.planner import plan
from ortilo_drake.scenario import GcsPlanner, Scenario, load_scenario

SCENARIO = load_scenario("nominal_imu_uwb", ("settle=0", "planner={kind: gcs, start: [0, 0], goal: [8, 0]}"))
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
                onboard.fly_path(join_paths(stop, plan(settings, SCENARIO.load_room(), SCENARIO.vehicle), t))
            messages: Signals = world.sample()
            onboard.receive(messages)
            outputs = onboard.outputs()
            if k in goal_ticks:
                messages = messages | {"goal": np.array(goal_ticks[k])}
            writer.write_tick(k, None, messages, outputs)
            onboard.advance()
            world.advance(outputs["control"])


@pytest.mark.long
def test_from_the_goal_on_the_reference_is_the_log_s_and_all_else_is_identical(tmp_path: Path) -> None:
    fly(tmp_path / "log", {BRAKES: GOAL})
    assert replay_log(tmp_path / "log") == ReplayReport(
        ticks=TICKS,
        identical=True,
        first_difference=None,
        largest_difference=0.0,
        references_from_log=TICKS - BRAKES,
        state_from_log=False,
    )


@pytest.mark.family
@pytest.mark.parametrize(("goal_ticks", "given"), [({}, 0), ({BRAKES + 5: GOAL}, TICKS - BRAKES - 5)])
def test_a_way_that_no_goal_explains_is_found_out(
    tmp_path: Path, goal_ticks: dict[int, tuple[float, float]], given: int
) -> None:
    fly(tmp_path / "log", goal_ticks)
    result = replay_log(tmp_path / "log")
    assert not result.identical
    assert BRAKES <= result.first_difference <= BRAKES + 2  # a path's braking begins with r, r_dot, r_ddot as it was
    assert result.references_from_log == given


def test_the_log_of_a_half_that_joined_in_flight_is_replayed_from_there(tmp_path: Path) -> None:
    world, onboard, first, u = WorldHalf(SCENARIO), OnboardHalf(SCENARIO), 20, np.array([26.487, 0.0, 0.0, 0.0])
    with LogWriter(tmp_path / "log", SCENARIO) as writer:
        for k in range(first + 30):
            messages = world.sample()
            if k == first:
                onboard.resume(first, None, np.inf)
            if k >= first:
                onboard.receive(messages)
                outputs = onboard.outputs()
                writer.write_tick(k, None, messages, outputs)
                onboard.advance()
                u = outputs["control"]
            world.advance(u)
    result = replay_log(tmp_path / "log")
    assert (result.ticks, result.identical, result.state_from_log) == (30, True, False)


def log_joined(log: Path, settings: tuple[str, ...] = (), away: int = 6, moves: bool = False) -> None:
    """Log a half that joined in flight from the checkpoint of one that was killed, which may have had a goal."""
    flown = load_scenario("nominal_imu_uwb", ("planner={kind: hover, duration: 9.0}", *settings))
    world, old, new, first = WorldHalf(flown), OnboardHalf(flown), OnboardHalf(flown), 60 + away
    for _ in range(60):
        old.receive(world.sample())
        u = old.answer()
        old.advance()
        world.advance(u)
    for _ in range(away):
        world.advance(u)
    if moves:
        new.fly_path(PiecewisePolynomial.FirstOrderHold([0.0, 20.0], np.array([[0.0, 2.0], [0.0, 1.0], [1.5, 1.5]])))
    new.resume(first, old.state(), away * flown.h)
    with LogWriter(log, flown) as writer:
        for k in range(first, first + 40):
            messages = world.sample()
            new.receive(messages)
            outputs = new.outputs()
            writer.write_tick(k, None, messages, outputs)
            new.advance()
            world.advance(outputs["control"])


@pytest.mark.family
@pytest.mark.parametrize(("moves", "references"), [(False, 0), (True, 40)])
def test_the_log_of_a_half_that_joined_from_a_checkpoint_says_itself_what_it_knew(
    tmp_path: Path, moves: bool, references: int
) -> None:
    log_joined(tmp_path / "log", moves=moves)
    assert replay_log(tmp_path / "log") == ReplayReport(
        ticks=40,
        identical=True,
        first_difference=None,
        largest_difference=0.0,
        references_from_log=references,
        state_from_log=True,
    )


@pytest.mark.long
def test_a_past_that_is_in_no_log_is_refused(tmp_path: Path) -> None:
    log_joined(tmp_path / "log", ("estimator.delay=replay",))
    with pytest.raises(InputError, match=r"joined its flight at tick 66 .*; replay the log of a half that"):
        replay_log(tmp_path / "log")


@pytest.mark.long
def test_boxes_that_came_beside_the_ticks_are_taken_in_place_of_pictures(tmp_path: Path) -> None:
    planner = "planner={kind: hover, duration: 9.0}"
    rendered = load_scenario("nominal_imu_uwb_yolo", (planner,))
    world = WorldHalf(load_scenario("nominal_imu_uwb_yolo", (planner, "camera.kind=projected")))
    onboard = OnboardHalf(rendered, detects=False)
    with LogWriter(tmp_path / "log", rendered) as writer:
        fixes = 0.0
        for k in range(90):
            messages = world.sample()
            onboard.receive(messages)
            outputs = onboard.outputs()
            fixes += outputs["delta"][1]
            writer.write_tick(k, None, messages, outputs)
            onboard.advance()
            world.advance(outputs["control"])
    assert fixes > 10
    assert replay_log(tmp_path / "log").identical


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("nominal_imu_uwb", ()),
        ("nominal_imu_uwb_yolo", ("camera.kind=projected", "estimator.delay=replay")),
        ("flow", ()),
        ("flow", ("estimator.delay=replay", "altimeter.link.delay=1", "flow.link={delay: 2, loss: 0.3}")),
        pytest.param("nominal_imu_uwb_yolo", (), marks=pytest.mark.egl),
    ],
)
def test_the_log_of_a_flight_in_which_the_world_waited_is_replayed(
    tmp_path: Path, name: str, settings: tuple[str, ...]
) -> None:
    flown = load_scenario(name, ("settle=0", "planner={kind: hover, duration: 2}", *settings))
    fly_logged(flown, tmp_path / "log")
    result = replay_log(tmp_path / "log")
    assert (result.ticks, result.identical, result.largest_difference) == (61, True, 0.0)


@pytest.mark.long
def test_an_output_that_was_not_recorded_is_not_compared(tmp_path: Path) -> None:
    fly_logged(SCENARIO, tmp_path / "whole")
    with LogWriter(tmp_path / "log", SCENARIO) as writer:
        for k, state, messages, outputs in list(read_ticks(tmp_path / "whole"))[:30]:
            nothing = {name: np.full_like(value, np.nan) for name, value in outputs.items()}
            writer.write_tick(k, state, messages, nothing if k % 3 == 1 else outputs)
    result = replay_log(tmp_path / "log")
    assert (result.ticks, result.identical, result.largest_difference) == (30, True, 0.0)


@pytest.mark.family
@pytest.mark.parametrize("lockstep", [True, False])
def test_only_the_log_of_a_world_that_did_not_wait_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, lockstep: bool
) -> None:
    settings = ("settle=0", "planner={kind: hover, duration: 1}")

    def flies(scenario: Scenario, *_: Any, record: Record, **__: Any) -> tuple[xr.Dataset, Any]:
        return fly_lockstep(scenario, in_this_process(scenario), record=record), SimpleNamespace(lines=dict)

    monkeypatch.setattr("ortilo_drake.hil.sessions.run_world", flies)
    options = [text for setting in settings for text in ("--set", setting)]
    arguments = [
        "world",
        "nominal_imu_uwb",
        *options,
        "--log",
        str(tmp_path / "log"),
        *(["--lockstep"] if lockstep else []),
    ]
    result = CliRunner().invoke(hil_app, arguments)
    assert result.exit_code == 0, result.output
    if lockstep:
        assert replay_log(tmp_path / "log").identical
    else:
        with pytest.raises(InputError, match=r"is the log of a world in real time: .* hil onboard --log writes"):
            replay_log(tmp_path / "log")


def test_a_log_of_no_tick_is_not_identical_to_anything(tmp_path: Path) -> None:
    with LogWriter(tmp_path / "log", SCENARIO):
        pass
    with pytest.raises(InputError, match="before its first tick"):
        replay_log(tmp_path / "log")


@given(
    t=st.floats(0.0, 1e4),
    reference=st.lists(st.floats(-1e6, 1e6, allow_subnormal=False), min_size=9, max_size=9).map(np.array),
)
def test_the_path_about_a_reference_has_its_bits(t: float, reference: np.ndarray) -> None:
    source = TrajectorySource(path_through(t, reference), 2, True)
    context = source.CreateDefaultContext()
    context.SetTime(t)
    assert source.get_output_port().Eval(context).tolist() == reference.tolist()
