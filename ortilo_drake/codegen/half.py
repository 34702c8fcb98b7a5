"""The exported boxes, with their inputs and outputs."""

from typing import NamedTuple

from pydrake.trajectories import Trajectory

from ortilo_drake.diagrams.wiring.messages import message_boxes
from ortilo_drake.diagrams.wiring.onboard import half_of, onboard_boxes
from ortilo_drake.loop.element import OUTSIDE, Element, takes
from ortilo_drake.loop.wiring import Wire, Wiring
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.planner.planned import planned
from ortilo_drake.scenario import Belief


class Half(NamedTuple):
    """The onboard half for an export."""

    wiring: Wiring
    """wiring of the boxes of the half."""
    inputs: dict[str, int]
    """size of each message that the half reads, by the name of the message's box."""
    outputs: dict[str, Wire]
    """source of each output, by the output's name."""


def onboard_half(scenario: Belief) -> Half:
    """Return the onboard half of a scenario; only the scenario's belief is used.

    InputError, naming the part and the reason, if a part cannot be exported.
    """
    belief = scenario.belief
    if belief.is_rendered:
        raise InputError(
            "export: camera.kind: rendered: must be projected, whose boxes are inputs; no network is exported"
        )
    if belief.sees_landmarks and belief.landmark_fix.method == "cosine_law":
        raise InputError("export: landmark_fix.method: cosine_law: is not exported: its pseudoinverse needs LAPACK")
    room, plan = belief.load_room(), planned(belief)
    if not isinstance(plan, Trajectory):
        raise InputError("export: planner: must be a path; one that is a System or an element is not exported")
    messages = message_boxes(belief, room, detects=True)
    ticks = int(plan.end_time() * belief.control_rate) + 2
    boxes = onboard_boxes(belief, room, plan, ticks, messages)
    wiring, signals = half_of(belief, list(messages.values()), boxes)
    signals.pop("extra", None)
    for box in wiring.boxes.values():
        if box.system is not None:
            raise InputError(f"export: {box.name}: {box.system.get_name()}: is a System of Drake's, must be an element")
        if why := why_not(box.element):
            raise InputError(f"export: {box.name}: the element {box.element.name!r} {why}")
    read = {wire.box for wire in wiring.wires.values()}
    read |= {held for name in read for held in wiring.boxes[name].holds}
    inputs = {name: box.size for name, box in wiring.boxes.items() if box.element is OUTSIDE and name in read}
    return Half(wiring, inputs, {name: wiring.wire(said, "outputs") for name, said in signals.items()})


def why_not(element: Element) -> str | None:
    """Return the reason why an element cannot be exported; None if it can."""
    if any({"seed", "seeds"} & {*takes(function)} for function in element.functions.values()):
        return "draws noise"
    return None
