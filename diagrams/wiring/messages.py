"""The messages of the sensors as an onboard half hears them, and what makes detections and fixes of them."""

from ortilo_drake.diagrams.wiring.systems import system_box
from ortilo_drake.loop.element import Box, outside
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import N_XBAR, SHUTTER_SIZE, size_of_samples
from ortilo_drake.onboard.detector.detector_network import make_detector
from ortilo_drake.onboard.estimator.filter_element import parts_box
from ortilo_drake.onboard.fix_solver import own_fix_box
from ortilo_drake.onboard.sample_mean import mean_fix_box, sample_mean_box
from ortilo_drake.scenario import Belief
from ortilo_drake.sensors.described import described, port_of
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
    its, n, boxes = described(sensor), belief.samples(sensor), list[Box]()
    if n > 1:
        boxes.append(message := sample_mean_box(f"{sensor}_mean", message, n))
    if its.compiled is not None:
        solver = own_fix_box(sensor, its.compiled, len(its.rows), belief.sampled_for(sensor), room)
    else:
        solver = None if its.solver is None else its.solver(belief, room)
    if solver is not None:
        boxes.append(solver.with_inputs(message=message.name, belief=at))
    elif its.compiled is None and its.make_onboard is not None:
        system, prior = its.make_onboard(belief, room), f"{sensor}_prior"
        signals = {message_port(system).get_name(): (message.name, message.size)}
        signals |= {"estimate": (f"{prior}.estimate", N_XBAR), "covariance": (f"{prior}.covariance", N_XBAR**2)}
        boxes.append(parts_box(prior).with_inputs(belief=at))
        boxes.append(system_box(f"{sensor}_fix", system, (system.get_output_port().get_name(),), signals))
    if n > 1 and its.V(belief) is None:  # the covariance comes with the fix
        boxes.append(mean_fix_box(f"{sensor}_mean_fix", boxes[-1], len(its.rows), n))
    return boxes
