"""The parts that ROS 2 messages share, as plain nested dicts."""

from typing import Any

Fields = dict[str, Any]
RosMessage = tuple[str, str, Fields]  # topic, type, fields


def to_ns(t: float) -> int:
    """Return a time [s] in whole nanoseconds; log and stamps count from the flight's start."""
    return round(t * 1e9)


def header_fields(t: float, frame: str) -> Fields:
    """Return a std_msgs/Header of a time [s] and a frame."""
    seconds, nanoseconds = divmod(to_ns(t), 1_000_000_000)
    return {"stamp": {"sec": seconds, "nanosec": nanoseconds}, "frame_id": frame}


def vector_fields(v: list[float]) -> Fields:
    """Return a geometry_msgs/Vector3 or Point."""
    return {"x": v[0], "y": v[1], "z": v[2]}


def quaternion_fields(q: list[float]) -> Fields:
    """Return a geometry_msgs/Quaternion from (x, y, z, w)."""
    return {"x": q[0], "y": q[1], "z": q[2], "w": q[3]}


def pose_fields(motion: list[float]) -> Fields:
    """Return a geometry_msgs/Pose from a motion, body_motion.pose_and_twist's (13), or its first seven."""
    return {"position": vector_fields(motion[0:3]), "orientation": quaternion_fields(motion[3:7])}


def twist_fields(motion: list[float]) -> Fields:
    """Return a geometry_msgs/Twist from a motion (13)."""
    return {"linear": vector_fields(motion[7:10]), "angular": vector_fields(motion[10:13])}


def transform_fields(t: float, child: str, motion: list[float]) -> Fields:
    """Return a geometry_msgs/TransformStamped from map to a child, whose pose is the motion's first seven."""
    transform = {"translation": vector_fields(motion[0:3]), "rotation": quaternion_fields(motion[3:7])}
    return {"header": header_fields(t, "map"), "child_frame_id": child, "transform": transform}
