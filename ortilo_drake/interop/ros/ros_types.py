"""The common parts of ROS 2 messages, as plain nested dicts, and message types without a ROS installation.

Definitions, hashes and CDR bytes come from rosbags' store of ROS 2 Jazzy. The store lacks vision_msgs, so the
definitions of vision_msgs 4 stand here.
"""

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from ortilo_drake.model.optional import later

Fields = dict[str, Any]
RosMessage = tuple[str, str, Fields]  # topic, type, fields
_BASE, _NAME = 1, 2  # rosbags' kinds of a field: number or text, another message; all other kinds are arrays of these
_VISION = {
    "Point2D": "float64 x\nfloat64 y\n",
    "Pose2D": "vision_msgs/Point2D position\nfloat64 theta\n",
    "BoundingBox2D": "vision_msgs/Pose2D center\nfloat64 size_x\nfloat64 size_y\n",
    "ObjectHypothesis": "string class_id\nfloat64 score\n",
    "ObjectHypothesisWithPose": "vision_msgs/ObjectHypothesis hypothesis\ngeometry_msgs/PoseWithCovariance pose\n",
    "Detection2D": (
        "std_msgs/Header header\nvision_msgs/ObjectHypothesisWithPose[] results\n"
        "vision_msgs/BoundingBox2D bbox\nstring id\n"
    ),
    "Detection2DArray": "std_msgs/Header header\nvision_msgs/Detection2D[] detections\n",
}


def to_ns(t: float) -> int:
    """Return a time [s] in whole nanoseconds; logs and stamps count from the start of the flight."""
    return round(t * 1e9)


def header_fields(t: float, frame: str) -> Fields:
    """Return a std_msgs/Header with a time [s] and a frame."""
    seconds, nanoseconds = divmod(to_ns(t), 1_000_000_000)
    return {"stamp": {"sec": seconds, "nanosec": nanoseconds}, "frame_id": frame}


def vector_fields(v: list[float]) -> Fields:
    """Return a geometry_msgs/Vector3 or Point."""
    return {"x": v[0], "y": v[1], "z": v[2]}


def quaternion_fields(q: list[float]) -> Fields:
    """Return a geometry_msgs/Quaternion from (x, y, z, w)."""
    return {"x": q[0], "y": q[1], "z": q[2], "w": q[3]}


def pose_fields(motion: list[float]) -> Fields:
    """Return a geometry_msgs/Pose from a motion, a result of ros_motion.pose_and_twist (13) or its first 7 entries."""
    return {"position": vector_fields(motion[0:3]), "orientation": quaternion_fields(motion[3:7])}


def twist_fields(motion: list[float]) -> Fields:
    """Return a geometry_msgs/Twist from a motion (13)."""
    return {"linear": vector_fields(motion[7:10]), "angular": vector_fields(motion[10:13])}


def transform_fields(t: float, child: str, motion: list[float]) -> Fields:
    """Return a geometry_msgs/TransformStamped from map to the frame `child`, from the first 7 entries of a motion."""
    transform = {"translation": vector_fields(motion[0:3]), "rotation": quaternion_fields(motion[3:7])}
    return {"header": header_fields(t, "map"), "child_frame_id": child, "transform": transform}


typesys = later("rosbags.typesys")


@cache
def typestore() -> Any:
    """Return the store of all message types of a log."""
    store = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
    for name, text in _VISION.items():
        store.register(typesys.get_types_from_msg(text, f"vision_msgs/msg/{name}"))
    return store


@cache
def definition(type_name: str) -> str:
    """Return the definitions of a type and of all types that it uses, as an MCAP schema with the encoding ros2msg."""
    return typestore().generate_msgdef(type_name, ros_version=2)[0]


def _field_maker(node: tuple[Any, Any]) -> tuple[Callable[[Any], Any] | None, Callable[[], Any]]:
    """Return two functions of a field: plain value -> field's value (None if equal), and () -> default value."""
    kind, detail = node
    if kind == _BASE:
        nothing = {"string": "", "bool": False}.get(detail[0], 0)
        return None, lambda: nothing
    if kind == _NAME:
        make = message_maker(detail)
        return make, lambda: make({})
    (inner_kind, inner), size = detail
    if inner_kind == _NAME:
        make_item = message_maker(inner)
        return lambda values: [make_item(value) for value in values], list
    if inner[0] == "string":
        return list, list
    dtype = np.dtype(inner[0])
    return lambda values: np.ascontiguousarray(values, dtype), lambda: np.zeros(size, dtype)


@cache
def message_maker(type_name: str) -> Callable[[Fields], object]:
    """Return a function from plain nested fields to a rosbags message; absent fields are zero or empty."""
    store = typestore()
    makers = [(name, *_field_maker(node)) for name, node in store.fielddefs[type_name][1]]
    message_type = store.types[type_name]

    def make(fields: Fields) -> object:
        values = []
        for name, value_of, default in makers:
            if name not in fields:
                values.append(default())
            else:
                values.append(fields[name] if value_of is None else value_of(fields[name]))
        return message_type(*values)

    return make


def to_cdr(type_name: str, fields: Fields) -> bytes:
    """Return the little-endian CDR bytes of a message."""
    return bytes(typestore().serialize_cdr(message_maker(type_name)(fields), type_name))


def from_cdr(type_name: str, data: bytes) -> Any:
    """Return the rosbags message that CDR bytes hold."""
    return typestore().deserialize_cdr(data, type_name)
