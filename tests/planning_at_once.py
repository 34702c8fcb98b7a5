"""A planner of goals without a separate process."""

from typing import Any

import numpy as np

from ortilo_drake.hil.goals.goals import GoalPlanner, Plan, goal_settings, reason_of
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.planner.goal_path import knots
from ortilo_drake.onboard.planner.planner import plan
from ortilo_drake.scenario import Scenario


class AtOnce(GoalPlanner):
    """A planner of goals that plans in this process, when its plan is polled."""

    def __init__(self, scenario: Scenario):
        self._scenario, self._job = scenario, None

    def ask(self, number: int, p: np.ndarray, goal: np.ndarray) -> None:
        self._job: Any = (number, p, goal)

    def poll(self) -> Plan | None:
        if self._job is None:
            return None
        (number, p, goal), self._job = self._job, None
        x, y, height = p.tolist()
        wanted = goal_settings(self._scenario).model_copy(
            update={"start": (x, y), "goal": tuple(goal.tolist()), "height": height}
        )
        try:
            return Plan(number, knots(plan(wanted, self._scenario.load_room(), self._scenario.vehicle)), "")
        except InputError as error:
            return Plan(number, None, reason_of(error))
