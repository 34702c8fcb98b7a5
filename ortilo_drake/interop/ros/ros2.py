"""A bridge to a running ROS 2: it publishes a flight with the messages of a log (ros_messages.py) and takes goals."""

from typing import Any, Final, Self

import numpy as np

from ortilo_drake.interop.ros.ros2_node import Ros2Node, message_class
from ortilo_drake.interop.ros.ros_messages import blank_messages, start_messages, tick_messages
from ortilo_drake.interop.ros.ros_motion import GOAL_TOPIC, GOAL_TYPE
from ortilo_drake.scenario import Scenario

FRAME: Final = "map"
_SPINS: Final = 4  # spins of the executor in one call: one takes the newest goal, the others are for ROS's own events


class Ros2Bridge(Ros2Node):
    """A ROS 2 node: `with Ros2Bridge(scenario) as bridge: bridge.send_tick(...)`.

    InputError if rclpy is not installed; on entering, if rclpy does not work or the scenario has no path.
    """

    def __init__(self, scenario: Scenario):
        super().__init__()
        self._scenario, self._room = scenario, scenario.load_room()
        self._goal: np.ndarray | None = None

    def __enter__(self) -> Self:
        first = start_messages(self._scenario, self._room)
        super().__enter__()
        for message in first:
            self.send(message)
        for topic, type_name, _ in blank_messages(self._scenario, self._room, None):  # numba compiles what makes them
            self._publisher(topic, type_name)
        return self

    def _subscribe(self) -> None:
        self._node.create_subscription(message_class(GOAL_TYPE), GOAL_TOPIC, self._take_goal, 1)

    def send_tick(
        self, t: float, state: np.ndarray | None, messages: dict[str, np.ndarray], outputs: dict[str, np.ndarray]
    ) -> None:
        """Publish one tick. Arguments as in ros_messages.tick_messages."""
        for message in tick_messages(t, state, messages, outputs, self._scenario, self._room):
            self.send(message)

    def goal(self) -> np.ndarray | None:
        """Return the newest goal p_W (3) [m] since the last call; None if there is none."""
        for _ in range(_SPINS):
            self._executor.spin_once(timeout_sec=0.0)
        goal, self._goal = self._goal, None
        return goal

    def _take_goal(self, message: Any) -> None:
        p, frame = message.pose.position, message.header.frame_id
        p_W = np.array([p.x, p.y, p.z])
        if frame != FRAME:
            self._node.get_logger().warning(f"{GOAL_TOPIC}: refused: in frame {frame!r}, must be in {FRAME!r}")
        elif not np.isfinite(p_W).all():
            self._node.get_logger().warning(f"{GOAL_TOPIC}: refused: not finite")
        else:
            self._goal = p_W
