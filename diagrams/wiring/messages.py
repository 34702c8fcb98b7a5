"""The messages of the sensors that fly, as they come to an onboard half that is alone."""

from ortilo_drake.diagrams.wiring.onboard import port_of
from ortilo_drake.loop.element import Box, outside
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import DETECTIONS_SIZE, IMU_SIZE, SHUTTER_SIZE, size_of_samples, uwb_size
from ortilo_drake.scenario import Belief
from ortilo_drake.sensors.described import described
from ortilo_drake.sensors.messages import message_size


def message_boxes(belief: Belief, room: Room, detects: bool) -> dict[str, Box]:
    """Return what stands for each sensor's messages: of a camera whose pictures are looked at here its shutter's."""
    sizes = {"uwb": uwb_size(len(room.anchors)), "camera": DETECTIONS_SIZE, "imu": IMU_SIZE}
    boxes: dict[str, Box] = {}
    for name in belief.measurement.sensors:
        if name not in belief.sensors:
            continue
        if name == "camera" and belief.is_rendered and detects:
            boxes[name] = outside("shutter", SHUTTER_SIZE)
            continue
        size, n = sizes.get(name) or message_size(described(name), belief, room), belief.samples(name)
        boxes[name] = outside(port_of(name), size if n == 1 else size_of_samples(size, n))
    return boxes
