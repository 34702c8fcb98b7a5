"""The planner in a process of its own, so that planning, up to a second, holds up no tick of the onboard half.

It ends with the process that started it, however that ends: its pipe then has no other end.
"""

import contextlib
import multiprocessing
import os
import signal
from multiprocessing.connection import Connection
from typing import Any, Final, NamedTuple

import numpy as np
from pydrake.trajectories import PiecewisePolynomial

from ortilo_drake.model.parts import load_plugin, plugin_files
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.planner.goal_path import knots
from ortilo_drake.onboard.planner.planner import plan
from ortilo_drake.onboard.planner.retime import retime
from ortilo_drake.onboard.planner.seen import fix_sources
from ortilo_drake.scenario import GcsPlanner, Scenario, WaypointPlanner

NICENESS: Final = 10  # it yields to the flight where both want the same core
GONE: Final = "the process that plans has ended"


class Plan(NamedTuple):
    """The plan for a goal: the knots (7, n) of a path that begins at t = 0, or the reason why there is none."""

    number: int
    knots: np.ndarray | None
    reason: str


def goal_settings(scenario: Scenario) -> GcsPlanner:
    """Return the settings for planning paths to goals: those of the scenario's own path, as far as it has them."""
    if isinstance(scenario.planner, GcsPlanner):
        return scenario.planner
    if isinstance(scenario.planner, WaypointPlanner):
        return GcsPlanner(speed=scenario.planner.speed, acceleration=scenario.planner.acceleration)
    return GcsPlanner()


class GoalPlanner:
    """Plans ways to goals in a scenario, one at a time; a context manager. Only wait_until_ready waits."""

    def __init__(self, scenario: Scenario):
        # Not a fork, though that has all modules at once, which a new process loads in two seconds: once a path has
        # been planned, the solver waits for threads that a fork has not.
        context = multiprocessing.get_context("spawn")
        self._pipe, self._child_end = context.Pipe()
        arguments = plugin_files(), scenario.model_dump_json(), self._child_end
        self._process = context.Process(target=_plan, args=arguments, daemon=True)
        self._busy = False
        self._newest: int | None = None
        self._next: tuple[int, np.ndarray, np.ndarray] | None = None

    def __enter__(self) -> "GoalPlanner":
        self._process.start()
        self._child_end.close()  # while it is open here, this process cannot notice that the child has ended
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
        """Have a way planned from rest at p_W (3) to a goal x, y (2) [m]; a goal that still waits is dropped."""
        self._newest, self._next = number, (number, p, goal)

    def poll(self) -> Plan | None:
        """Return the plan made since the last call; None if there is none, or it is no longer wanted."""
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
    """Return in one line why a goal is refused, without the goal itself, which its asker knows."""
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
            except (InputError, RuntimeError) as error:  # RuntimeError: a solver of Drake's gave up
                done = Plan(number, None, reason_of(error))
            jobs.send(done)
