"""Figures by anchor, of numbers whose figures are known, and the anchor whose bias is no bias."""

import numpy as np
import pytest
from live_messages import IMU, RANGES, messages_of
from made_up_motion import ANCHORS, BIASES, LEVER, as_map, made_up
from plain_filter import run_plainly

from ortilo_drake.studies.live import live_filter
from ortilo_drake.studies.live.anchor_record import AnchorRecord, odd_anchor
from ortilo_drake.studies.live.live_bridge import LiveBridge
from ortilo_drake.studies.recorded import heading_doubts
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
    record = AnchorRecord(5, 0.2)
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


@pytest.mark.parametrize(
    ("biases", "sd", "odd"),
    [
        ([0.0, 0.1, -0.4, 0.05, 0.0], 0.05, 2),  # 0.425 m from the others' median
        ([0.0, 0.1, -0.3, 0.05, 0.0], 0.05, None),  # a bias that is not rare
        ([0.0, 0.1, -0.4, 0.05, 0.0], 0.2, None),  # not known well enough
        ([0.5, 0.5, 0.1, 0.5, 0.5], 0.05, 2),  # what all have is not its own
        ([0.0, 0.0, -0.9], 0.01, None),
    ],
)
def test_an_anchor_is_odd_whose_bias_is_far_from_the_others(biases, sd, odd) -> None:
    found = odd_anchor(np.array(biases), sd**2 * np.eye(len(biases)), 0.2)
    assert (None if found is None else found.anchor) == odd


def test_it_must_last() -> None:
    record, none = AnchorRecord(4, 0.2), run_of([], [], [])
    for t, biases in ((0.0, [0.0, 0.0, 0.9, 0.0]), (1.5, [0.0] * 4), (3.0, [0.0, 0.0, 0.9, 0.0])):
        record.add(np.zeros(0, np.int64), none, state_of(t, biases))
        assert record.odd is None
    record.add(np.zeros(0, np.int64), none, state_of(5.5, [0.0, 0.0, 0.9, 0.0]))
    assert record.odd.off == pytest.approx(0.9)


@pytest.mark.parametrize("wrong", [None, 2])
def test_an_anchor_half_a_metre_off_is_warned_of_by_its_name(monkeypatch, wrong) -> None:
    run_plainly(monkeypatch, live_filter, "run_filter", "initial_carried")
    run_plainly(monkeypatch, heading_doubts, "follow")
    motion, anchors = made_up(6.0), ANCHORS.copy()
    if wrong is not None:
        anchors[wrong] += [0.5, 0.0, 0.0]
    text = RANGES.replace(str(ANCHORS.tolist()), str(anchors.tolist())) + IMU
    text += f"start: {{position: [3, 6.1, 1.4], heading: 0.5}}\ncalibration: {{lever: {LEVER.tolist()}}}\n"
    lines = list[str]()
    bridge = LiveBridge(as_map(text), lines.append)
    unbiased = motion._replace(r=motion.r - BIASES)
    for message in messages_of(unbiased):
        bridge.receive(*message)
    bridge.end()
    said = [line for line in lines if line.startswith("warning  anchor")]
    assert [line.startswith("warning  anchor 3: its ranges are -0.") for line in said] == (
        [] if wrong is None else [True]
    )
    report = bridge.report()
    assert report.nis < 1.5
    assert list(report.anchors) == ["1", "2", "3", "4", "5", "6"]
    assert sum(one.ranges for one in report.anchors.values()) == report.ranges
