"""A ROS 2 node as a context manager: it makes publishers at their first use and writes plain fields into messages.

rclpy is imported only when a node is entered. ROS stays on this machine unless ROS_AUTOMATIC_DISCOVERY_RANGE is set
(the default of ROS itself is SUBNET).
"""

import os
from array import array
from functools import cache
from importlib import import_module
from types import TracebackType
from typing import Any, Final, Self

import numpy as np

from ortilo_drake.interop.ros.ros_messages import LATCHED
from ortilo_drake.interop.ros.ros_sensors import IMAGE_TOPIC
from ortilo_drake.interop.ros.ros_types import Fields, RosMessage
from ortilo_drake.model.optional import is_installed
from ortilo_drake.model.typed_yaml import InputError

NODE: Final = "ortilo"
_DEPTH: Final = 10


@cache
def message_class(type_name: str) -> Any:
    """Return rclpy's class of a type, package/msg/Name or package/Name; ImportError if the package is missing."""
    package, *_, name = type_name.split("/")
    return getattr(import_module(f"{package}.msg"), name)


def fill(message: Any, fields: Fields) -> Any:
    """Write plain nested fields into an rclpy message and return the message; absent fields stay as they are.

    The values in the message decide the types: an inner message is filled, an array keeps its element type.
    AttributeError if there is no such field.
    """
    for name, value in fields.items():
        setattr(message, name, _value(message, name, value))
    return message


def _value(message: Any, name: str, value: Any) -> Any:
    there = getattr(message, name)
    if isinstance(value, dict):
        return fill(there, value)
    if isinstance(there, array):
        return array(there.typecode, np.ascontiguousarray(value, there.typecode).tobytes())
    if isinstance(there, np.ndarray):
        return np.asarray(value, there.dtype)
    if isinstance(there, list):
        kind = message.get_fields_and_field_types()[name]  # sequence<package/Name>
        item = message_class(kind.removeprefix("sequence<").removesuffix(">"))
        return [fill(item(), fields) for fields in value]
    return type(there)(value)  # ROS refuses a NumPy number in place of an integer


class Ros2Node:
    """A node that publishes: `with Ros2Node() as node: node.send(...)`.

    Messages that are sent once are kept for later subscribers (transient local). Pictures go as sensor data (best
    effort), all other messages reliably. A topic is left out, with one line in ROS's log, if the package of its type is
    missing. InputError if rclpy is not installed, or, on entering, does not work.
    """

    def __init__(self) -> None:
        if not is_installed("rclpy"):
            ways = "source a ROS 2 for this Python, or on Linux with Python 3.11: pip install 'ortilo-drake[ros2]'"
            raise InputError(f"rclpy: is not installed, needed for this: {ways}")
        self._publishers: dict[str, Any] = {}

    def __enter__(self) -> Self:
        os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        try:
            rclpy = import_module("rclpy")
            self._qos = import_module("rclpy.qos")
            executors = import_module("rclpy.executors")
            self._context = rclpy.Context()
            self._context.init(args=[])  # unlike rclpy.init, this leaves Ctrl-C to us
            self._node = rclpy.create_node(NODE, context=self._context, start_parameter_services=False)
            self._executor = executors.SingleThreadedExecutor(context=self._context)
            self._executor.add_node(self._node)
            self._subscribe()
        except (ImportError, RuntimeError) as error:
            raise InputError(f"rclpy: does not work here: {' '.join(str(error).split())}") from None
        return self

    def _subscribe(self) -> None:
        """Subscribe to the topics that are read from the start; a subclass may override this."""

    def send(self, message: RosMessage) -> None:
        """Publish a message."""
        topic, type_name, fields = message
        publisher = self._publisher(topic, type_name)
        if publisher is not None:
            publisher.publish(fill(message_class(type_name)(), fields))

    def _publisher(self, topic: str, type_name: str) -> Any:
        if topic not in self._publishers:
            try:
                kind = message_class(type_name)
                self._publishers[topic] = self._node.create_publisher(kind, topic, self._quality(topic))
            except ImportError:
                package = type_name.partition("/")[0]
                self._node.get_logger().warning(f"{topic}: left out: {package} is not installed")
                self._publishers[topic] = None
        return self._publishers[topic]

    def _quality(self, topic: str) -> Any:
        if topic == IMAGE_TOPIC:
            return self._qos.qos_profile_sensor_data
        if topic in LATCHED:
            return self._qos.QoSProfile(depth=1, durability=self._qos.DurabilityPolicy.TRANSIENT_LOCAL)
        return self._qos.QoSProfile(depth=_DEPTH)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Shut the node and ROS down."""
        self._executor.shutdown()
        self._node.destroy_node()
        self._context.try_shutdown()
