"""The boxes of the tight filter."""

from typing import Any

import numpy as np

from ortilo_drake.diagrams.onboard import initial_estimate
from ortilo_drake.diagrams.wiring.fixes import solver_box
from ortilo_drake.loop.element import Box, bundle, constant
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import DETECTIONS_SIZE, IMU_SIZE, PAYLOAD, uwb_size
from ortilo_drake.onboard.estimator.tight.element import heard_box, tight_box
from ortilo_drake.onboard.estimator.tight.model import aids_of, initial_covariance, layout_of, motion_of
from ortilo_drake.onboard.fix_solver import fix_reader_box
from ortilo_drake.scenario import Belief, Scenario
from ortilo_drake.sensors.described import described, flown

_NOTHING = {"imu": IMU_SIZE, "uwb": PAYLOAD, "camera": PAYLOAD}  # size of the message of a sensor that does not fly


def tight_boxes(scenario: Scenario, room: Room, r_0: np.ndarray, messages: dict[str, Box]) -> list[Box]:
    """Return the tight filter, `filter`, and what it hears, `handler`; arguments as of onboard_boxes."""
    belief = scenario.belief
    settings: Any = belief.estimator
    sensors, samples = tuple(messages), scenario.samples("imu") if "imu" in messages else 1
    layout = layout_of(settings, room, sensors, belief.h)
    motion, aids = motion_of(settings, layout, belief), aids_of(settings, room, belief)
    payloads = {"uwb": uwb_size(len(room.anchors)) - PAYLOAD, "camera": DETECTIONS_SIZE - PAYLOAD}
    C_0, size = initial_covariance(settings, layout), sum(payloads.get(name, 0) for name in sensors)
    fixes = [fix_of(belief, room, name, messages[name]) for name in sensors if name not in _NOTHING]
    rows = {name: belief.measurement.C_of(name) for name in sensors if name not in _NOTHING}
    kalman = tight_box(layout, motion, aids, samples, size, C_0, initial_estimate(belief, r_0), rows)
    heard = heard_box(belief.measurement, sensors, samples, layout.clones, aids.angle_sd, belief.h, rows)
    silent = [constant(f"no_{name}", np.zeros(size)) for name, size in _NOTHING.items() if name not in messages]
    said = {name: messages[name].name if name in messages else f"no_{name}" for name in _NOTHING}
    return [heard.reading(**said), kalman.reading(**said, control="servo"), *silent, *fixes, bundle("fixes", fixes)]


def fix_of(belief: Belief, room: Room, name: str, message: Box) -> Box:
    """Return what says the fix of a sensor of one's own: solved of its message about the filter's belief, or read."""
    solver, V = solver_box(belief, room, name), flown(name, belief).V(belief)
    fix = solver or fix_reader_box(f"{name}_fix", len(described(name).rows), V)
    return fix.reading(message=message.name, belief="filter")
