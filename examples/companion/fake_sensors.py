"""Sensors of a vehicle that is not there: a DWM1001 tag at a pseudo-terminal, and an IMU on /imu of ROS 2.

    python examples/companion/fake_sensors.py examples/companion/room.yaml

It prints the terminal's name. The vehicle stands at the map's `start` until somebody has listened to its IMU for REST
seconds; then it climbs and moves about.
"""

import contextlib
import os
import pty
import select
import sys
import time
import tty
from typing import Any

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

REST = 5.0  # [s]
IMU_PERIOD, RANGE_PERIOD = 0.01, 0.1  # a DWM1001 measures at most 10 times a second [s]
RANGE_SD, FORCE_SD, RATE_SD = 0.05, 0.05, 0.002  # [m], [m/s²], [rad/s]
GRAVITY, STEP = 9.81, 1e-3  # [m/s²], of the differences that give acceleration and rates [s]


def pose(t: float, start: dict) -> tuple[np.ndarray, Rotation]:
    """Return p_WB (3) [m] and R_WB at t seconds after the motion begins."""
    s = max(t, 0.0)
    grown = s**2 / (s**2 + 4.0)  # from rest
    moved = [1.6 * np.sin(0.7 * s), 1.6 * np.sin(0.5 * s), 0.6 * (1.0 - np.cos(0.6 * s)) + 0.6]
    turned = [0.8 * np.sin(0.4 * s), 0.08 * np.sin(0.9 * s), 0.06 * np.sin(1.1 * s)]
    angles = np.array([start["heading"], 0.0, 0.0]) + grown * np.array(turned)
    return np.array(start["position"]) + grown * np.array(moved), Rotation.from_euler("ZYX", angles)


def motion(t: float, start: dict) -> np.ndarray:
    """Return the body rates [rad/s] and the specific force [m/s²] in the body's axes (2, 3)."""
    (p0, _), (p1, R), (p2, R2) = (pose(t + k * STEP, start) for k in (-1, 0, 1))
    a_W = (p2 - 2.0 * p1 + p0) / STEP**2
    return np.array([(R.inv() * R2).as_rotvec() / STEP, R.inv().apply(a_W + [0.0, 0.0, GRAVITY])])


class Tag:
    """A DWM1001 at the far end of a pseudo-terminal: two returns open its shell, `lec` starts and stops its lines."""

    def __init__(self, anchors: dict[str, np.ndarray]):
        self._anchors = anchors
        self._port, far = pty.openpty()
        tty.setraw(far)
        self.name, self._far = os.ttyname(far), far  # kept open, or reading ends with an error while nobody listens
        self._prints, self._typed = False, b""

    def measure(self, place: np.ndarray, rng: np.random.Generator) -> None:
        """Print ranges to a place of the antenna (3) [m], if it was asked to."""
        while select.select([self._port], [], [], 0.0)[0]:
            self._typed += os.read(self._port, 100)
        *commands, self._typed = self._typed.split(b"\r")
        self._prints ^= commands.count(b"lec") % 2 == 1
        if not self._prints:
            return
        line = f"DIST,{len(self._anchors)}"
        for i, (address, at) in enumerate(self._anchors.items()):
            r = np.linalg.norm(place - at) + RANGE_SD * rng.standard_normal()
            line += f",AN{i},{address},{at[0]:.2f},{at[1]:.2f},{at[2]:.2f},{r:.2f}"
        os.write(self._port, f"{line}\r\n".encode())


def main(map_file: str) -> None:
    """Run until Ctrl-C."""
    import rclpy
    from rclpy.signals import SignalHandlerOptions
    from sensor_msgs.msg import Imu

    with open(map_file, encoding="utf-8") as file:
        map_ = yaml.safe_load(file)
    addresses = [topic[-4:] for topic in map_["ranges"]["topics"]]
    tag = Tag(dict(zip(addresses, np.array(map_["anchors"], dtype=float), strict=True)))
    lever, rng = np.array(map_["calibration"]["lever"]), np.random.default_rng(1)
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)  # signals end this process as any other
    publisher = rclpy.create_node("fake_imu").create_publisher(Imu, "/imu", 100)
    print(f"tag {tag.name}", flush=True)
    begin, next_imu, next_range = np.inf, time.time(), time.time()
    while True:
        now = time.time()
        if begin == np.inf and publisher.get_subscription_count():
            begin = now + REST
            print(f"begin {begin:.3f}", flush=True)
        if now >= next_range:
            p, R = pose(now - begin, map_["start"])
            tag.measure(p + R.apply(lever), rng)
            next_range += RANGE_PERIOD
        if now >= next_imu:
            noise = np.outer([RATE_SD, FORCE_SD], np.ones(3)) * rng.standard_normal((2, 3))
            publisher.publish(filled(Imu(), now, *(motion(now - begin, map_["start"]) + noise)))
            next_imu += IMU_PERIOD
        time.sleep(max(0.0, min(next_imu, next_range) - time.time()))


def filled(message: Any, t: float, w: np.ndarray, f: np.ndarray) -> Any:
    """Return a sensor_msgs/Imu with rates and specific force, stamped t [s]."""
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(round(t * 1e9), 10**9)
    for field, value in ((message.angular_velocity, w), (message.linear_acceleration, f)):
        field.x, field.y, field.z = map(float, value)
    return message


if __name__ == "__main__":
    with contextlib.suppress(KeyboardInterrupt):
        main(*sys.argv[1:])
