"""Topics of ROS 2 in and out, another process playing the sensors; needs rclpy."""

import importlib.util
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from live_messages import START
from made_up_motion import BAG_MAP, made_up, write_bag
from ros_domain import own_domain
from waiting import HANGS

from ortilo_drake.interop.recorded.map_file import load_map
from ortilo_drake.interop.recorded.recording import read_recording
from ortilo_drake.interop.ros.ros2_live import Ros2Live
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.studies.recorded.replayed import RAW, replay

pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("rclpy") is None,
    reason="rclpy is not installed: pip install 'ortilo-drake[ros2]'; wheels exist for Python 3.11 only",
)
PLAYER = """
import sys, time
from pathlib import Path
import numpy as np, rclpy
from nav_msgs.msg import Odometry
from rclpy.executors import SingleThreadedExecutor
from ortilo_drake.interop.recorded.bag_columns import at_pace, bag_messages
from ortilo_drake.interop.ros.ros2_node import fill, message_class

types = {"/imu": "sensor_msgs/msg/Imu", **{f"/r{i}": "sensor_msgs/msg/Range" for i in range(6)}}
context = rclpy.Context()
context.init(args=[])
node = rclpy.create_node("player", context=context)
executor = SingleThreadedExecutor(context=context)
executor.add_node(node)
found = []
def take(message):
    stamp, p = message.header.stamp, message.pose.pose.position
    found.append([stamp.sec + 1e-9 * stamp.nanosec, p.x, p.y, p.z])
node.create_subscription(Odometry, "/estimate/odometry", take, 1000)
publishers = {topic: node.create_publisher(message_class(kind), topic, 1000) for topic, kind in types.items()}
while not all(one.get_subscription_count() for one in publishers.values()):
    executor.spin_once(timeout_sec=0.1)
for topic, _, message in at_pace(bag_messages(Path(sys.argv[1]), tuple(types)), 1.0):
    stamp = message.header.stamp
    fields = {"header": {"stamp": {"sec": stamp.sec, "nanosec": stamp.nanosec}}}
    if topic == "/imu":
        for name in ("angular_velocity", "linear_acceleration"):
            fields[name] = {axis: getattr(getattr(message, name), axis) for axis in "xyz"}
    else:
        fields["range"] = float(message.range)
    publishers[topic].publish(fill(message_class(types[topic])(), fields))
    executor.spin_once(timeout_sec=0.0)
end, last = time.monotonic() + 240.0, float(sys.argv[3])
while time.monotonic() < end and (not found or found[-1][0] < last):
    executor.spin_once(timeout_sec=0.1)
np.save(sys.argv[2], np.array(found))
"""


@pytest.mark.long
def test_a_bag_played_into_ros_comes_out_as_it_is_replayed(tmp_path: Path) -> None:
    """Bit for bit: headers keep their stamps, and a published estimate its doubles."""
    motion = made_up(5.0)
    motion = motion._replace(t_r=motion.t_r + 100.5, t_imu=motion.t_imu + 100.5)
    write_bag(tmp_path / "bag", motion, "sqlite3")
    (tmp_path / "MAP.yaml").write_text(BAG_MAP[: BAG_MAP.index("truth:")].replace("BAG", "bag") + START)
    map_ = load_map(tmp_path / "MAP.yaml")
    recording = read_recording(tmp_path, map_)
    expected = replay(recording, map_, lambda _: None)[1][RAW][0]
    bridge = [sys.executable, "-m", "ortilo_drake.cli", "hil", "bridge", "--from", "ros2"]
    bridge += ["--map", str(tmp_path / "MAP.yaml"), "--lag", "5"]
    last = recording.origin + expected.t[-1] - 0.2
    player = [sys.executable, "-c", PLAYER, str(tmp_path / "bag"), str(tmp_path / "found.npy"), str(last)]
    with own_domain(), subprocess.Popen(bridge) as running:
        try:
            subprocess.run(player, check=True, timeout=HANGS)
        finally:
            running.terminate()
            running.wait(HANGS)
    found = np.load(tmp_path / "found.npy")
    n = min(len(found), len(expected.t))
    assert n > 0.8 * len(expected.t)
    np.testing.assert_array_equal(found[:n, 1:], expected.p[:n])


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of rclpy's own imports
def test_a_topic_that_ros_allows_no_name_like_is_one_line() -> None:
    with pytest.raises(InputError, match=r"^topic '/uwb/0CA8': topic name token must not start with a number$"):
        Ros2Live(("/uwb/0CA8",), lambda _: None).__enter__()
