"""The onboard half alone: its boxes, what they hear from outside, and the signals that its players show."""

from pydrake.trajectories import Trajectory

from ortilo_drake.diagrams.wiring.intermittent import filtering_of
from ortilo_drake.diagrams.wiring.messages import message_boxes
from ortilo_drake.diagrams.wiring.onboard import NO_PARTS, Parts, belief_parts_box, measurement_in, onboard_boxes
from ortilo_drake.diagrams.wiring.pictures import detected
from ortilo_drake.loop.element import Box, outside
from ortilo_drake.loop.wiring import Wiring
from ortilo_drake.model.signals import ACTED_SIZE, VELOCITY_SIZE
from ortilo_drake.onboard.estimator.filter_element import extra_box
from ortilo_drake.onboard.planner.planned import Planned
from ortilo_drake.scenario import Belief

_SHOWN = {
    "control": "servo",
    "estimate": "belief_parts.estimate",
    "covariance": "belief_parts.covariance",
    "reference": "reference",
}


def half_of(
    belief: Belief, plan: Planned, detects: bool = True, parts: Parts = NO_PARTS, takes_paths: bool = False
) -> tuple[Wiring, dict[str, str]]:
    """Return the wiring, with boxes of OUTSIDE for what comes in, and the box or part of one behind each signal.

    Args:
        belief: what is known of a scenario.
        plan: what is flown, as of onboard_boxes.
        detects: whether the pictures of a rendered camera come here; if not, detections do.
        parts: in place of the scenario's.
        takes_paths: whether the path is an input of Drake's player.

    Raises:
        InputError: as onboard_boxes, or if the detector's files are wrong.
    """
    room = belief.load_room()
    messages = message_boxes(belief, room, detects)
    around = [*messages.values(), outside("velocity", VELOCITY_SIZE), outside("acted_delivered", ACTED_SIZE)]
    seeing, messages = detected(belief, room, messages) if detects else ([], messages)
    ticks = int(plan.end_time() * belief.control_rate) + 2 if isinstance(plan, Trajectory) else 0
    boxes = onboard_boxes(belief, room, plan, ticks, messages, parts, takes_paths)
    boxes += belief_part_boxes(belief, boxes)
    return Wiring([*around, *seeing, *boxes]), _SHOWN | estimated_in(boxes)


def belief_part_boxes(belief: Belief, boxes: list[Box]) -> list[Box]:
    """Return boxes that show what an estimator says, for the ports of a Diagram; those that are there are left out."""
    named, shown = {box.name for box in boxes}, list[Box]()
    if "belief_parts" not in named:
        shown.append(belief_parts_box(boxes))
    if "vehicle_belief" in named:
        its = filtering_of(belief)
        shown.append(extra_box("extra", its.n).with_inputs(belief=its.belief))
    return shown


def estimated_in(boxes: list[Box]) -> dict[str, str]:
    """Return the names of y, delta and V2, and of force and extra where the filter estimates more than [x; i]."""
    extended = any(box.name == "vehicle_belief" for box in boxes)
    return measurement_in(boxes) | ({"force": "vehicle_belief.force", "extra": "extra"} if extended else {})
