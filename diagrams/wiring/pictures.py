"""The box that looks at the pictures of a camera that renders."""

from ortilo_drake.diagrams.wiring.systems import system_box
from ortilo_drake.loop.element import Box
from ortilo_drake.model.room import Room
from ortilo_drake.onboard.detector.detector import Detector
from ortilo_drake.onboard.detector.detector_network import load_detector
from ortilo_drake.scenario import Belief


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
