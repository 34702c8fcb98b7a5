"""A flight out to ROS 2 and MAVLink: the bridge is a process of its own, and so is who receives it from ROS."""

import array
import contextlib
import importlib.util
import json
import socket
import subprocess
import sys
import threading
import time
import types
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import xarray as xr
from hil_link import KEY, PlayedWorld, answering, key_file
from motions import attitude
from ros_domain import own_domain
from scipy.spatial.transform import Rotation
from waiting import HANGS

from ortilo_drake.flight.stepped_halves import Signals
from ortilo_drake.hil.bridge import LAG, TickCollector, run_bridge
from ortilo_drake.hil.goals.goal_link import answer_to
from ortilo_drake.hil.real_time.warm_up import warm_up
from ortilo_drake.hil.sessions import run_world
from ortilo_drake.hil.wire.packets import (
    FINISHED,
    TELEMETRY,
    publish_command,
    publish_goal,
    publish_messages,
    publish_telemetry,
)
from ortilo_drake.hil.wire.unpack import Packet
from ortilo_drake.interop.ros.ros2 import Ros2Bridge
from ortilo_drake.interop.ros.ros2_node import fill
from ortilo_drake.model.measurement import make_measurement
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario, load_scenario

SETTINGS = ("settle=0", "planner={kind: hover, duration: 1}")
BRIDGE = [sys.executable, "-u", "-m", "ortilo_drake.cli", "hil", "bridge", "nominal_imu_uwb"]
BRIDGE += [part for setting in SETTINGS for part in ("--set", setting)]
HAS_ROS = importlib.util.find_spec("rclpy") is not None
needs_ros = pytest.mark.skipif(
    not HAS_ROS,
    reason="rclpy is not installed: pip install 'ortilo-drake[ros2]'; wheels exist for Python 3.11 only",
)


@pytest.fixture(scope="module", autouse=True)
def _ros_of_these_tests_alone() -> Iterator[None]:
    with own_domain():
        yield


# --- fields to messages ------------------------------------------------------------------------------------------


class Point:
    """What an rclpy message looks like from outside."""

    def __init__(self) -> None:
        self.x, self.sec, self.name = 0.0, 0, ""

    def get_fields_and_field_types(self) -> dict[str, str]:
        return {"x": "double", "sec": "int32", "name": "string"}


class Cloud:
    def __init__(self) -> None:
        self.points: list[Point] = []
        self.first = Point()
        self.data, self.pixels = array.array("d"), array.array("B")
        self.covariance = np.zeros(4)

    def get_fields_and_field_types(self) -> dict[str, str]:
        return {"points": "sequence<fake_msgs/Point>", "first": "fake_msgs/Point"}


def test_fields_become_a_message_of_the_right_types(monkeypatch: pytest.MonkeyPatch) -> None:
    module = types.ModuleType("fake_msgs.msg")
    module.Point = Point  # type: ignore[attr-defined]  # that is the point
    monkeypatch.setitem(sys.modules, "fake_msgs", types.ModuleType("fake_msgs"))
    monkeypatch.setitem(sys.modules, "fake_msgs.msg", module)
    M = np.arange(6.0).reshape(2, 3)
    cloud = fill(
        Cloud(),
        {
            "points": [{"x": np.float64(1.5), "name": "a"}, {"sec": np.int64(7)}],
            "first": {"x": 2},
            "data": M[:, 1],  # not contiguous
            "pixels": np.array([1, 255], np.uint8),
            "covariance": [1.0, 2.0, 3.0, 4.0],
        },
    )
    assert [(point.x, point.sec, point.name) for point in cloud.points] == [(1.5, 0, "a"), (0.0, 7, "")]
    assert type(cloud.first.x) is float
    assert type(cloud.points[1].sec) is int
    assert cloud.data == array.array("d", [1.0, 4.0])
    assert cloud.pixels == array.array("B", [1, 255])
    assert isinstance(cloud.covariance, np.ndarray)
    assert cloud.covariance.tolist() == [1.0, 2.0, 3.0, 4.0]
    with pytest.raises(AttributeError, match="nonsense"):
        fill(Point(), {"nonsense": 1.0})


def test_without_rclpy_one_line_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(
        InputError, match=r"rclpy: is not installed.*source a ROS 2.*pip install 'ortilo-drake\[ros2\]'"
    ):
        Ros2Bridge(load_scenario("nominal_imu_uwb", SETTINGS))


# --- ticks from packets ------------------------------------------------------------------------------------------


def outputs_of(k: int) -> Signals:
    return {name: np.full(size, float(k)) for name, size in (make_measurement().sizes | TELEMETRY).items()}


def put_tick(ticks: TickCollector, k: int, with_telemetry: bool = True) -> None:
    ticks.put(Packet("imu", k, np.full(11, float(k))))
    ticks.put(Packet("command", k, np.full(4, float(k))))
    if with_telemetry:
        ticks.put(Packet("telemetry", k, outputs_of(k)))
    ticks.put(Packet("tick", k, ("imu",)))


def test_ticks_come_in_order_and_wait_for_what_is_missing_only_so_long() -> None:
    ticks = TickCollector()
    put_tick(ticks, 3)
    assert [(k, messages["imu"][0], outputs["estimate"][0]) for k, messages, outputs in ticks.ready()] == [(3, 3, 3)]
    put_tick(ticks, 4, with_telemetry=False)
    for k in range(6, 4 + LAG):
        put_tick(ticks, k)
        assert not list(ticks.ready())
    put_tick(ticks, 4 + LAG)
    given = list(ticks.ready())
    assert [k for k, _, _ in given] == [4, *range(6, 5 + LAG)]
    assert given[0][2].keys() == {"control"}
    assert (ticks.given, ticks.lost, ticks.without_answer, ticks.without_world) == (LAG + 1, 1, 1, 0)
    put_tick(ticks, 4)  # late: of no use
    assert not list(ticks.ready())


def test_a_picture_that_took_longer_goes_with_the_next_tick() -> None:
    ticks, image = TickCollector(), np.zeros((2, 3, 4), np.uint8)
    put_tick(ticks, 0)
    assert len(list(ticks.ready())) == 1
    ticks.put(Packet("image", 0, image, 0.0125))
    put_tick(ticks, 1)
    put_tick(ticks, 2)
    (_, first, _), (_, second, _) = ticks.ready()
    assert first["image"] is image
    assert first["shutter"].tolist() == [1.0, 0.0125]
    assert "image" not in second


# --- the bus -----------------------------------------------------------------------------------------------------


def play_world(url: str, scenario: Scenario, stop: threading.Event) -> None:
    """Be both halves of a flight under way, with the world's heartbeat, until told to stop; refuse goals with x > 2."""
    world, k = PlayedWorld(url, scenario), 100
    while not stop.is_set():
        for goal in world.turn(k):
            publish_goal(world.outbox, answer_to(goal, "too far" if goal.x > 2.0 else ""))
        publish_messages(world.outbox, k, {})
        publish_command(world.outbox, k, {"control": np.array([1e-4 * k, 0.0, 0.0, 0.0])})  # of a minute, too
        publish_telemetry(world.outbox, k, outputs_of(0))
        k += 1
        time.sleep(0.01)
    world.turn(k, FINISHED)
    world.close()


def with_world(url: str, scenario: Scenario, bridge: Callable[[threading.Event], Any]) -> Any:
    stop = threading.Event()
    with ThreadPoolExecutor(1) as pool:
        world = pool.submit(play_world, url, scenario, stop)
        try:
            return bridge(stop)
        finally:
            stop.set()
            world.result(HANGS)


def test_it_joins_a_flight_and_a_target_that_fails_leaves_the_others_alone(bus: str) -> None:
    scenario = load_scenario("nominal_imu_uwb", SETTINGS)
    taken: list[tuple[float, float | None]] = []
    lines: list[str] = []

    def listen(stop: threading.Event) -> Any:
        def take(t: float, messages: Signals, outputs: Signals) -> None:
            taken.append((t, outputs["control"][0] if "control" in outputs else None))
            if len(taken) == 20:
                stop.set()

        def fail(t: float, messages: Signals, outputs: Signals) -> None:
            raise OSError("no route\nto host")

        return run_bridge(bus, KEY, scenario, {"bad": fail, "good": take}, wait=HANGS, say=lines.append)

    report = with_world(bus, scenario, listen)
    assert len(taken) >= 20
    assert report.ticks == len(taken)
    answered = [(t, thrust) for t, thrust in taken if thrust is not None]
    assert len(taken) - len(answered) <= report.without_answer <= 1  # it may join in the middle of a tick
    assert all(t == round(1e4 * thrust) * scenario.h for t, thrust in answered)
    assert report.failed == {"bad": "no route to host"}
    assert [line.partition(" at ")[0] for line in lines if "bad" in line] == ["bad: failed"]


def test_without_a_target_left_or_on_another_flight_it_ends_with_one_line(bus: str) -> None:
    scenario = load_scenario("nominal_imu_uwb", SETTINGS)

    def fail(t: float, messages: Signals, outputs: Signals) -> None:
        raise ValueError

    with pytest.raises(InputError, match=r"nothing left to send to \(only\)"):
        with_world(bus, scenario, lambda stop: run_bridge(bus, KEY, scenario, {"only": fail}, None, HANGS, print))
    other = load_scenario("nominal_imu_uwb", (*SETTINGS, "control_rate=60"))
    with pytest.raises(InputError, match="flies another scenario"):
        with_world(bus, scenario, lambda stop: run_bridge(bus, KEY, other, {}, None, HANGS, print))
    with pytest.raises(InputError, match="not heard"):
        run_bridge(bus, KEY, scenario, {}, wait=0.1, say=lambda line: None)


def test_goals_are_passed_on_and_their_answers_said(bus: str) -> None:
    scenario = load_scenario("nominal_imu_uwb", SETTINGS)
    lines: list[str] = []

    def listen(stop: threading.Event) -> Any:
        wishes = iter([[1.5, -2.0, 9.0], [3.0, 0.0, 0.0], [np.nan, 0.0, 0.0]])
        said = 0

        def goals() -> np.ndarray | None:
            """Wish for something once the line about the wish before is there."""
            nonlocal said
            if len(lines) == 4:
                stop.set()
                raise RuntimeError("node\nis gone")
            if len(lines) == said:
                return None
            said = len(lines)
            return np.array(next(wishes))

        return run_bridge(bus, KEY, scenario, {"ros2": lambda *tick: None}, None, HANGS, lines.append, goals)

    report = with_world(bus, scenario, listen)
    assert lines[1:4] == [
        "goal (1.5, -2): flies there",
        "goal (3, 0): too far",
        "goal (nan, 0): must be two finite numbers of at most 10000",
    ]
    assert report.failed == {"goals": "node is gone"}
    assert lines[4].startswith("goals: failed at ")


# --- a flight ----------------------------------------------------------------------------------------------------


def fly_with_bridge(
    bus: str,
    options: list[str],
    report: Path,
    wait: Callable[[], None] = lambda: None,
    follow: Callable[[int], None] = lambda k: None,
) -> tuple[xr.Dataset, SimpleNamespace]:
    """Fly in lockstep with `ortilo hil bridge` beside; return the flight and the bridge's report.

    The flight begins when wait has returned and the bridge has answered the world, however long it takes to join. It
    goes on after tick k once follow(k) has returned.
    """
    scenario = load_scenario("nominal_imu_uwb", SETTINGS)
    warm_up(scenario)  # neither half is to wait for the compiler in flight
    command = [*BRIDGE, "--url", bus, "--key", str(key_file(report.parent)), "--wait", str(HANGS)]
    command += ["--json", str(report), *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as bridge:
        try:
            assert bridge.stdout
            said: list[str] = []
            while not any("listening" in line for line in said):
                said.append(bridge.stdout.readline())
                assert said[-1], said
            wait()
            with answering(scenario, bus, after_user=True):
                flight, _ = run_world(scenario, bus, KEY, True, HANGS, record=lambda k, *_: follow(k))
            rest, _ = bridge.communicate(timeout=HANGS)
            assert bridge.returncode == 0, "".join(said) + rest
        finally:
            bridge.kill()
    found = SimpleNamespace(**json.loads(report.read_text(encoding="utf-8")))
    assert found.failed == {}
    assert 0 < found.ticks + found.lost <= flight.sizes["tick"]
    return flight, found


@pytest.mark.processes
def test_mavlink_gets_the_flight_s_estimates(tmp_path: Path, bus: str) -> None:
    from pymavlink.dialects.v20 import common

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        target = f"udpout:127.0.0.1:{receiver.getsockname()[1]}"
        flight, report = fly_with_bridge(bus, ["--mavlink", target], tmp_path / "report.json")
        receiver.setblocking(False)
        parser = common.MAVLink(None)
        heard: list[Any] = []
        with contextlib.suppress(BlockingIOError):
            while True:
                heard += parser.parse_buffer(receiver.recv(2000)) or []
    odometry = [message for message in heard if message.get_msgId() == common.MAVLINK_MSG_ID_ODOMETRY]
    # An answer that lacks its command only is counted as missing, too.
    assert report.ticks - report.without_answer <= len(odometry) <= report.ticks
    assert sum(message.get_msgId() == common.MAVLINK_MSG_ID_HEARTBEAT for message in heard) >= 1
    xhat, control_rate = flight["estimate"].to_numpy(), load_scenario("nominal_imu_uwb", SETTINGS).control_rate
    for message in odometry:
        k = round(message.time_usec * 1e-6 * control_rate)
        np.testing.assert_allclose([message.y, message.x, -message.z], xhat[k, :3], rtol=1e-6, atol=1e-7)


_RECEIVER = """
import json, sys, time
import rclpy
from nav_msgs.msg import Odometry, Path
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import Imu
from std_msgs.msg import Float64MultiArray, String
rclpy.init(args=[])
node = rclpy.create_node("receiver")
got = {"odometry": [], "estimate": [], "scenario": [], "path": [], "imu": 0}
def odometry(m):
    print(m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec, flush=True)
    q = m.pose.pose.orientation
    got["odometry"].append([m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec, m.pose.pose.position.x,
        m.pose.pose.position.y, m.pose.pose.position.z, q.x, q.y, q.z, q.w, *m.pose.covariance])
def imu(m):
    got["imu"] += 1
node.create_subscription(Odometry, "/estimate/odometry", odometry, 100)
node.create_subscription(Float64MultiArray, "/ortilo/estimate", lambda m: got["estimate"].append(list(m.data)), 100)
node.create_subscription(Imu, "/imu/data", imu, 100)
# What was sent once comes as soon as the bridge knows this subscription, and so those that were announced before it.
latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
first = []
node.create_subscription(String, "/ortilo/scenario", first.append, latched)
deadline, late = time.time() + 600.0, None
print("ready", flush=True)
while time.time() < deadline and not first:
    rclpy.spin_once(node, timeout_sec=0.05)
print("known", flush=True)
while time.time() < deadline and not (got["odometry"] and node.count_publishers("/estimate/odometry") == 0):
    if late is None and got["odometry"]:  # joins now, and yet gets what was sent once before
        late = [node.create_subscription(String, "/ortilo/scenario", lambda m: got["scenario"].append(m.data), latched),
            node.create_subscription(Path, "/reference/path", lambda m: got["path"].append(len(m.poses)), latched)]
    rclpy.spin_once(node, timeout_sec=0.05)
for _ in range(200):  # what came before the publisher went is still in the queues, and each turn takes one
    rclpy.spin_once(node, timeout_sec=0.005)
print(json.dumps(got), flush=True)
"""


@pytest.mark.processes
@needs_ros
def test_ros_gets_the_flight_s_estimates(tmp_path: Path, bus: str) -> None:
    scenario = load_scenario("nominal_imu_uwb", SETTINGS)
    program = [sys.executable, "-c", _RECEIVER]
    with subprocess.Popen(program, stdout=subprocess.PIPE, text=True) as receiver:
        try:
            assert receiver.stdout
            assert receiver.stdout.readline() == "ready\n"

            def wait_until_known() -> None:
                assert receiver.stdout
                assert receiver.stdout.readline() == "known\n"

            def wait_until_heard(k: int) -> None:
                """No queue overflows, however long the receiver or the bridge stands still."""
                assert receiver.stdout
                while float(receiver.stdout.readline()) < (k - 0.5) * scenario.h:
                    pass

            flight, report = fly_with_bridge(
                bus, ["--ros2"], tmp_path / "report.json", wait_until_known, wait_until_heard
            )
            got = json.loads(receiver.communicate(timeout=HANGS)[0])
        finally:
            receiver.kill()
    xhat, P = flight["estimate"].to_numpy(), flight["covariance"].to_numpy().reshape(-1, 15, 15)
    stamps = [row[0] for row in got["odometry"]]
    assert stamps == sorted(set(stamps))
    assert report.ticks - report.without_answer <= len(stamps) <= report.ticks
    for t, *numbers in got["odometry"]:
        k = round(t * scenario.control_rate)
        assert abs(t - k * scenario.h) < 1e-9
        assert numbers[:3] == xhat[k, :3].tolist()
        turn = attitude(xhat[k, 3:6]).inv() * Rotation.from_quat(numbers[3:7])
        assert turn.magnitude() < 1e-12
        assert numbers[7:] == P[k, :6, :6].ravel().tolist()
    rows = {tuple(row) for row in xhat.tolist()}
    assert 0 < len(got["estimate"]) <= report.ticks
    assert all(tuple(row) in rows for row in got["estimate"])
    assert got["imu"] > 0
    assert len(got["path"]) == 1
    assert json.loads(json.loads(got["scenario"][0])["scenario"]) == json.loads(scenario.model_dump_json())


_SENDER = """
import select, sys
import rclpy
from geometry_msgs.msg import PoseStamped
rclpy.init(args=[])
node = rclpy.create_node("sender")
publisher = node.create_publisher(PoseStamped, "/goal_pose", 1)
line, known = sys.stdin.readline(), False
while line:
    frame, x, y, z = line.split()
    message = PoseStamped()
    message.header.frame_id = frame
    message.pose.position.x, message.pose.position.y, message.pose.position.z = float(x), float(y), float(z)
    publisher.publish(message)
    # The first is sent again and again: when the other side knows this publisher, only its own answer says.
    if known or select.select([sys.stdin], [], [], 1.0)[0]:
        line, known = sys.stdin.readline(), True
"""

_GOALS = """
import subprocess, sys
from ortilo_drake.interop.ros.ros2 import Ros2Bridge
from ortilo_drake.scenario import load_scenario
class Noting(Ros2Bridge):
    taken = None
    def _take_goal(self, message):
        super()._take_goal(message)
        self.taken = message.pose.position.z
with Noting(load_scenario("nominal_imu_uwb")) as bridge:
    sender = subprocess.Popen([sys.executable, "-c", sys.argv[1]], stdin=subprocess.PIPE, text=True)
    for goal in ("base_link 1 1 1", "map nan 1 2", "map 3.5 -2 1.25", "map 4 0.5 3"):
        print(goal, file=sender.stdin, flush=True)
        got = None
        while bridge.taken != float(goal.split()[-1]):
            got = bridge.goal()
        print("goal", None if got is None else got.tolist(), bridge.goal())
    sender.stdin.close()
    sender.wait()
"""


@pytest.mark.processes
@needs_ros
def test_a_goal_from_ros_crosses_to_the_onboard_half(tmp_path: Path, bus: str) -> None:
    scenario = load_scenario("nominal_imu_uwb", SETTINGS)
    command = [*BRIDGE, "--url", bus, "--key", str(key_file(tmp_path)), "--wait", str(HANGS), "--ros2"]
    sender = [sys.executable, "-c", _SENDER]
    pipes: dict[str, Any] = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}

    def pass_on(stop: threading.Event) -> list[str]:
        with subprocess.Popen(command, **pipes) as bridge, subprocess.Popen(sender, **pipes) as ros:
            try:
                lines = [bridge.stdout.readline()]
                for goal in ("map 1.5 -2 0", "map 3 0 0"):
                    print(goal, file=ros.stdin, flush=True)
                    before = lines[-1]  # which comes again for each time that the first goal was sent
                    while lines[-1] == before:
                        lines.append(bridge.stdout.readline())
                stop.set()
                bridge.wait(HANGS)
            finally:
                bridge.kill()
                ros.kill()
        return lines

    lines = with_world(bus, scenario, pass_on)
    assert list(dict.fromkeys(line.strip() for line in lines[1:])) == [
        "goal (1.5, -2): flies there",
        "goal (3, 0): too far",
    ]


@pytest.mark.processes
@needs_ros
def test_goals_come_back_in_the_map_frame_only() -> None:
    run = subprocess.run(
        [sys.executable, "-c", _GOALS, _SENDER], capture_output=True, text=True, timeout=HANGS, check=True
    )
    goals = [line for line in run.stdout.splitlines() if line.startswith("goal")]
    assert goals == ["goal None None", "goal None None", "goal [3.5, -2.0, 1.25] None", "goal [4.0, 0.5, 3.0] None"]
    assert "/goal_pose: refused: in frame 'base_link', must be in 'map'" in run.stderr
    assert "/goal_pose: refused: not finite" in run.stderr
