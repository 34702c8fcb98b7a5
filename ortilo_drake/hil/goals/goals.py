"""Goals that a user sends in flight: refused, or flown to.

A goal is a point x, y: the vehicle keeps the height at which it comes to rest, and its yaw. A goal where the vehicle
cannot be is refused at once, and the vehicle flies on. For any other goal the vehicle brakes
(onboard/planner/goal_path.py) while another process plans a way. It flies that way once it is at rest and the way is
there; it stays at rest if there is none. A newer goal replaces an older one, whether that is being planned or flown.
Every goal is answered once it is decided, and again whenever it is repeated.
"""

from collections import deque
from typing import Final, NamedTuple

import numpy as np
from pydrake.trajectories import PiecewisePolynomial, Trajectory

from ortilo_drake.hil.goals.goal_link import answer_to
from ortilo_drake.hil.goals.goal_planner import GoalPlanner, goal_settings, reason_of
from ortilo_drake.hil.wire.packets import Goal
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.planner.free_cells import free_space
from ortilo_drake.onboard.planner.goal_path import brake, join_paths, through
from ortilo_drake.onboard.planner.planner import refuse_contact
from ortilo_drake.scenario import Scenario

REPLACED: Final = "replaced by a newer goal"
NO_PATHS: Final = "the planner takes no goals: it is a System, and plans no path"
REMEMBERED: Final = 256  # answers that can be given again


class Step(NamedTuple):
    """The changes that goals make at a tick, and the answers to the users who asked.

    The path is to be flown from now on; None leaves it as it is. Taken is x, y of a goal for which the vehicle begins
    to brake (2) [m].
    """

    path: PiecewisePolynomial | None
    taken: np.ndarray | None
    answers: list[Goal]


class Goals:
    """The goals of one flight, whose planner plans beside it."""

    def __init__(self, scenario: Scenario, planner: GoalPlanner):
        self._settings, self._room, self._vehicle = goal_settings(scenario), scenario.load_room(), scenario.vehicle
        self._planner = planner
        self._heard: Goal | None = None
        self._wanted: Goal | None = None
        self._stop: PiecewisePolynomial | None = None
        self._answers: list[Goal] = []
        self._answered: deque[Goal] = deque(maxlen=REMEMBERED)

    def receive(self, goal: Goal) -> None:
        """Take a goal packet; one that is not from a user is dropped."""
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
        """Return the changes at the tick that comes, t [s], by goals that were received or planned since the last call.

        The path flown is p_WB(t) (3 rows) [m]; None where the planner is a System, which takes no goals.
        """
        new = taken = None
        if self._heard and path is None:
            self._answer(self._heard, NO_PATHS)
            self._heard = None
        if self._heard:
            goal, self._heard = self._heard, None
            # A vehicle that brakes already goes on with that: so it comes to rest however often the goal changes.
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
        """Return the reason why a goal is refused before any planning; empty if it is not refused."""
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
