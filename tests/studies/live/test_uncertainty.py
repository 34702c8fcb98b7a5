"""Estimates that are too uncertain do not reach an autopilot, and both ends of that are said once."""

from types import SimpleNamespace

import numpy as np
import pytest
from live_messages import RANGES, messages_of
from made_up_motion import as_map, made_up
from plain_filter import run_plainly

from ortilo_drake.studies.live import anchor_bank, live_bridge, live_filter
from ortilo_drake.studies.live.agreement import Agreement
from ortilo_drake.studies.live.live_bridge import LiveBridge
from ortilo_drake.studies.live.stamped_estimate import Limits, StampedEstimate
from ortilo_drake.studies.recorded.filter_types import Run


@pytest.mark.parametrize(
    ("variances", "yaw_variance", "why"),
    [
        ((0.2, 0.3, 0.4), 0.2, ""),  # their sum is 0.9 m²
        ((0.4, 0.4, 0.4), 0.2, "standard deviation is above 1 m"),
        ((np.nan, 0.3, 0.4), 0.2, "above 1 m"),
        ((0.2, 0.3, 0.4), 0.3, "heading is above 0.5 rad"),
    ],
)
def test_position_and_heading_are_judged_by_their_own_variances(variances, yaw_variance, why) -> None:
    C = np.diag([*variances, 0.0, 0.0, yaw_variance, *np.zeros(9)])
    assert why in (found := Limits(1.0, 0.5).why_not(StampedEstimate(0.0, np.zeros(15), C)))
    assert bool(found) == bool(why)


@pytest.mark.parametrize(
    ("anchors", "wrong", "unfit", "stays"),
    [(6, 2, True, True), (4, 2, True, True), (4, 1, False, True), (6, 1, False, True), (8, 1, False, False)],
)
def test_two_wrong_anchors_of_six_hold_estimates_back_one_does_not(anchors, wrong, unfit, stays) -> None:
    """All ranges of the wrong ones are rejected, from each in turn."""
    agreement, which = Agreement(), np.arange(20 * anchors) % anchors
    nis = np.ones(len(which))
    agreement.add(np.linspace(0.0, 4.0, len(which)), which, Run(nis, nis, nis, nis, which >= wrong, ()))
    assert agreement.is_unfit(False) == unfit
    assert agreement.is_unfit(True) == stays
    assert agreement.alone() == (0 if wrong == 1 else None)


def test_ranges_that_scatter_more_than_the_map_says_do_not_hold_estimates_back() -> None:
    """Of ranges with five times the deviation half are beyond 3.4 deviations of the map's; none beyond five times 4."""
    agreement, squares = Agreement(), 25.0 * np.tile([0.1, 0.5, 1.0, 4.0], 20)
    sd, which = np.ones(len(squares)), np.arange(len(squares)) % 4
    agreement.add(np.linspace(0.0, 4.0, len(squares)), which, Run(sd, sd, np.sqrt(squares), sd, squares < 16.0, ()))
    assert agreement.is_unfit(False)
    assert not agreement.is_unfit(True, 25.0 * 16.0)
    assert "rejects 50%" in agreement.doubt()
    assert agreement.doubt(25.0 * 16.0, 25.0) == ""
    assert agreement.is_unfit(False, 24.0)  # a gate at 4.9 deviations


def test_over_a_gap_the_autopilot_gets_nothing_beyond_the_limit(monkeypatch) -> None:
    """Ranges missing for 3 s: the constant-velocity filter's deviation grows past 0.2 m and comes back."""
    run_plainly(monkeypatch, live_filter, "run_filter", "initial_carried")
    run_plainly(monkeypatch, anchor_bank, "follow_ranges")
    monkeypatch.setattr(live_bridge, "time", SimpleNamespace(monotonic=lambda: 0.0))
    motion = made_up(8.0)
    keep = (motion.t_r < 3.5) | (motion.t_r > 6.5)
    motion = motion._replace(t_r=motion.t_r[keep], r=motion.r[keep])
    lines, all_, sent = list[str](), list[StampedEstimate](), list[StampedEstimate]()
    bridge = LiveBridge(as_map(RANGES), lines.append)
    bridge.add_target("ros2", lambda one, *_: all_.append(one))
    bridge.add_target("mavlink", lambda one, *_: sent.append(one), limits=Limits(0.2, 0.1))  # no imu: no heading
    for message in messages_of(motion):
        if message[0] != "/imu":
            bridge.receive(*message)
    bridge.end()
    deviation = [one.deviation for one in all_]
    assert max(deviation) > 0.4
    assert max(one.deviation for one in sent) <= 0.2
    assert {one.t for one in all_ if one.deviation <= 0.16} <= {one.t for one in sent}
    assert bridge.report().uncertain == len(all_) - len(sent) > 10
    begins = [line for line in lines if "mavlink: no estimates" in line]
    assert begins == ["warning  mavlink: no estimates: its standard deviation is above 0.2 m"]
    assert lines[-1] == "mavlink: estimates again"
