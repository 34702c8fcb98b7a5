"""Figures by anchor, of numbers whose figures are known."""

import numpy as np
import pytest
from live_messages import RANGES, messages_of, run_live_plainly
from made_up_motion import BIASES, as_map, made_up

from ortilo_drake.studies.live.live_bridge import LiveBridge
from ortilo_drake.studies.live.sensor_records import AnchorRecord
from ortilo_drake.studies.recorded.filter_types import BIASES as AT
from ortilo_drake.studies.recorded.filter_types import Run, State, states


def run_of(innovation, variance, taken) -> Run:
    innovation, variance = (np.array(part, dtype=float) for part in (innovation, variance))
    return Run(np.zeros((0, 1)), np.zeros((0, 3, 3)), innovation, variance, np.array(taken, dtype=bool), None)


def state_of(t, biases, sd=0.02) -> State:
    n = len(biases)
    x, C = np.zeros(states(n) + 1), np.eye(states(n))
    x[AT + 1 : AT + 1 + n], C[AT : AT + n, AT : AT + n] = biases, sd**2 * np.eye(n)
    return State(t, x, C, np.zeros(6), np.zeros(14))


def test_the_figures_are_means_of_what_was_taken() -> None:
    record = AnchorRecord(5)
    assert record.nis is None
    run = run_of([0.1, -0.3, 2.0, 0.2, 0.0], [0.01, 0.04, 0.04, 0.04, 1.0], [True, True, False, True, False])
    record.add(np.array([0, 0, 0, 2, 2]), run, state_of(1.0, [0.01, 0.02, 0.03, 0.04, 0.05]))  # the last one: at rest
    first, none, third, *_ = record.figures()
    assert none is None
    assert (first.ranges, first.rejected) == (3, pytest.approx(1.0 / 3.0))
    assert first.nis == pytest.approx((1.0 + 2.25) / 2.0)
    assert (first.mean, first.mean_sd) == (pytest.approx(-0.1), pytest.approx(np.sqrt(0.05) / 2.0))
    assert (third.ranges, third.nis, third.bias) == (1, pytest.approx(1.0), pytest.approx(0.03))
    assert record.nis == pytest.approx((1.0 + 2.25 + 1.0) / 3.0)
    assert "3 ranges, 33.3% rejected, NIS 1.62" in first.text()


def test_a_report_has_the_figures_of_each_anchor(monkeypatch) -> None:
    run_live_plainly(monkeypatch)
    bridge = LiveBridge(as_map(RANGES), lambda _: None)
    motion = made_up(2.5)
    for message in messages_of(motion._replace(r=motion.r - BIASES)):
        if message[0] != "/imu":
            bridge.receive(*message)
    bridge.end()
    report = bridge.report()
    assert report.nis < 1.5
    assert list(report.anchors) == [f"/r{i}" for i in range(6)]
    assert sum(one.ranges for one in report.anchors.values()) == report.ranges
