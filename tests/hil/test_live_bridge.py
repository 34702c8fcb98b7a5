"""`ortilo hil bridge --from`: a bag through the command, and what reaches an autopilot when it is armed and not."""

import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections import Counter
from itertools import count
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from live_messages import RANGES, START, run_live_plainly
from made_up_motion import ANCHORS, BAG_MAP, as_map, made_up, write_bag
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from ortilo_drake.commands.hil.app import hil_app
from ortilo_drake.interop.mavlink import MOST_THRUST, attitude_target_fields
from ortilo_drake.interop.recorded.bag_columns import bag_messages
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.studies.live import live_bridge, live_filter
from ortilo_drake.studies.live.live_bridge import LiveBridge
from ortilo_drake.studies.live.live_warnings import LiveWarnings


@pytest.fixture
def recorded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    run_live_plainly(monkeypatch)
    monkeypatch.setattr(live_bridge, "time", SimpleNamespace(monotonic=lambda: 0.0))  # ages by the stamps alone
    write_bag(tmp_path / "bag", made_up(4.0), "sqlite3")
    (tmp_path / "MAP.yaml").write_text(BAG_MAP[: BAG_MAP.index("truth:")].replace("BAG", "bag") + START)
    return ["bridge", "--from", str(tmp_path / "bag"), "--map", str(tmp_path / "MAP.yaml"), "--speed", "inf"]


def messages_at(sock: socket.socket) -> list[Any]:
    """Return the messages that wait at a socket, decoded by pymavlink."""
    from pymavlink.dialects.v20 import common

    parser, found = common.MAVLink(None), list[Any]()
    sock.setblocking(False)
    while True:
        try:
            found += parser.parse_buffer(sock.recv(2000)) or []
        except BlockingIOError:
            return found


@pytest.mark.parametrize("armed", [False, True])
def test_setpoints_reach_the_autopilot_only_when_armed(recorded: list[str], tmp_path: Path, armed: bool) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", 0))
        url, report = f"udpout:127.0.0.1:{sock.getsockname()[1]}", tmp_path / "report.json"
        options = ["--mavlink", url, "--hold", "4.5,6.4,1.9", "--json", str(report)]
        options += ["--arm", "--hover-thrust", "0.5", "--system", "7", "--component", "191"] if armed else []
        result = CliRunner().invoke(hil_app, [*recorded, *options])
        assert result.exit_code == 0, result.output
        received, found = messages_at(sock), json.loads(report.read_text())
    messages = Counter(message.get_type() for message in received)
    ids = (7, 191) if armed else (1, 197)  # 197: MAV_COMP_ID_VISUAL_INERTIAL_ODOMETRY
    assert {(message.get_srcSystem(), message.get_srcComponent()) for message in received} == {ids}
    texts = [(m.severity, m.text) for m in received if m.get_type() == "STATUSTEXT"]
    assert {severity for severity, text in texts if text.startswith("the filter has begun")} == {5}  # NOTICE
    assert {severity for severity, text in texts if text.startswith("failsafe: no setpoints")} == {4}  # WARNING
    targets = {(m.target_system, m.target_component) for m in received if m.get_type() == "SET_ATTITUDE_TARGET"}
    assert targets == ({(7, 1)} if armed else set())
    assert messages["ODOMETRY"] == found["estimates"] - found["old"] > 75
    assert 15 < found["old"] < 45  # those of the first second, which levels the IMU: stale when they can be made
    assert 3 <= messages["HEARTBEAT"] <= 5
    assert messages["SET_ATTITUDE_TARGET"] == (found["estimates"] - found["refused"] if armed else 0)
    assert f"median {found['late_ms']['median']:g}, largest {found['late_ms']['largest']:g}" in result.output
    told = "".join(m.text for m in received if m.get_type() == "STATUSTEXT")  # its parts, in order
    assert told.startswith("the filter has begun, by the ranges from")
    assert "failsafe: no setpoints: the estimate is older" in told
    assert "setpoints: to hold (4.5, 6.4, 1.9) m, yaw" in told  # once it came near
    assert ("ARMED" in result.output) == armed
    rows = [line.split()[0] for line in result.output.splitlines() if line.startswith("  ")]
    assert rows.count("refused") == 1
    assert not {"rejected", "failed", "not"} & set(rows)  # nothing of the kind happened
    assert ("setpoints are off" in result.output) != armed
    assert "failsafe: no setpoints: the estimate is older" in result.output  # of the first second, which came at once


def test_no_estimate_of_a_bag_that_is_played_without_waiting_is_old_by_a_slow_computer(
    recorded: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = []
    for slow in (False, True):
        if slow:
            monkeypatch.setattr(time, "monotonic", count(0.0, 0.3).__next__)
        report = tmp_path / "report.json"
        options = ["--mavlink", "udpout:127.0.0.1:9", "--json", str(report)]
        assert CliRunner().invoke(hil_app, [*recorded, *options]).exit_code == 0
        found.append(json.loads(report.read_text())["old"])
    assert found[0] == found[1] > 0  # of the first second, which levels the IMU


def test_a_bridge_keeps_its_state_for_the_next_which_the_autopilot_can_tell_from_it(
    recorded: list[str], tmp_path: Path
) -> None:
    """The next is given the same bag from its beginning, before the state: that is another clock."""
    resets, said = list[set[int]](), ""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", 0))
        options = ["--mavlink", f"udpout:127.0.0.1:{sock.getsockname()[1]}", "--state", str(tmp_path / "state.npz")]
        for _ in range(2):
            result = CliRunner().invoke(hil_app, [*recorded, *options])
            assert result.exit_code == 0, result.output
            resets.append({m.reset_counter for m in messages_at(sock) if m.get_type() == "ODOMETRY"})
            said = result.output
    assert resets == [{0}, {1}]
    assert f"warning  {tmp_path}/state.npz: is not used: its clock is another: the stamps went on by -" in said


def test_a_bridge_that_is_killed_in_flight_is_replaced_by_one_that_goes_on(
    recorded: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Killed at 2 s of the bag, of which the next process gets what comes from 2.5 s on."""

    def run_part(bridge: LiveBridge, messages: Any, *rest: Any) -> Any:
        if (tmp_path / "killed").exists():
            return run_live(bridge, (one for one in messages if one[1] > first_at() + 2.5e9), *rest)
        for message in messages:
            if message[1] > first_at() + 2.0e9:
                (tmp_path / "killed").touch()
                os.kill(os.getpid(), signal.SIGKILL)
            bridge.receive(*message)
        raise AssertionError

    def first_at() -> int:
        return int(next(iter(bag_messages(tmp_path / "bag", ("/imu",))))[1])

    run_live = live_bridge.run_live
    monkeypatch.setattr(live_bridge, "run_live", run_part)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", 0))
        options = ["--mavlink", f"udpout:127.0.0.1:{sock.getsockname()[1]}", "--state", str(tmp_path / "state.npz")]
        result = CliRunner().invoke(hil_app, [*recorded, *options, "--keep-alive"])
        received = messages_at(sock)
    assert result.exit_code == 0, result.output
    odometry = [m for m in received if m.get_type() == "ODOMETRY"]
    before, after = (
        [m for m in odometry if (m.time_usec - odometry[0].time_usec > 1.7e6) == late] for late in (False, True)
    )
    assert {m.reset_counter for m in before} == {0}
    assert {m.reset_counter for m in after} == {2}
    assert "state.npz, 0." in "".join(m.text for m in received if m.get_type() == "STATUSTEXT")


@pytest.mark.parametrize(("options", "period"), [([], 1 / 30), (["--rate", "10"], 0.1)])
def test_an_autopilot_gets_estimates_as_often_as_px4_asks_for(
    recorded: list[str], options: list[str], period: float
) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", 0))
        url = f"udpout:127.0.0.1:{sock.getsockname()[1]}"
        result = CliRunner().invoke(hil_app, [*recorded, "--mavlink", url, *options])
        stamps = [1e-6 * m.time_usec for m in messages_at(sock) if m.get_type() == "ODOMETRY"]
    assert result.exit_code == 0, result.output
    np.testing.assert_allclose(np.diff(stamps), period, atol=1e-5)
    assert "refused" not in result.output  # no place is held
    assert ("warning  --rate: 10 Hz: PX4 needs 30 to 50 Hz" in result.output) == bool(options)


def test_heartbeats_go_on_where_no_estimate_is_sent(recorded: list[str]) -> None:
    """PX4 took the companion for lost."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", 0))
        options = ["--mavlink", f"udpout:127.0.0.1:{sock.getsockname()[1]}", "--most-deviation", "0.01"]
        result = CliRunner().invoke(hil_app, [*recorded, *options])
        kinds = Counter(message.get_type() for message in messages_at(sock))
    assert result.exit_code == 0, result.output
    assert kinds["ODOMETRY"] == 0
    assert 3 <= kinds["HEARTBEAT"] <= 5  # of a bag of 4 s


def test_a_body_that_begins_upside_down_is_refused(recorded: list[str], tmp_path: Path) -> None:
    map_ = tmp_path / "MAP.yaml"
    map_.write_text(map_.read_text().replace("axes: frd", "axes: flu"))
    result = CliRunner().invoke(hil_app, recorded)
    assert isinstance(result.exception, InputError)
    assert "upside down: imu: {axes: frd} turns it up" in str(result.exception)


def test_an_imu_that_lies_on_its_side_is_refused_unless_the_map_says_so(recorded: list[str], tmp_path: Path) -> None:
    """So nothing reaches an autopilot. The bag's imu is one of frd axes."""
    map_ = tmp_path / "MAP.yaml"
    map_.write_text(map_.read_text().replace("axes: frd", "axes: [x, -z, y]"))
    result = CliRunner().invoke(hil_app, recorded)
    assert isinstance(result.exception, InputError)
    assert "the body lies rolled by 9" in str(result.exception) or "rolled by 8" in str(result.exception)
    assert "imu: {axes: [x, -y, -z]} makes it level" in str(result.exception)
    map_.write_text(map_.read_text().replace("heading: 0.5", "heading: 0.5, tilted: true"))
    result = CliRunner().invoke(hil_app, recorded)
    assert not isinstance(result.exception, InputError), result.exception


def test_an_imu_in_another_unit_is_refused_with_the_unit(recorded: list[str], tmp_path: Path) -> None:
    map_ = tmp_path / "MAP.yaml"
    map_.write_text(map_.read_text().replace("axes: frd", "axes: frd, force_unit: g"))
    result = CliRunner().invoke(hil_app, recorded)
    assert isinstance(result.exception, InputError)
    assert re.search(r"the force at rest is 9\d\.?\d* m/s², not 9\.81: imu: {force_unit: m/s2}", str(result.exception))


def test_a_filter_that_is_lost_again_and_again_is_told_of_twice_a_minute() -> None:
    lines = list[str]()
    warnings = LiveWarnings(as_map(RANGES), lines.append)
    filter_ = live_filter.LiveFilter(as_map(RANGES), ANCHORS, rate=1.0)
    for second in range(100):
        filter_.lost, filter_._next = second, second
        warnings.look_at(filter_)
    first, *later = lines
    assert first == "the filter was lost, and starts anew from the ranges"
    assert later == [f"{first} (31 times in 31 s)"] * 3


def test_the_autopilot_is_told_why_the_bridge_ended(recorded: list[str], tmp_path: Path) -> None:
    map_ = tmp_path / "MAP.yaml"
    map_.write_text(map_.read_text().replace("[3, 6.1, 1.4], position_sd: 0.5", "[5, 6.1, 1.4]"))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", 0))
        result = CliRunner().invoke(hil_app, [*recorded, "--mavlink", f"udpout:127.0.0.1:{sock.getsockname()[1]}"])
        received = [m for m in messages_at(sock) if m.get_type() == "STATUSTEXT"]
    assert isinstance(result.exception, InputError)
    assert {m.severity for m in received} == {2}  # MAV_SEVERITY_CRITICAL
    assert "".join(m.text for m in received) == f"the bridge has ended: {result.exception}"


def test_a_bridge_that_holds_no_place_loads_neither_drake_nor_scipy_s_statistics() -> None:
    """Which take half a second: so much longer it would be away after a crash in flight."""
    parts = ("studies.live.live_bridge", "studies.live.kept_state", "commands.hil.bridge")
    code = f"import sys, {', '.join(f'ortilo_drake.{part}' for part in parts)}; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert "scipy.optimize" in loaded
    assert not {"pydrake", "scipy.stats"} & set(loaded)


WATCHED = """
import sys
import time
import numba.core.dispatcher
import numpy as np
import ortilo_drake.studies.live.live_bridge as live_bridge
from ortilo_drake.cli import main
from ortilo_drake.interop.ros.ros_motion import estimate_messages, setpoint_messages, tf_message

found, compiles, runs = [], numba.core.dispatcher.Dispatcher.compile, live_bridge.run_live
def watched(self, signature):
    found.append(self.py_func.__name__)
    return compiles(self, signature)
def run_live(*parts):
    found.clear()
    report = runs(*parts)
    estimate_messages(0.0, np.zeros(15), np.eye(15).ravel())
    tf_message(0.0, np.zeros(15))
    setpoint_messages(0.0, np.zeros(3), 9.8)
    print("compiled in flight:", found)
    return report
numba.core.dispatcher.Dispatcher.compile, live_bridge.run_live = watched, run_live
main()
"""


@pytest.mark.long
def test_nothing_is_compiled_or_loaded_once_messages_come(tmp_path: Path) -> None:
    """At the first start of an installation that takes seconds, in which the imu's messages are lost."""
    write_bag(tmp_path / "bag", made_up(4.0), "sqlite3")
    (tmp_path / "MAP.yaml").write_text(BAG_MAP[: BAG_MAP.index("truth:")].replace("BAG", "bag") + START)
    command = [sys.executable, "-c", WATCHED, "hil", "bridge", "--from", str(tmp_path / "bag"), "--speed", "inf"]
    command += ["--map", str(tmp_path / "MAP.yaml"), "--mavlink", "udpout:127.0.0.1:14999", "--hold", "4.5,6.4,1.9"]
    told = subprocess.run([*command, "--arm", "--hover-thrust", "0.5"], capture_output=True, text=True, check=True)
    assert "setpoints: to hold" in told.stdout
    assert "compiled in flight: []" in told.stdout


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--from", "bag"], "--map"),
        (["--from", "bag", "--map", "m", "--arm"], "--arm"),
        (["--from", "bag", "--map", "m", "--hold", "1,2"], "--hold"),
        (["--from", "bag", "--map", "m", "--hold", "1,2,inf"], "--hold"),
        (["--from", "bag", "--map", "m", "--hold", "1,2,1", "--yaw", "29"], "--yaw: 29: .*29 degrees are 0.506"),
        (["--from", "bag", "--map", "m", "--yaw", "1"], "--yaw: needs --hold"),
        (["--from", "bag", "--map", "m", "--ros2"], "ros2 bag play"),
        (["--map", "m", "--ros2"], "--from"),
        (["--from", "bag", "--map", "m", "--state", "s"], "--state: needs --mavlink"),
        (["--from", "bag", "--map", "m", "--keep-alive"], "--keep-alive: needs --state"),
        (["--from", "bag", "--map", "m", "--mavlink", "udpout:a:1", "--state", "/dev/null/s"], "/dev/null"),
    ],
)
def test_options_that_do_not_fit_are_refused(options: list[str], said: str) -> None:
    result = CliRunner().invoke(hil_app, ["bridge", *options])
    assert isinstance(result.exception, InputError)
    assert re.search(said, str(result.exception))


def test_a_serial_port_is_refused_before_the_filter_is_compiled(
    recorded: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(LiveBridge, "warm_up", lambda bridge: pytest.fail("compiled"))
    result = CliRunner().invoke(hil_app, [*recorded, "--mavlink", "/dev/ttyUSB0:921600"])
    assert isinstance(result.exception, InputError)
    assert "a serial port needs a router" in str(result.exception)


def test_an_attitude_is_asked_for_in_the_autopilot_s_frames() -> None:
    """Its body's axes in north, east, down, by SciPy's rotations."""
    rpy = np.array([0.2, -0.1, 0.7])
    fields = attitude_target_fields(1.5, rpy, 0.6)
    R = Rotation.from_euler("ZYX", rpy[::-1]).as_matrix()
    T, F = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]]), np.diag([1, -1, -1])
    w, *xyz = fields["q"]
    np.testing.assert_allclose(Rotation.from_quat([*xyz, w]).as_matrix(), T @ R @ F, atol=1e-12)
    assert fields["type_mask"] == 7
    assert fields["time_boot_ms"] == 1500
    assert fields["thrust"] == 0.6
    assert [attitude_target_fields(0.0, rpy, thrust)["thrust"] for thrust in (-1.0, 2.0)] == [0.0, MOST_THRUST]
