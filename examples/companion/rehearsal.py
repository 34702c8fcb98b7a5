"""A flight at the desk: a fake tag and IMU, the driver, the bridge, and a listener where the autopilot would be.

    python examples/companion/rehearsal.py

Each part runs as it would on the vehicle, as a process of its own: fake_sensors.py, range_node.py at its
pseudo-terminal, and `ortilo hil bridge`. The listener compares ODOMETRY, turned back to the anchors' frame, with the
made-up motion. It exits with 1 if that is not what an autopilot needs. Linux, with the extras ros2 and mavlink.
"""

import argparse
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from pymavlink.dialects.v20 import common
from scipy.spatial.transform import Rotation

HERE = Path(__file__).parent
MAP = HERE / "room.yaml"
ROW = 5.0  # between two rows of the table [s]
GAP = 0.2  # between two of them an EKF2 of PX4 begins to fuse, EV_MAX_INTERVAL [s]
ENDS = 10.0  # a process may take so long to end [s]
SILENT = 60.0  # the bridge is given up after so long without ODOMETRY [s]; its first start compiles for seconds
T = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]])  # east, north, up to north, east, down
F = np.diag([1, -1, -1])  # forward, left, up to forward, right, down


class Parts:
    """The processes, ended together."""

    def __init__(self) -> None:
        self._env = {"ROS_DOMAIN_ID": "77", "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"} | os.environ
        self.running = list[subprocess.Popen]()

    def start(self, *command: str) -> subprocess.Popen:
        """Start a command of Python's, and print it."""
        shown = [os.path.relpath(word) if Path(word).is_file() and word != sys.executable else word for word in command]
        print("$ python", *shown[1:], flush=True)
        one = subprocess.Popen(command, env=self._env, stdout=subprocess.PIPE, text=True)
        self.running.append(one)
        return one

    def end(self) -> None:
        """End all by Ctrl-C, and what does not end by that."""
        for one in self.running:
            one.send_signal(signal.SIGINT)
        for one in self.running:
            try:
                one.wait(ENDS)
            except subprocess.TimeoutExpired:
                one.kill()


def word_after(process: subprocess.Popen, first: str) -> str:
    """Return the second word of the next line of a process that begins with the first."""
    assert process.stdout is not None
    for line in process.stdout:
        if line.startswith(first):
            return line.split()[1]
    raise SystemExit(f"rehearsal.py: a process ended before it said {first!r}")


def heard(message: Any, begin: float, start: dict) -> list[float]:
    """Return of an ODOMETRY the position's error (3) [m], its standard deviation [m], and the yaw's error [rad]."""
    from fake_sensors import pose

    p_WB, R_WB = pose(1e-6 * message.time_usec - begin, start)
    w, *xyz = message.q
    R = T @ Rotation.from_quat([*xyz, w]).as_matrix() @ F
    yaw = (R_WB.inv() * Rotation.from_matrix(R)).as_rotvec()[2]
    variances = [message.pose_covariance[k] for k in (0, 6, 11)]
    return [*(T @ [message.x, message.y, message.z] - p_WB), float(np.sqrt(sum(variances))), float(yaw)]


def listen(sock: socket.socket, begin: float, seconds: float, start: dict) -> np.ndarray:
    """Print what comes for some seconds of the motion; return arrival [s] and `heard` of each ODOMETRY in it.

    It ends by the stamps: a bridge that is late is listened to for longer, unless it is silent.
    """
    parser, rows, printed, told = common.MAVLink(None), list[list[float]](), begin, ""
    stamp, last = begin, max(begin, time.time())
    print("  time [s]  ODOMETRY   error x, y, z [m]        sd [m]   yaw error [deg]", flush=True)
    while (stamp < begin + seconds or len(rows) < 2) and (now := time.time()) < last + SILENT:
        try:
            messages = parser.parse_buffer(sock.recv(2000)) or []
        except TimeoutError:
            messages = []
        for message in messages:
            if message.get_type() == "STATUSTEXT":
                told += message.text
                if len(message.text) < 50:
                    print(f"  STATUSTEXT {message.severity}: {told}", flush=True)
                    told = ""
            elif message.get_type() == "ODOMETRY":
                stamp, last = 1e-6 * message.time_usec, now
                if now > begin:
                    rows.append([now, *heard(message, begin, start)])
        if now > printed + ROW:
            recent = [row for row in rows if row[0] > now - ROW]
            if recent:
                x, y, z, sd, yaw = recent[-1][1:]
                row = f"{x:+.3f}, {y:+.3f}, {z:+.3f}   {sd:6.3f}   {np.degrees(yaw):+.1f}"
                print(f"  {now - begin:8.1f}   {len(recent) / ROW:4.1f} Hz   {row}", flush=True)
            printed = now
    return np.array(rows)


def judge(rows: np.ndarray) -> bool:
    """Print the summary of the motion, and return whether an autopilot could fuse it."""
    if len(rows) < 2:
        print(f"{len(rows)} ODOMETRY came: what does the bridge say?")
        return False
    error, sd = np.linalg.norm(rows[:, 1:4], axis=1), rows[:, 4]
    rate, gap = len(rows) / np.ptp(rows[:, 0]), np.diff(rows[:, 0]).max()
    within, yaw = float(np.mean(error < 3.0 * sd)), np.degrees(np.sqrt(np.mean(rows[:, 5] ** 2)))
    print(f"{len(rows)} ODOMETRY at {rate:.1f} Hz, at most {gap:.2f} s apart")
    print(f"position error {np.sqrt(np.mean(error**2)):.3f} m RMS, {within:.0%} within 3 standard deviations")
    print(f"yaw error {yaw:.1f} degrees RMS")
    wrong = [
        *(["ODOMETRY is too slow: is this machine busy?"] if rate < 29.0 or gap > GAP else []),
        *(["the estimate is wrong"] if within < 0.9 else []),
    ]
    print("an autopilot could fuse this" if not wrong else f"an autopilot would not fuse this: {'; '.join(wrong)}")
    return not wrong


def main(seconds: float) -> int:
    """Run all parts and return the exit code."""
    start = yaml.safe_load(MAP.read_text())["start"]
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sock.bind(("127.0.0.1", 0))
    sock.settimeout(0.1)
    parts = Parts()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # the parts end with it, as by Ctrl-C
    try:
        fake = parts.start(sys.executable, str(HERE / "fake_sensors.py"), str(MAP))
        parts.start(sys.executable, str(HERE / "range_node.py"), str(MAP), word_after(fake, "tag"))
        bridge = ["-m", "ortilo_drake", "hil", "bridge", "--from", "ros2", "--map", str(MAP), "--lag", "0.05"]
        parts.start(sys.executable, *bridge, "--mavlink", f"udpout:127.0.0.1:{sock.getsockname()[1]}")
        begin = float(word_after(fake, "begin"))
        return 0 if judge(listen(sock, begin, seconds, start)) else 1
    finally:
        parts.end()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Rehearse the bridge without a vehicle.")
    parser.add_argument("--seconds", type=float, default=30.0, help="Of the motion.")
    sys.exit(main(parser.parse_args().seconds))
