"""Goals that a user sends in flight: the vehicle refuses them, or flies to them.

A goal is a point x, y: the vehicle keeps the height at which it comes to rest, and its yaw. A goal where the vehicle
cannot be is refused at once, and the vehicle flies on. For any other goal the vehicle brakes
(onboard/planner/goal_path.py) while another process plans a path. The vehicle flies the path once it is at rest and the
path is ready; without a path it stays at rest. A newer goal replaces an older one that is being planned or flown. Each
goal is answered once it is decided, and again whenever it is repeated.

Planning takes up to a second, so the planner has its own process and delays no tick of the onboard half. This process
ends together with the process that started it, for then its pipe has no other end.
"""

import contextlib
import multiprocessing
import os
import signal
from collections import deque
from multiprocessing.connection import Connection
from typing import Any, Final, NamedTuple

import numpy as np
from pydrake.trajectories import PiecewisePolynomial, Trajectory

from ortilo_drake.hil.goals.goal_link import answer_to
from ortilo_drake.hil.wire.packets import Goal
from ortilo_drake.model.parts import load_plugin, plugin_files
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.planner.free_cells import free_space
from ortilo_drake.onboard.planner.goal_path import brake, join_paths, knots, through
from ortilo_drake.onboard.planner.planner import plan, refuse_contact
from ortilo_drake.onboard.planner.retime import retime
from ortilo_drake.onboard.planner.seen import fix_sources
from ortilo_drake.scenario import GcsPlanner, Scenario, WaypointPlanner

NICENESS: Final = 10  # the planner yields to the flight where both want the same core
GONE: Final = "the process that plans has ended"


class Plan(NamedTuple):
    """The plan for a goal: the knots (7, n) of a path that begins at t = 0, or None and the reason why."""

    number: int
    knots: np.ndarray | None
    reason: str


def goal_settings(scenario: Scenario) -> GcsPlanner:
    """Return the settings for planning paths to goals, taken from the scenario's planner as far as it has them."""
    if isinstance(scenario.planner, GcsPlanner):
        return scenario.planner
    if isinstance(scenario.planner, WaypointPlanner):
        return GcsPlanner(speed=scenario.planner.speed, acceleration=scenario.planner.acceleration)
    return GcsPlanner()


class GoalPlanner:
    """A planner of paths to goals in a scenario, one at a time; a context manager. Only wait_until_ready blocks."""

    def __init__(self, scenario: Scenario):
        # No fork, although a fork has all modules, which a new process takes two seconds to load: in a fork of a
        # process that has planned a path, the solver waits for threads that the fork lacks.
        context = multiprocessing.get_context("spawn")
        self._pipe, self._child_end = context.Pipe()
        arguments = plugin_files(), scenario.model_dump_json(), self._child_end
        self._process = context.Process(target=_plan, args=arguments, daemon=True)
        self._busy = False
        self._newest: int | None = None
        self._next: tuple[int, np.ndarray, np.ndarray] | None = None

    def __enter__(self) -> "GoalPlanner":
        self._process.start()
        self._child_end.close()  # while this end is open here, this process cannot notice that the child has ended
        return self

    def __exit__(self, *error: Any) -> None:
        self._pipe.close()
        self._process.terminate()
        self._process.join(5.0)

    def wait_until_ready(self) -> None:
        """Return once the process is ready to plan."""
        with contextlib.suppress(EOFError):
            self._pipe.recv()

    def ask(self, number: int, p: np.ndarray, goal: np.ndarray) -> None:
        """Request a path from rest at p_W (3) to a goal x, y (2) [m]; an earlier goal that still waits is dropped."""
        self._newest, self._next = number, (number, p, goal)

    def poll(self) -> Plan | None:
        """Return the plan finished since the last call; None if there is none, or the plan is no longer wanted."""
        if self._newest is None:
            return None
        done: Plan | None = None
        try:
            while self._pipe.poll():
                done = self._pipe.recv()
                self._busy = self._busy and done is None  # None: the process is ready
            if self._next and not self._busy:
                self._pipe.send(self._next)
                self._busy, self._next = True, None
        except (EOFError, OSError):
            done = Plan(self._newest, None, GONE)
        if done is None or done.number != self._newest:
            return None
        self._newest = self._next = None
        return done


def reason_of(error: Exception) -> str:
    """Return in one line why a goal is refused; the line leaves out the goal itself, which its user knows."""
    text = " ".join(str(error).split()).removeprefix("planner.")
    return text.partition("): ")[2] if text.startswith("goal: (") else text


def _plan(plugins: tuple[str, ...], scenario_json: str, jobs: Connection) -> None:
    for file in plugins:
        load_plugin(file)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the flight handles Ctrl-C, and ends this process
    os.nice(NICENESS)
    scenario = Scenario.model_validate_json(scenario_json)
    settings, room, sources = goal_settings(scenario), scenario.load_room(), fix_sources(scenario)
    straight = PiecewisePolynomial.FirstOrderHold([0.0, 1.0], np.array([[0.0, 1.0], [0.0, 0.0], [0.0, 0.0]]))
    retime(straight, settings.speed, settings.acceleration)  # numba compiles
    with contextlib.suppress(EOFError, OSError):
        jobs.send(None)
        while True:
            number, p, goal = jobs.recv()
            x, y, height = p.tolist()
            wanted = settings.model_copy(update={"start": (x, y), "goal": tuple(goal.tolist()), "height": height})
            try:
                done = Plan(number, knots(plan(wanted, room, scenario.vehicle, sources)), "")
            except (InputError, RuntimeError) as error:  # RuntimeError: a solver of Drake gave up
                done = Plan(number, None, reason_of(error))
            jobs.send(done)


REPLACED: Final = "replaced by a newer goal"
NO_PATHS: Final = "the planner takes no goals: it is a System, and plans no path"
REMEMBERED: Final = 256  # number of answers that can be repeated


class Step(NamedTuple):
    """The changes that goals make at a tick, and the answers to the users.

    `path` is the path to fly from now on; None changes nothing. `taken` is x, y (2) [m] of a goal for which the vehicle
    begins to brake, else None.
    """

    path: PiecewisePolynomial | None
    taken: np.ndarray | None
    answers: list[Goal]


class Goals:
    """The goals of one flight, with a planner in another process."""

    def __init__(self, scenario: Scenario, planner: GoalPlanner):
        self._settings, self._room, self._vehicle = goal_settings(scenario), scenario.load_room(), scenario.vehicle
        self._planner = planner
        self._heard: Goal | None = None
        self._wanted: Goal | None = None
        self._stop: PiecewisePolynomial | None = None
        self._answers: list[Goal] = []
        self._answered: deque[Goal] = deque(maxlen=REMEMBERED)

    def receive(self, goal: Goal) -> None:
        """Take a goal packet; a packet that is not from a user is dropped."""
        if goal.role != "user":
            return
        again = [answer for answer in self._answered if answer.number == goal.number]
        if again:
            self._answers += again
        elif self._wanted is None or goal.number != self._wanted.number:
            if self._heard and goal.number != self._heard.number:
                self._answer(self._heard, REPLACED)
            self._heard = goal

    def step(self, t: float, path: Trajectory | None) -> Step:
        """Return the changes at the coming tick at t [s] due to goals received or planned since the last call.

        `path` is the flown path p_WB(t) (3 rows) [m]; None where the planner is a System, which takes no goals.
        """
        new = taken = None
        if self._heard and path is None:
            self._answer(self._heard, NO_PATHS)
            self._heard = None
        if self._heard:
            goal, self._heard = self._heard, None
            # A vehicle that already brakes continues to brake, so it comes to rest however often the goal changes.
            stop = self._stop if self._stop and t < self._stop.end_time() else None
            stop = stop or brake(path, t, self._settings.acceleration)
            rest = stop.value(stop.end_time())[:, 0]
            reason = self._refusal(goal, rest[2])
            if reason:
                self._answer(goal, reason)
            else:
                if self._wanted:
                    self._answer(self._wanted, REPLACED)
                self._wanted, self._stop = goal, stop
                new, taken = stop, np.array([goal.x, goal.y])
                self._planner.ask(goal.number, rest, taken)
        plan = self._planner.poll()
        if plan and self._wanted and self._stop and plan.number == self._wanted.number:
            self._answer(self._wanted, plan.reason)
            self._wanted = None
            if plan.knots is not None:
                new = join_paths(self._stop, through(plan.knots), t)
        answers, self._answers = self._answers, []
        return Step(new, taken, answers)

    def _refusal(self, goal: Goal, height: float) -> str:
        """Return the reason why a goal is refused before planning; empty if it is not refused."""
        if not np.isfinite([goal.x, goal.y]).all():
            return "must be finite"
        keep = self._settings.clearance, self._settings.vertical_clearance
        space = free_space(self._room, height, self._vehicle.radius, *keep)
        try:
            refuse_contact("goal", np.array([[goal.x, goal.y, height]]), space, self._vehicle)
        except InputError as error:
            return reason_of(error)
        return ""

    def _answer(self, goal: Goal, reason: str) -> None:
        answer = answer_to(goal, reason)
        self._answered.append(answer)
        self._answers.append(answer)
