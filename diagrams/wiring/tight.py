"""The boxes of the tight filter."""

from typing import Any

import numpy as np

from ortilo_drake.loop.element import Box, constant
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import DETECTIONS_SIZE, IMU_SIZE, PAYLOAD, uwb_size
from ortilo_drake.onboard.estimator.tight.element import heard_box, tight_box
from ortilo_drake.onboard.estimator.tight.model import aids_of, initial_covariance, layout_of, motion_of
from ortilo_drake.scenario import Belief

_NOTHING = {"imu": IMU_SIZE, "uwb": PAYLOAD, "camera": PAYLOAD}  # size of the message of a sensor that does not fly


def tight_boxes(belief: Belief, room: Room, xbar_0: np.ndarray, messages: dict[str, Box]) -> list[Box]:
    """Return the tight filter, `filter`, and what it hears, `handler`; arguments as of intermittent_boxes.

    Raises:
        ValueError: if a sensor of one's own flies, whose fixes no element takes.
    """
    own = [name for name in messages if name not in _NOTHING]
    if own:
        raise ValueError(f"sensors: {own[0]}: has no compiled form with estimator.kind {belief.estimator.kind}")
    settings: Any = belief.estimator
    sensors, samples = tuple(messages), belief.samples("imu") if "imu" in messages else 1
    layout = layout_of(settings, room, sensors, belief.h)
    motion, aids = motion_of(settings, layout, belief), aids_of(settings, room, belief)
    payloads = {"uwb": uwb_size(len(room.anchors)) - PAYLOAD, "camera": DETECTIONS_SIZE - PAYLOAD}
    C_0, size = initial_covariance(settings, layout), sum(payloads.get(name, 0) for name in sensors)
    kalman = tight_box(layout, motion, aids, samples, size, C_0, xbar_0)
    heard = heard_box(belief.measurement, sensors, samples, layout.clones, aids.angle_sd, belief.h)
    silent = [constant(f"no_{name}", np.zeros(size)) for name, size in _NOTHING.items() if name not in messages]
    said = {name: messages[name].name if name in messages else f"no_{name}" for name in _NOTHING}
    return [heard.reading(**said), kalman.reading(**said, control="servo"), *silent]
