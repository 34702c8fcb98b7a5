"""The boxes of the tight filter."""

from typing import Any

import numpy as np

from ortilo_drake.diagrams.wiring.messages import solver_boxes
from ortilo_drake.loop.element import Box, bundle, constant
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import DETECTIONS_SIZE, IMU_SIZE, PAYLOAD
from ortilo_drake.onboard.estimator.at_rest import rest_of
from ortilo_drake.onboard.estimator.tight.element import tight_box, tight_handler_box
from ortilo_drake.onboard.estimator.tight.model import aids_of, initial_covariance, layout_of, motion_of, sample_sds
from ortilo_drake.onboard.fix_solver import fix_reader_box
from ortilo_drake.onboard.ranging.sighted import sighted_box
from ortilo_drake.onboard.sample_mean import mean_out
from ortilo_drake.scenario import Belief
from ortilo_drake.sensors.described import described, described_per_tick
from ortilo_drake.sensors.uwb import payload as uwb_payload

_NOTHING = {"imu": IMU_SIZE, "uwb": PAYLOAD, "camera": PAYLOAD}  # size of the message of a sensor that does not fly


def tight_boxes(belief: Belief, room: Room, xbar_0: np.ndarray, messages: dict[str, Box]) -> list[Box]:
    """Return the tight filter, `filter`, and what it hears, `handler`; arguments as of intermittent_boxes."""
    settings: Any = belief.estimator
    sensors, samples = tuple(messages), belief.samples("imu") if "imu" in messages else 1
    layout = layout_of(settings, room, [described(name).measures for name in sensors], belief.h)
    motion, aids = motion_of(settings, layout, belief), aids_of(settings, room, belief)
    payloads = {"uwb": uwb_payload(belief, room), "camera": DETECTIONS_SIZE - PAYLOAD}
    C_0 = initial_covariance(settings, layout, rest_of(belief), sample_sds(settings, samples, belief.h))
    size = sum(payloads.get(name, 0) for name in sensors)
    own = [name for name in sensors if name not in _NOTHING]
    fixing = [fix_boxes(belief, room, name, messages[name]) for name in own]
    solving = [box for boxes in fixing for box in boxes]
    rows = {name: belief.measurement.C_of(name) for name in own}
    kalman = tight_box(layout, motion, aids, samples, size, C_0, xbar_0, rows)
    known = belief.measurement.sensors
    numbers = [known.index(name) if name in messages else -1 for name in ("uwb", "imu", "camera")]
    heard = tight_handler_box(belief.measurement, numbers, samples, layout.clones, aids.angle_sd, belief.h, rows)
    silent = [constant(f"no_{name}", np.zeros(size)) for name, size in _NOTHING.items() if name not in messages]
    said = {name: messages[name].name if name in messages else f"no_{name}" for name in _NOTHING}
    sighted = sighted_box(belief.uwb, room) if "uwb" in messages else None
    if sighted is not None:
        solving.append(sighted.with_inputs(message=said["uwb"], belief="filter"))
        said["uwb"] = sighted.name
    fixes = bundle("fixes", [boxes[-1] for boxes in fixing])
    return [heard.with_inputs(**said), kalman.with_inputs(**said, control="servo"), *silent, *solving, fixes]


def fix_boxes(belief: Belief, room: Room, name: str, message: Box) -> list[Box]:
    """Return the boxes of the fixes of one's own sensors, `<name>_fix`: solved about the filter's belief, or read."""
    solving = solver_boxes(belief, room, name, message, "filter")
    if solving and solving[-1].element.out is not mean_out:
        return solving
    V, read = described_per_tick(name, belief).V(belief), solving[-1] if solving else message
    reader = fix_reader_box(f"{name}_fix", len(described(name).rows), V)
    return [*solving, reader.with_inputs(message=read.name)]
