"""The boxes of the onboard half: an estimator, the servo and the planner.

Of every estimator the box `filter` has the belief, and `handler` says y, delta and V2.
"""

import numpy as np
from pydrake.trajectories import Trajectory

from ortilo_drake.diagrams.wiring.intermittent import intermittent_boxes
from ortilo_drake.diagrams.wiring.own_part import own_estimator_boxes, own_planner_boxes
from ortilo_drake.diagrams.wiring.servo import servo_boxes
from ortilo_drake.diagrams.wiring.tight import tight_boxes
from ortilo_drake.loop.element import Box, constant
from ortilo_drake.model.room import Room
from ortilo_drake.onboard.planner.planned import start_of
from ortilo_drake.onboard.planner.planner import make_planner
from ortilo_drake.onboard.planner.table_player import reference_box
from ortilo_drake.scenario import Scenario

ESTIMATORS = {"intermittent": intermittent_boxes, "tight": tight_boxes}


def onboard_boxes(
    scenario: Scenario, room: Room, path: Trajectory | Box, ticks: int, messages: dict[str, Box]
) -> list[Box]:
    """Return the boxes of the onboard half.

    Args:
        scenario: the scenario.
        room: its room as it was surveyed.
        path: that is flown, or a planner's own box.
        ticks: of the flight.
        messages: which box says each sensor's message as it lands.
    """
    make = ESTIMATORS.get(scenario.estimator.kind, own_estimator_boxes)
    estimator = make(scenario, room, start_of(path), messages)
    belief, knows_force = belief_in(estimator), any(box.name == "known" for box in estimator)
    boxes, force = estimator, "known.force" if knows_force else "no_force"
    if isinstance(path, Box):
        boxes += own_planner_boxes(scenario, path, belief, force, messages)
    else:
        boxes.append(reference_box(reference_table(path, ticks, scenario.h)))
    if not knows_force:
        boxes.append(constant("no_force", np.zeros(3)))
    return [*boxes, *servo_boxes(scenario, belief, force, messages)]


def belief_in(boxes: list[Box]) -> str:
    """Return what says the belief of [x; i] (240) that was predicted for this tick."""
    named = {box.name: box for box in boxes}
    if "known" in named:
        return "known.belief"
    return "filter.belief" if "belief" in named["filter"].parts else "filter"


def reference_table(path: Trajectory, ticks: int, h: float) -> np.ndarray:
    """Return r, r_dot and r_ddot of a path at every tick (ticks + 1, 9)."""
    planner = make_planner(path)
    context, table = planner.CreateDefaultContext(), np.empty((ticks + 1, 9))
    for k in range(ticks + 1):
        context.SetTime(k * h)
        table[k] = planner.get_output_port().Eval(context)
    return table
