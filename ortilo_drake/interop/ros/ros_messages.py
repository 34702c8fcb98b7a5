"""One tick of a flight as ROS 2 messages: plain functions from signals to (topic, type, fields).

Fields are plain nested dicts, lists, numbers and arrays, so that the writer of a log and the bridge to a running ROS 2
take the same fields; absent fields are zero. Frames follow REP 103 and 105: map is W (east, north, up), base_link is B
(forward, left, up), camera_optical is C (right, down, forward), anchor_<i> has its origin at an anchor.

    /truth/pose, /truth/odometry        the true state, where it is known
    /estimate/pose, /estimate/odometry  the filter's prediction and its covariance
    /reference/pose, /reference/path    the reference at this tick; the planned path, once
    /goal_pose                          a goal, in the tick from which the vehicle heads for it
    /imu/data, /uwb/anchor_<i>, /camera/image/compressed, /camera/detections   messages that arrived in this tick
    /tf, /tf_static                     map -> base_link, of the truth if known, else of the estimate; fixed frames
    /ortilo/scenario                    the scenario and the software's version as JSON, once
    /ortilo/<signal>                    every signal and message vector to the last bit (model/signals.py)
"""

import json
from functools import cache

import numpy as np
from pydrake.trajectories import Trajectory

from ortilo_drake import __version__
from ortilo_drake.flight.signals import Signals, output_sizes
from ortilo_drake.interop.ros.ros_motion import (
    estimate_messages,
    goal_message,
    path_message,
    reference_message,
    tf_message,
    truth_messages,
)
from ortilo_drake.interop.ros.ros_sensors import fixed_frames_message, sensor_messages
from ortilo_drake.interop.ros.ros_types import Fields, RosMessage
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import CONTROL_NAMES, N_XBAR, STATE_NAMES, XBAR_NAMES
from ortilo_drake.onboard.planner.planned import planned
from ortilo_drake.scenario import Scenario
from ortilo_drake.scenario.scenario import FORMAT as SCENARIO_FORMAT

SCENARIO_TOPIC = "/ortilo/scenario"
SIGNAL_PREFIX = "/ortilo/"
ARRAY_TYPE = "std_msgs/msg/Float64MultiArray"
STRING_TYPE = "std_msgs/msg/String"
LATCHED = (SCENARIO_TOPIC, "/tf_static", "/reference/path")  # sent once, also for later subscribers
TAKEN, SENT = "taken", "sent"  # messages as the onboard half received them, or as a world in real time sent them
FORMAT = 2  # format of /ortilo/scenario and the /ortilo/ signals; a reader refuses any other

_LABELS = {
    "state": ",".join(STATE_NAMES),
    "control": ",".join(CONTROL_NAMES),
    "y": "values of the sensors, /ortilo/scenario says which",
    "delta": "1 for each sensor whose value arrived",
    "V2": "covariance of each sensor's value, row by row",
    "estimate": ",".join(XBAR_NAMES),
    "reference": "r (3), its velocity (3), its acceleration (3)",
}


@cache
def _layout(name: str, size: int) -> Fields:
    if name == "covariance":
        labels = [("row", N_XBAR, size), ("column", N_XBAR, N_XBAR)]
    else:
        labels = [(_LABELS.get(name, f"message {name}: arrived, stamp, payload"), size, size)]
    return {"dim": [{"label": label, "size": n, "stride": stride} for label, n, stride in labels], "data_offset": 0}


def signal_message(name: str, signal: np.ndarray) -> RosMessage:
    """Return the message of a signal or message vector, with its exact values."""
    return f"{SIGNAL_PREFIX}{name}", ARRAY_TYPE, {"layout": _layout(name, signal.size), "data": signal}


def tick_messages(
    t: float, state: np.ndarray | None, messages: Signals, outputs: Signals, scenario: Scenario, room: Room
) -> list[RosMessage]:
    """Return all ROS messages of the tick at t_k = k h [s] of a scenario in its room.

    `state` is the true x (12), None if unknown. `messages` went to the onboard half in this tick: message vectors by
    port, 'image', and 'goal' (2) [m]. `outputs` are the signals of the onboard half at t_k: control, y, delta, V2,
    estimate, covariance, reference.
    """
    sent = [signal_message(name, value) for name, value in messages.items() if name not in ("image", "goal")]
    sent += [signal_message(name, value) for name, value in outputs.items()]
    if state is not None:
        sent += [signal_message("state", state), *truth_messages(t, state), tf_message(t, state)]
    if "estimate" in outputs and "covariance" in outputs:
        sent += estimate_messages(t, outputs["estimate"], outputs["covariance"])
        if state is None:
            sent.append(tf_message(t, outputs["estimate"]))
    if "reference" in outputs:
        sent.append(reference_message(t, outputs["reference"], scenario.yaw))
    if "goal" in messages:
        sent.append(goal_message(t, messages["goal"]))
    return sent + sensor_messages(t, messages, scenario, room)


def blank_messages(scenario: Scenario, room: Room, state: np.ndarray | None) -> list[RosMessage]:
    """Return the messages of a tick whose signals are all zero; with them numba compiles every function."""
    outputs = {name: np.zeros(size) for name, size in output_sizes(scenario.measurement).items()}
    return tick_messages(0.0, state, {}, outputs, scenario, room)


def start_messages(scenario: Scenario, room: Room, messages: str = SENT) -> list[RosMessage]:
    """Return the messages sent once, before the first tick: scenario, fixed frames, planned path if there is one.

    `messages` says whether the messages of ticks are TAKEN or SENT; a listener on the bus knows only what was sent.
    InputError if planning finds no path.
    """
    description = {
        "format": FORMAT,
        "software": f"ortilo-drake {__version__}",
        "scenario": scenario.model_dump_json(),
        "scenario_format": SCENARIO_FORMAT,
        "messages": messages,
    }
    sent = [(SCENARIO_TOPIC, STRING_TYPE, {"data": json.dumps(description)}), fixed_frames_message(room)]
    path = planned(scenario)
    return [*sent, path_message(path, scenario.yaw)] if isinstance(path, Trajectory) else sent
