"""Live topics of ROS 2: the messages of those that are asked for, and the estimate and the setpoint out.

A topic is subscribed to when its publisher is seen, with its type and as reliably as it is published.
"""

import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, Final

import numpy as np

from ortilo_drake.interop.ros.ros2_node import Ros2Node, message_class
from ortilo_drake.interop.ros.ros_motion import estimate_messages, setpoint_messages, tf_message
from ortilo_drake.model.typed_yaml import InputError

_DEPTH: Final = 1000  # messages of a topic that may wait: two seconds of an imu at 500 Hz
_LOOK: Final = 0.5  # between two looks for topics [s]
_WAIT: Final = 0.05  # for a message [s]
_SPINS: Final = 3  # of the executor that bring no message: then none waits


class Ros2Live(Ros2Node):
    """The node of `ortilo hil bridge --from ros2`, which listens to topics.

    `say` takes a line about a topic that is found, or whose type is not installed. InputError as Ros2Node, or on
    entering, if a topic's name is none that ROS allows.
    """

    def __init__(self, topics: tuple[str, ...], say: Callable[[str], None]):
        super().__init__()
        self._missing, self._say = list(topics), say
        self._heard: list[tuple[int, tuple[str, int, Any]]] = []  # each after the time at which it was sent [ns]

    def _subscribe(self) -> None:
        """Check the topics' names; they are subscribed to when they have a publisher."""
        for topic in self._missing:
            try:
                self._node.get_publishers_info_by_topic(topic)
            except ValueError as error:
                raise InputError(f"topic {topic!r}: {str(error).split(': ')[-1].split(', at ')[0]}") from None

    def messages(self) -> Iterator[tuple[str, int, Any] | None]:
        """Yield topic, time of receipt [ns] and message without end; None where none comes for a while."""
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
        """Take all messages that wait: the executor takes turns, and a topic of many would fall behind the others."""
        empty = 0
        while empty < _SPINS and len(self._heard) < _DEPTH:
            before = len(self._heard)
            self._executor.spin_once(timeout_sec=0.0)
            empty = empty + 1 if len(self._heard) == before else 0

    def send_estimate(self, t: float, estimate: np.ndarray, covariance: np.ndarray) -> None:
        """Publish an estimate (15) and its covariance (15, 15), stamped by the sensors' clock [s]."""
        for message in (*estimate_messages(t, estimate, covariance.ravel()), tf_message(t, estimate)):
            self.send(message)

    def send_setpoint(self, t: float, rpy: np.ndarray, thrust: float) -> None:
        """Publish an attitude (3) [rad] and the thrust over the mass [m/s²] that are asked for."""
        for message in setpoint_messages(t, rpy, thrust):
            self.send(message)

    def _look(self) -> None:
        """Subscribe to the topics that have a publisher by now."""
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
