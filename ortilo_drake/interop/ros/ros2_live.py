"""Live topics of ROS 2: messages of the wanted topics come in, estimate and setpoint go out.

The node subscribes to a topic when it sees a publisher, with the publisher's type and reliability.
"""

import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, Final

import numpy as np

from ortilo_drake.interop.ros.ros2_node import Ros2Node, message_class
from ortilo_drake.interop.ros.ros_motion import estimate_messages, setpoint_messages, tf_message
from ortilo_drake.model.typed_yaml import InputError

_DEPTH: Final = 1000  # most messages of a topic that wait, two seconds of an imu at 500 Hz
_LOOK: Final = 0.5  # time between two searches for publishers [s]
_WAIT: Final = 0.05  # longest wait for a message [s]
_SPINS: Final = 3  # after this number of spins without a message none is waiting


class Ros2Live(Ros2Node):
    """The node of `ortilo hil bridge --from ros2`, which subscribes to topics.

    `say` takes a line about each topic that is found, or whose type is not installed. InputError as in Ros2Node; also
    on entering, if ROS does not allow a topic's name.
    """

    def __init__(self, topics: tuple[str, ...], say: Callable[[str], None]):
        super().__init__()
        self._missing, self._say = list(topics), say
        self._heard: list[tuple[int, tuple[str, int, Any]]] = []  # (time of sending [ns], message)

    def _subscribe(self) -> None:
        """Check the names of the topics; the node subscribes to them later, when they have a publisher."""
        for topic in self._missing:
            try:
                self._node.get_publishers_info_by_topic(topic)
            except ValueError as error:
                raise InputError(f"topic {topic!r}: {str(error).split(': ')[-1].split(', at ')[0]}") from None

    def messages(self) -> Iterator[tuple[str, int, Any] | None]:
        """Yield (topic, time of receipt [ns], message) without end; None where no message comes within a short time."""
        looked = -np.inf
        while True:
            now = time.monotonic()
            if self._missing and now - looked > _LOOK:
                looked = now
                self._look()
            self._executor.spin_once(timeout_sec=_WAIT)
            if not self._heard:
                yield None
                continue
            self._drain()
            heard, self._heard = sorted(self._heard, key=lambda one: one[0]), []
            for _, message in heard:
                yield message

    def _drain(self) -> None:
        """Take all waiting messages: the executor takes topics in turn, so a topic of a high rate would fall behind."""
        empty = 0
        while empty < _SPINS and len(self._heard) < _DEPTH:
            before = len(self._heard)
            self._executor.spin_once(timeout_sec=0.0)
            empty = empty + 1 if len(self._heard) == before else 0

    def send_estimate(self, t: float, estimate: np.ndarray, covariance: np.ndarray) -> None:
        """Publish an estimate (15) and its covariance (15, 15), with the stamp t [s] by the sensors' clock."""
        for message in (*estimate_messages(t, estimate, covariance.ravel()), tf_message(t, estimate)):
            self.send(message)

    def send_setpoint(self, t: float, rpy: np.ndarray, thrust: float) -> None:
        """Publish the demanded attitude of B in W, roll, pitch, yaw (3) [rad], and thrust over mass [m/s²]."""
        for message in setpoint_messages(t, rpy, thrust):
            self.send(message)

    def _look(self) -> None:
        """Subscribe to the topics that have got a publisher."""
        for topic in list(self._missing):
            offers = self._node.get_publishers_info_by_topic(topic)
            if not offers:
                continue
            self._missing.remove(topic)
            offered = offers[0]
            try:
                kind = message_class(offered.topic_type)
            except (ImportError, AttributeError, ValueError):
                self._say(f"{topic}: left out: its type {offered.topic_type} is not installed")
                continue
            quality = self._qos.QoSProfile(depth=_DEPTH, reliability=offered.qos_profile.reliability)
            self._node.create_subscription(kind, topic, partial(self._take, topic), quality)
            self._say(f"{topic}: {offered.topic_type}")

    def _take(self, topic: str, message: Any, info: Any) -> None:
        now = time.time_ns()
        self._heard.append((info.get("source_timestamp") or now, (topic, now, message)))
