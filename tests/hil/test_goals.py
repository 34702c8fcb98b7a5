"""Goals in flight: what is refused, what is flown, and the process that plans."""

import os
import select
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from pydrake.trajectories import Trajectory
from waiting import HANGS, wait_for

from ortilo_drake.flight.stepped_halves import OnboardHalf, WorldHalf
from ortilo_drake.hil.goals.goals import (
    GONE,
    NO_PATHS,
    REPLACED,
    GoalPlanner,
    Goals,
    Plan,
    Step,
    goal_settings,
    reason_of,
)
from ortilo_drake.hil.wire.packets import Goal
from ortilo_drake.model import parts
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.planner.free_cells import free_space
from ortilo_drake.onboard.planner.goal_path import knots
from ortilo_drake.onboard.planner.planner import plan, refuse_contact
from ortilo_drake.scenario import GcsPlanner, Scenario, load_scenario

SCENARIO = load_scenario("nominal_imu_uwb")
H = SCENARIO.h


PLUGIN = """
from typing import Literal
import numpy as np
from pydrake.trajectories import PiecewisePolynomial
import ortilo_drake as od

class Still(od.Frozen):
    kind: Literal["still"]

path = PiecewisePolynomial.ZeroOrderHold([0.0, 1.0], np.array([[0.0, 0.0], [0.0, 0.0], [1.5, 1.5]]))
od.register_planner("still", Still, lambda scenario: path)
"""


class Beside(GoalPlanner):
    """Plans in this process, when it is told that it is done."""

    def __init__(self, scenario: Scenario):
        self._scenario = scenario
        self.jobs: list[tuple[int, np.ndarray, np.ndarray]] = []
        self.is_done = False

    def ask(self, number: int, p: np.ndarray, goal: np.ndarray) -> None:
        self.jobs.append((number, p, goal))

    def poll(self) -> Plan | None:
        if not (self.jobs and self.is_done):
            return None
        number, p, goal = self.jobs[-1]
        self.jobs.clear()
        settings = goal_settings(self._scenario).model_copy(
            update={"start": tuple(p[:2]), "goal": tuple(goal), "height": p[2]}
        )
        try:
            return Plan(number, knots(plan(settings, self._scenario.load_room(), self._scenario.vehicle)), "")
        except InputError as error:
            return Plan(number, None, reason_of(error))


@cache
def scenario_path() -> Trajectory:
    """The scenario's own."""
    return plan(SCENARIO.planner, SCENARIO.load_room(), SCENARIO.vehicle)


def user(number: int, x: float, y: float) -> Goal:
    return Goal(7, 0, number, "user", x, y, "")


def answers(step: Step) -> list[tuple[int, str]]:
    assert all((answer.session, answer.role) == (7, "onboard") for answer in step.answers)
    return [(answer.number, answer.reason) for answer in step.answers]


@pytest.mark.parametrize(
    ("x", "y", "reason"),
    [
        (21.0, 9.0, r"^outside the room, which is x in \["),
        (5.7, -1.0, r"^0\.00 m from 'wall', must be more than the vehicle's radius"),
        (np.nan, 0.0, r"^must be finite$"),
    ],
)
def test_what_is_plainly_no_goal_is_refused_and_the_flight_goes_on(x: float, y: float, reason: str) -> None:
    goals = Goals(SCENARIO, beside := Beside(SCENARIO))
    goals.receive(user(1, x, y))
    step = goals.step(20.0, scenario_path())
    assert step.path is None
    assert step.taken is None
    [(number, said)] = answers(step)
    assert number == 1
    with pytest.raises(InputError, match=reason):
        raise InputError(said)
    assert not beside.jobs


def test_where_the_planner_is_a_system_a_goal_is_refused_and_the_flight_goes_on() -> None:
    goals = Goals(SCENARIO, beside := Beside(SCENARIO))
    goals.receive(user(1, 8.0, -1.0))
    step = goals.step(20.0, None)
    assert (step.path, step.taken) == (None, None)
    assert answers(step) == [(1, NO_PATHS)]
    assert goals.step(20.1, None) == Step(None, None, [])
    assert not beside.jobs


def test_a_goal_is_braked_for_at_once_and_flown_to_when_a_way_is_there() -> None:
    goals = Goals(SCENARIO, beside := Beside(SCENARIO))
    goals.receive(user(1, 8.0, -1.0))
    step = goals.step(20.0, scenario_path())
    assert step.path is not None
    np.testing.assert_array_equal(step.taken, [8.0, -1.0])
    np.testing.assert_array_equal(step.path.value(20.0), scenario_path().value(20.0))
    rest = step.path.value(100.0)[:, 0]
    assert 0.3 < np.linalg.norm(rest - scenario_path().value(20.0)[:, 0]) < 0.7
    assert not answers(step)
    assert goals.step(20.0 + H, step.path) == Step(None, None, [])
    beside.is_done = True
    later = goals.step(21.0, step.path)
    assert later.taken is None
    assert answers(later) == [(1, "")]
    assert later.path is not None
    np.testing.assert_allclose(later.path.value(21.0), step.path.value(21.0), atol=1e-12)
    np.testing.assert_allclose(later.path.value(100.0)[:, 0], [8.0, -1.0, 1.5], atol=1e-6)


def test_a_repeated_goal_is_answered_again_and_not_flown_again() -> None:
    goals = Goals(SCENARIO, beside := Beside(SCENARIO))
    goals.receive(user(1, 8.0, -1.0))
    path = goals.step(20.0, scenario_path()).path
    assert path is not None
    goals.receive(user(1, 8.0, -1.0))
    assert goals.step(20.1, path) == Step(None, None, [])
    beside.is_done = True
    assert answers(goals.step(20.2, path)) == [(1, "")]
    goals.receive(user(1, 8.0, -1.0))
    again = goals.step(20.3, path)
    assert answers(again) == [(1, "")]
    assert again.path is None
    assert again.taken is None


def test_the_onboard_halfs_own_answers_are_no_goals() -> None:
    goals = Goals(SCENARIO, Beside(SCENARIO))
    goals.receive(user(1, 8.0, -1.0)._replace(role="onboard"))
    assert goals.step(20.0, scenario_path()) == Step(None, None, [])


@pytest.mark.long
def test_a_newer_goal_replaces_the_one_that_is_planned_and_the_vehicle_brakes_once() -> None:
    goals = Goals(SCENARIO, beside := Beside(SCENARIO))
    goals.receive(user(1, 8.0, -1.0))
    stop = goals.step(20.0, scenario_path()).path
    assert stop is not None
    goals.receive(user(2, 0.0, 0.0))
    goals.receive(user(3, 2.0, 0.0))
    step = goals.step(20.5, stop)
    assert sorted(answers(step)) == [(1, REPLACED), (2, REPLACED)]
    assert step.path is not None
    np.testing.assert_array_equal(knots(step.path), knots(stop))
    beside.is_done = True
    step = goals.step(21.0, stop)
    assert answers(step) == [(3, "")]
    assert step.path is not None
    np.testing.assert_allclose(step.path.value(200.0)[:2, 0], [2.0, 0.0], atol=1e-6)
    # In flight to the third another comes: it brakes on that way.
    goals.receive(user(4, 8.0, -1.0))
    t = stop.end_time() + 3.0
    fourth = goals.step(t, step.path).path
    assert fourth is not None
    np.testing.assert_allclose(fourth.value(t), step.path.value(t), atol=1e-12)


def test_where_no_way_is_found_the_vehicle_stays_at_rest() -> None:
    goals = Goals(SCENARIO, beside := Beside(SCENARIO))
    goals.receive(user(1, 8.0, -1.0))
    stop = goals.step(20.0, scenario_path()).path
    assert stop is not None
    number, p, _ = beside.jobs[0]
    beside.jobs[0] = number, p, p[:2]  # to where it is: no way, says the planner
    beside.is_done = True
    step = goals.step(30.0, stop)
    assert step.path is None
    [(number, reason)] = answers(step)
    assert "is the start" in reason


@contextmanager
def planner_of(scenario: Scenario) -> Iterator[GoalPlanner]:
    with GoalPlanner(scenario) as planner:
        planner.wait_until_ready()
        yield planner


def planned(planner: GoalPlanner) -> Plan:
    done = wait_for(planner.poll, "a plan")
    assert done
    return done


@pytest.mark.processes
def test_the_process_plans_what_the_planner_plans_and_the_newest_goal_counts() -> None:
    p = np.array([2.0, 0.5, 1.4])
    with planner_of(SCENARIO) as planner:
        assert planner.poll() is None
        for number, goal in enumerate(([0.0, 0.0], [1.0, 0.0], [8.0, 1.0])):
            planner.ask(number, p, np.array(goal))
            planner.poll()
        done = planned(planner)
        assert done.number == 2
        settings = GcsPlanner(start=(2.0, 0.5), goal=(8.0, 1.0), height=1.4)
        expected = knots(plan(settings, SCENARIO.load_room(), SCENARIO.vehicle))
        np.testing.assert_array_equal(done.knots, expected)
        planner.ask(3, p, p[:2])
        assert "is the start" in planned(planner).reason
        planner.ask(4, p, np.array([5.7, -1.0]))
        assert planned(planner) == Plan(4, None, "0.00 m from 'wall', must be more than the vehicle's radius, 0.49 m")
        # It is killed: whatever is asked then is refused, and no tick is held up.
        os.kill(planner._process.pid, signal.SIGKILL)
        for number in (5, 6):
            planner.ask(number, p, np.array([8.0, 1.0]))
            assert planned(planner) == Plan(number, None, GONE)


@pytest.mark.processes
@pytest.mark.usefixtures("own_register")
def test_the_process_knows_the_parts_of_a_plugin(tmp_path: Path) -> None:
    (tmp_path / "still.py").write_text(PLUGIN)
    parts.load_plugin(tmp_path / "still.py")
    with planner_of(load_scenario("nominal_imu_uwb", ("planner={kind: still}",))) as planner:
        planner.ask(1, np.array([2.0, 0.5, 1.5]), np.array([3.0, 0.5]))
        assert planned(planner).reason == ""


@pytest.mark.processes
def test_the_process_ends_when_the_one_that_started_it_is_killed() -> None:
    program = (
        "import time\n"
        "from ortilo_drake.hil.goals.goals import GoalPlanner\n"
        "from ortilo_drake.scenario import load_scenario\n"
        "if __name__ == '__main__':\n"
        "    with GoalPlanner(load_scenario('nominal_imu_uwb')) as planner:\n"
        "        planner.wait_until_ready()\n"
        "        print(planner._process.pid, flush=True)\n"
        "        time.sleep(600.0)\n"
    )
    with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout
        ended = os.pidfd_open(int(parent.stdout.readline()))  # readable once that process has ended
        assert select.select([ended], [], [], 0.0)[0] == []
        parent.kill()
    # It yields to whatever else runs: on a busy machine its end takes as long as it takes.
    assert select.select([ended], [], [], HANGS)[0] == [ended]
    os.close(ended)


@pytest.mark.long
def test_a_flight_goes_to_a_goal_and_to_the_next_and_touches_nothing() -> None:
    scenario = load_scenario("nominal_imu_uwb", ("planner={kind: hover, point: [7.5, 1.0, 1.4], duration: 60.0}",))
    world, onboard = WorldHalf(scenario), OnboardHalf(scenario)
    goals = Goals(scenario, beside := Beside(scenario))
    sent = {90: user(1, 14.0, -1.5), 390: user(2, 8.5, 0.5)}
    states, references, said = [], [], []
    for k in range(30 * 60):
        beside.is_done = k % 30 == 0  # planning takes its time
        if k in sent:
            goals.receive(sent[k])
        step = goals.step(k * scenario.h, onboard.path)
        if step.path:
            onboard.fly_path(step.path)
        said += answers(step)
        states.append(world.state)
        onboard.receive(world.sample())
        outputs = onboard.outputs()
        references.append(outputs["reference"])
        onboard.advance()
        world.advance(outputs["control"])
    assert said == [(1, ""), (2, "")]
    r, r_dot = np.array(references)[:, :3], np.array(references)[:, 3:6]
    step_error = r[1:] - r[:-1] - 0.5 * scenario.h * (r_dot[1:] + r_dot[:-1])
    assert np.abs(step_error).max() < 0.3 * scenario.h**2  # no jump: the trapezium's error at such accelerations
    assert r[390, 0] > 8.5  # it was on its way to the first
    np.testing.assert_allclose(r[-1], [8.5, 0.5, 1.4], atol=1e-6)
    p = np.array(states)[:, :3]
    assert np.linalg.norm(p[-1] - r[-1]) < 0.3
    space = free_space(scenario.load_room(), 1.4, scenario.vehicle.radius, 0.0, 0.6)
    refuse_contact("p_WB", p, space, scenario.vehicle)
