"""The messages of the sensors as they come to an onboard half that is alone, and what looks at pictures."""

from ortilo_drake.diagrams.wiring.systems import system_box
from ortilo_drake.loop.element import Box, outside
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import SHUTTER_SIZE, size_of_samples
from ortilo_drake.onboard.detector.detector import Detector
from ortilo_drake.onboard.detector.detector_network import load_detector
from ortilo_drake.scenario import Belief
from ortilo_drake.sensors.described import described, port_of
from ortilo_drake.sensors.messages import message_size


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


def make_detector(scenario: Belief, room: Room) -> Detector:
    """Return the detector of a rendered camera's pictures; InputError if its files are wrong."""
    camera = room.camera.scaled_to(scenario.camera.width)
    size = camera.width, camera.height
    detect = load_detector(scenario.detector, room, size)
    return Detector(detect, size, scenario.camera.latency, scenario.h)


def detected(belief: Belief, room: Room, messages: dict[str, Box]) -> tuple[list[Box], dict[str, Box]]:
    """Return the detector, if pictures come in, and messages in which the camera's are its detections."""
    if not belief.is_rendered:
        return [], messages
    (seen,) = (name for name in messages if belief.is_picture(name))
    signals = {"shutter": (messages[seen].name, messages[seen].size)}
    box = system_box("detector", make_detector(belief, room), ("detections",), signals)
    return [box], messages | {seen: box}
