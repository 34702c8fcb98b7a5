"""ROS 2 messages of the sensors; each stamp is the time at which the content was true."""

import numpy as np

from ortilo_drake.flight.signals import Signals
from ortilo_drake.interop.ros.picture_codec import decode_png, encode_png
from ortilo_drake.interop.ros.ros_motion import quaternion
from ortilo_drake.interop.ros.ros_types import (
    Fields,
    RosMessage,
    header_fields,
    quaternion_fields,
    transform_fields,
    vector_fields,
)
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import ARRIVED, DETECTION_SIZE, PAYLOAD, STAMP, samples_in
from ortilo_drake.scenario import Scenario

IMAGE_TOPIC = "/camera/image/compressed"
IMAGE_TYPE = "sensor_msgs/msg/CompressedImage"

_Q_BC = (0.5, -0.5, 0.5, -0.5)  # pinhole.R_BC as a quaternion (x, y, z, w)


def sensor_messages(t: float, messages: Signals, scenario: Scenario, room: Room) -> list[RosMessage]:
    """Return the messages of all sensors that arrived in the tick at t [s]; see ros_messages.tick_messages."""
    sent = []
    if _arrived(messages, "imu"):
        n = scenario.samples("imu")
        samples = samples_in(messages["imu"], n) if n > 1 else [messages["imu"]]
        sent += [imu_message(sample, scenario) for sample in samples if sample[ARRIVED] == 1.0]
    if _arrived(messages, "uwb"):
        sent += range_messages(messages["uwb"], scenario)
    if _arrived(messages, "detections"):
        sent.append(detections_message(messages["detections"], room))
    if "image" in messages:
        stamp = messages["shutter"][STAMP] if "shutter" in messages else t
        sent.append(image_message(stamp, messages["image"]))
    return sent


def _arrived(messages: Signals, name: str) -> bool:
    return name in messages and messages[name][ARRIVED] == 1.0


def _isotropic(sd: float) -> list[float]:
    return [sd**2, 0.0, 0.0, 0.0, sd**2, 0.0, 0.0, 0.0, sd**2]


def imu_message(imu: np.ndarray, scenario: Scenario) -> RosMessage:
    """Return the ROS message of an imu message, or of one of its samples, with the stamp of the sample."""
    sds = scenario.imu.sds(scenario.h / scenario.samples("imu"))
    payload = imu[PAYLOAD:].tolist()
    return (
        "/imu/data",
        "sensor_msgs/msg/Imu",
        {
            "header": header_fields(imu[STAMP], "base_link"),
            "orientation": quaternion_fields(quaternion(np.array(imu[PAYLOAD : PAYLOAD + 3])).tolist()),
            "orientation_covariance": _isotropic(sds[0]),
            "angular_velocity": vector_fields(payload[3:6]),
            "angular_velocity_covariance": _isotropic(sds[1]),
            "linear_acceleration": vector_fields(payload[6:9]),
            "linear_acceleration_covariance": _isotropic(sds[2]),
        },
    )


def range_messages(uwb: np.ndarray, scenario: Scenario) -> list[RosMessage]:
    """Return a message for each anchor whose range arrived. The radiation type is 0: ROS has no value for radio.

    For differences of ranges the list is empty: ROS has no message type for them.
    """
    if scenario.uwb.kind == "differences":
        return []
    ranges, there = uwb[PAYLOAD:].reshape(2, -1)
    view = {"field_of_view": 2 * np.pi, "max_range": scenario.uwb.max_distance}
    return [
        (
            f"/uwb/anchor_{i}",
            "sensor_msgs/msg/Range",
            {"header": header_fields(uwb[STAMP], f"anchor_{i}"), "range": float(ranges[i]), **view},
        )
        for i in np.flatnonzero(there)
    ]


def detections_message(detections: np.ndarray, room: Room) -> RosMessage:
    """Return the message of the detected boxes; the centre of a pixel has integer coordinates."""
    header = header_fields(detections[STAMP], "camera_optical")
    rows = detections[PAYLOAD:].reshape(-1, DETECTION_SIZE)
    found = [
        {
            "header": header,
            "results": [{"hypothesis": {"class_id": room.classes[int(label)], "score": score}}],
            "bbox": {
                "center": {"position": {"x": (u_min + u_max) / 2, "y": (v_min + v_max) / 2}},
                "size_x": u_max - u_min,
                "size_y": v_max - v_min,
            },
        }
        for label, score, u_min, v_min, u_max, v_max in rows[rows[:, 0] >= 0].tolist()
    ]
    return "/camera/detections", "vision_msgs/msg/Detection2DArray", {"header": header, "detections": found}


def image_message(stamp: float, image: np.ndarray) -> RosMessage:
    """Return the message of a picture (height, width, 4), RGBA of 8 bits, as lossless PNG."""
    fields = {
        "header": header_fields(stamp, "camera_optical"),
        "format": "png",
        "data": np.frombuffer(encode_png(image), np.uint8),
    }
    return IMAGE_TOPIC, IMAGE_TYPE, fields


def image_of(png: np.ndarray) -> np.ndarray:
    """Return the picture (height, width, 4), RGBA of 8 bits, given the PNG of an image_message."""
    return decode_png(png.tobytes())


def fixed_frames_message(room: Room) -> RosMessage:
    """Return the message of the fixed transforms: map -> anchors, and base_link -> camera_optical."""
    upright = [0.0, 0.0, 0.0, 1.0]
    frames = [transform_fields(0.0, f"anchor_{i}", [*p_W, *upright]) for i, p_W in enumerate(room.anchors)]
    camera: Fields = transform_fields(0.0, "camera_optical", [*room.camera.position, *_Q_BC])
    camera["header"] = header_fields(0.0, "base_link")
    return "/tf_static", "tf2_msgs/msg/TFMessage", {"transforms": [*frames, camera]}
