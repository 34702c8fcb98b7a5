"""Messages of made-up topics, in the form of a bag's reader or of rclpy, and the map that names the topics."""

from types import SimpleNamespace

import numpy as np
import pytest
from made_up_motion import ANCHORS
from plain_filter import run_plainly

from ortilo_drake.studies.live import anchor_bank, live_filter, rates_watch
from ortilo_drake.studies.recorded import heading_doubts

TOPICS = "[/r0, /r1, /r2, /r3, /r4, /r5]"
RANGES = f"ranges: {{file: bag, topics: {TOPICS}, values: [range]}}\nanchors: {ANCHORS.tolist()}\n"
IMU = "imu: {file: bag, topic: /imu}\n"
START = "start: {position: [3, 6.1, 1.4], position_sd: 0.5, heading: 0.5}\n"


def run_live_plainly(monkeypatch: pytest.MonkeyPatch) -> None:
    """Run a live filter and its watches as plain Python, for a test of a few seconds of messages."""
    run_plainly(monkeypatch, live_filter, "run_filter", "initial_carried")
    for watch, name in ((heading_doubts, "follow"), (rates_watch, "follow"), (anchor_bank, "follow_ranges")):
        run_plainly(monkeypatch, watch, name)


def header(t):
    seconds = int(t)
    return SimpleNamespace(stamp=SimpleNamespace(sec=seconds, nanosec=round((t - seconds) * 1e9)))


def range_message(t, r):
    return SimpleNamespace(header=header(t), range=r)


def imu_message(t, rates=(0.0, 0.0, 0.0), force=(0.0, 0.0, 9.81)):
    w, f = (SimpleNamespace(x=v[0], y=v[1], z=v[2]) for v in (rates, force))
    return SimpleNamespace(header=header(t), angular_velocity=w, linear_acceleration=f)


def messages_of(motion):
    """Return (topic, time of receipt [ns], message) for all samples of a motion, in the order of the stamps."""
    found = [(t, "/imu", imu_message(t, row[:3], row[3:])) for t, row in zip(motion.t_imu, motion.imu, strict=True)]
    for t, row in zip(motion.t_r, motion.r, strict=True):
        found += [(t, f"/r{i}", range_message(t, float(r))) for i, r in enumerate(row) if np.isfinite(r)]
    return [(topic, round(t * 1e9), message) for t, topic, message in sorted(found, key=lambda one: one[0])]
