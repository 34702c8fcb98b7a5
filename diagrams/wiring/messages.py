"""The messages of the sensors that fly, as they come to an onboard half that is alone."""

from ortilo_drake.loop.element import Box, outside
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import SHUTTER_SIZE, size_of_samples
from ortilo_drake.scenario import Belief
from ortilo_drake.sensors.described import described, port_of
from ortilo_drake.sensors.messages import message_size


def message_boxes(belief: Belief, room: Room, detects: bool) -> dict[str, Box]:
    """Return the box of each sensor's messages; for a camera whose pictures are processed here, its shutter's."""
    boxes: dict[str, Box] = {}
    for name in belief.measurement.sensors:
        if name not in belief.sensors:
            continue
        if belief.is_picture(name) and detects:
            boxes[name] = outside("shutter", SHUTTER_SIZE)
            continue
        size, n = message_size(described(name), belief, room), belief.samples(name)
        boxes[name] = outside(port_of(name), size if n == 1 else size_of_samples(size, n))
    return boxes
