"""The messages of the sensors as an onboard half hears them, and what makes detections and fixes of them."""

from ortilo_drake.diagrams.wiring.systems import system_box
from ortilo_drake.loop.element import Box, outside
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import N_XBAR, SHUTTER_SIZE, size_of_samples
from ortilo_drake.onboard.detector.detector_network import make_detector
from ortilo_drake.onboard.estimator.filter_element import parts_box
from ortilo_drake.onboard.fix_solver import own_fix_box
from ortilo_drake.scenario import Belief
from ortilo_drake.sensors.described import described, described_per_tick, port_of
from ortilo_drake.sensors.messages import message_port, message_size


def message_boxes(belief: Belief, room: Room, detects: bool) -> dict[str, Box]:
    """Return the box of each sensor's messages; for a camera whose pictures are processed here, its shutter's."""
    boxes: dict[str, Box] = {}
    for name in (name for name in belief.measurement.sensors if name in belief.sensors):
        if belief.is_picture(name) and detects:
            boxes[name] = outside("shutter", SHUTTER_SIZE)
        else:
            size, n = message_size(described(name), belief, room), belief.samples(name)
            boxes[name] = outside(port_of(name), size if n == 1 else size_of_samples(size, n))
    return boxes


def heard_boxes(belief: Belief, room: Room, detects: bool) -> tuple[list[Box], dict[str, Box]]:
    """Return what says the messages from outside, and which box says each sensor's, detections those of a camera."""
    outer = message_boxes(belief, room, detects)
    seeing, messages = detected(belief, room, outer) if detects else ([], outer)
    return [*outer.values(), *seeing], messages


def detected(belief: Belief, room: Room, messages: dict[str, Box]) -> tuple[list[Box], dict[str, Box]]:
    """Return the detector, if pictures come in, and messages in which the camera's are its detections."""
    if not belief.is_rendered:
        return [], messages
    (seen,) = (name for name in messages if belief.is_picture(name))
    signals = {"shutter": (messages[seen].name, messages[seen].size)}
    box = system_box("detector", make_detector(belief, room), ("detections",), signals)
    return [box], messages | {seen: box}


def solver_boxes(belief: Belief, room: Room, sensor: str, message: Box, at: str) -> list[Box]:
    """Return the boxes that make a fix of a sensor's message, the last one says it; none where none is needed.

    Args:
        belief: what is known of a scenario.
        room: its room as it was surveyed.
        sensor: the sensor's name; one whose message begins with its value needs no fix.
        message: its message.
        at: the box, or its part, of the belief of [x; i] (240) about which the fix is solved. A System reads it in two
            parts, `<sensor>_prior`.
    """
    its, solver = described_per_tick(sensor, belief), None
    make = its.make_onboard
    if belief.samples(sensor) == 1 and its.compiled is not None:
        solver, make = own_fix_box(sensor, its.compiled, len(its.rows), belief, room), None
    elif belief.samples(sensor) == 1 and its.solver is not None:
        solver = its.solver(belief, room)
    if solver is not None:
        return [solver.with_inputs(message=message.name, belief=at)]
    if make is None:
        return []
    system, prior = make(belief, room), f"{sensor}_prior"
    signals = {message_port(system).get_name(): (message.name, message.size)}
    signals |= {"estimate": (f"{prior}.estimate", N_XBAR), "covariance": (f"{prior}.covariance", N_XBAR**2)}
    fix = system_box(f"{sensor}_fix", system, (system.get_output_port().get_name(),), signals)
    return [parts_box(prior).with_inputs(belief=at), fix]
