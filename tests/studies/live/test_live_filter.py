"""The live filter beside the replayed one, which is given the whole recording at once: the same bits."""

import contextlib

import numpy as np
import pytest
from live_messages import IMU, RANGES, START, messages_of, run_live_plainly
from made_up_motion import ANCHORS, BAG_MAP, as_map, made_up, quick_place, write_bag
from plain_filter import run_plainly

from ortilo_drake.interop.recorded.bag_columns import at_pace, bag_messages
from ortilo_drake.interop.recorded.range_rows import single_ranges
from ortilo_drake.interop.recorded.recording import Imu, Recording, read_recording
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.studies.live.live_bridge import LiveBridge, run_live
from ortilo_drake.studies.live.sensor_records import LOST
from ortilo_drake.studies.recorded import reacquired
from ortilo_drake.studies.recorded.at_rest import at_rest
from ortilo_drake.studies.recorded.filtered import TRIAL, estimate
from ortilo_drake.studies.recorded.replayed import RAW, replay
from ortilo_drake.studies.recorded.setups import uncalibrated_setup


def without(motion, begin, end):
    """Return a motion without the ranges of a time."""
    keep = (motion.t_r < begin) | (motion.t_r > end)
    return motion._replace(t_r=motion.t_r[keep], r=motion.r[keep])


def live(map_, messages, **options):
    lines = []
    bridge = LiveBridge(map_, lines.append, **options)
    found = [one for message in messages for one in bridge.receive(*message)]
    return bridge, found + bridge.end(), lines


def replayed(motion, map_, rate=10.0):
    """Return what `estimate` makes of the whole motion, so many times a second."""
    n, origin = motion.r.shape[1], motion.t_r[0]
    t = np.repeat(motion.t_r, n) - origin
    ranges = single_ranges(t, np.tile(np.arange(n), len(motion.t_r)), motion.r.ravel())
    imu = Imu(motion.t_imu - origin, motion.imu[:, :3], motion.imu[:, 3:], None) if map_.imu is not None else None
    anchors = np.array(map_.anchors)
    recording = Recording("made up", ranges, imu, None, anchors, origin, 0.0, [], {})
    known = uncalibrated_setup(recording, map_, at_rest(recording, map_))
    return estimate(ranges, imu, known, map_.filter, np.arange(0, int(t[-1] * rate)) * (1.0 / rate))


def as_stamped(motion):
    """Return a motion whose stamps are as a header's seconds and nanoseconds make them."""

    def stamps(t):
        return np.array([int(one) + 1e-9 * round((one - int(one)) * 1e9) for one in t])

    return motion._replace(t_r=stamps(motion.t_r), t_imu=stamps(motion.t_imu))


def assert_same(found, expected):
    k = len(expected.t)
    assert len(found) >= k  # the imu may go on after the last range
    np.testing.assert_array_equal([one.estimate[:3] for one in found[:k]], expected.p)
    np.testing.assert_array_equal([one.covariance[:3, :3] for one in found[:k]], expected.P)


@pytest.mark.long
@pytest.mark.parametrize("reflected", [0.0, 0.05])
def test_with_an_imu_each_estimate_is_the_replayed_one_bit_for_bit(reflected) -> None:
    motion = as_stamped(made_up(6.0, outliers=0.05))
    map_ = as_map(RANGES + IMU + START + f"filter: {{reflected: {reflected}}}\n")
    bridge, found, lines = live(map_, messages_of(motion))
    expected = replayed(motion, map_)
    assert len(expected.t) > 50
    assert_same(found, expected)
    report = bridge.report()
    assert motion.r.size - 12 <= report.ranges  # those after the last estimate are not needed
    assert report.taken == expected.run.taken[: report.ranges].sum() < report.ranges
    assert report.rejected == report.failed == {}
    assert lines == ["the filter has begun, by the ranges from 0.0 s after the first on"]


def test_topics_that_come_late_and_in_turns_make_no_difference(monkeypatch) -> None:
    run_live_plainly(monkeypatch)
    run_plainly(monkeypatch, reacquired, "run_filter", "initial_carried")
    motion, map_ = as_stamped(made_up(2.5)), as_map(RANGES + IMU + START)
    behind = {f"/r{i}": 7_000_000 * i for i in range(6)} | {"/imu": 20_000_000}  # [ns]
    messages = sorted(messages_of(motion), key=lambda one: one[1] + behind[one[0]])
    _, found, _ = live(map_, messages)
    assert_same(found, replayed(motion, map_))


def test_in_a_silence_of_the_imu_the_estimates_are_the_replayed_ones(monkeypatch) -> None:
    """Live, a run then has no samples at all: the last one must not hold for longer than in a replay."""
    run_live_plainly(monkeypatch)
    run_plainly(monkeypatch, reacquired, "run_filter", "initial_carried")
    motion, map_ = as_stamped(made_up(2.6)), as_map(RANGES + IMU + START)
    heard = (motion.t_imu < 1.2) | (motion.t_imu > 2.2)
    motion = motion._replace(t_imu=motion.t_imu[heard], imu=motion.imu[heard])
    _, found, _ = live(map_, messages_of(motion))
    assert_same(found, replayed(motion, map_))
    yaw = {round(one.t - found[0].t, 1): one.yaw_deviation for one in found}
    assert yaw[2.0] > 2.0 * yaw[1.0]  # the body may have turned


@pytest.mark.long
def test_a_filter_that_is_lost_waits_for_the_ranges_that_replay_starts_anew_from() -> None:
    motion, map_ = as_stamped(without(made_up(14.0), 3.0, 10.0)), as_map(RANGES)
    bridge, found, lines = live(map_, messages_of(motion))
    expected = replayed(motion, map_)
    assert len(expected.lost) == bridge.report().lost == 1
    assert lines[-1].startswith(("the filter was lost", "/r"))
    assert_same(found, expected)


@pytest.mark.long
def test_at_rest_the_filter_begins_when_replay_does() -> None:
    motion, map_ = as_stamped(made_up(5.0)), as_map(RANGES + IMU.replace("/imu}", "/imu, standstill: 2}") + START)
    _, found, lines = live(map_, messages_of(motion))
    expected = replayed(motion, map_)
    assert lines == ["the filter has begun, by the ranges from 2.0 s after the first on"] or "from 1.9" in lines[0]
    assert_same(found, expected)


@pytest.mark.long
def test_at_another_rate_the_bits_are_those_of_a_replay_asked_as_often() -> None:
    motion, map_ = as_stamped(made_up(3.0)), as_map(RANGES + IMU + START)
    _, found, _ = live(map_, messages_of(motion), rate=50.0)
    expected = replayed(motion, map_, 50.0)
    assert len(expected.t) > 100
    assert_same(found, expected)


def test_what_is_missing_is_said_where_nothing_begins() -> None:
    motion, map_ = made_up(3.0), as_map(RANGES + IMU + START)
    bridge, found, _ = live(map_, [one for one in messages_of(motion) if one[0] != "/imu"])
    assert found == []
    assert "imu" in bridge.report().not_begun
    bridge, found, _ = live(as_map(RANGES), [one for one in messages_of(motion) if one[0] in ("/r0", "/r1")])
    assert found == []
    assert "at least 3 are needed" in bridge.report().not_begun


@pytest.mark.parametrize(("x", "sd", "refused"), [(3.0, 0.03, False), (5.0, 0.03, True), (5.0, 1.0, False)])
def test_a_start_that_the_first_ranges_contradict_is_refused(monkeypatch, x, sd, refused) -> None:
    """An autopilot that is given a wrong start flies by it for tens of seconds: the anchors' biases take it up."""
    run_live_plainly(monkeypatch)
    motion, place = made_up(1.5), [x, 6.1, 1.4]
    map_ = as_map(RANGES + IMU + f"start: {{position: {place}, position_sd: {sd}, heading: 0.5}}\n")
    off = np.median(np.abs(motion.r[0] - np.linalg.norm(place - ANCHORS, axis=1)))
    said = pytest.raises(InputError, match=f"^start: the first ranges are {off:.1f} m [^\n]*$")
    with said if refused else contextlib.nullcontext():
        live(map_, messages_of(motion))


def test_why_nothing_begins_is_said_after_three_seconds() -> None:
    """Without a heading eight are tried, for 30 s: nobody would know what it waits for."""
    _, _, lines = live(as_map(RANGES + IMU), messages_of(made_up(4.0)))
    assert lines[0] == "not begun after 3 s: it needs ranges until 30.0 s after the first"


@pytest.mark.parametrize(("heading", "told"), [(0.5, False), (0.5 - np.pi / 2, True)])
def test_a_heading_that_the_ranges_contradict_is_said(monkeypatch, heading, told) -> None:
    run_live_plainly(monkeypatch)
    start = f"start: {{position: {quick_place(np.zeros(1))[0].tolist()}, position_sd: 0.1, heading: {heading}}}\n"
    noise = "filter: {range_white: 0.03, range_correlated: 0.02, acceleration: 0.05}\n"
    _, _, lines = live(as_map(RANGES + IMU + start + noise), messages_of(made_up(5.0, place=quick_place)))
    assert any(line.startswith("warning  ranges: the gate rejects") for line in lines) == told
    said = [line for line in lines if line.startswith("warning  heading: the heading at the start is off by -")]
    assert len(said) == told


@pytest.mark.parametrize(("lasts", "anew"), [(0.8 * LOST, False), (1.2 * LOST, True)])
def test_after_a_long_silence_of_the_imu_nothing_is_claimed_by_the_old_heading(monkeypatch, lasts, anew) -> None:
    """It claimed a heading to 7 degrees that was 93 degrees wrong; in the air one is found in 30 s, see TRIAL."""
    run_live_plainly(monkeypatch)
    motion = made_up(9.0)
    keep = (motion.t_imu < 1.5) | (motion.t_imu > 1.5 + lasts)
    motion = motion._replace(t_imu=motion.t_imu[keep], imu=motion.imu[keep])
    map_ = as_map(RANGES + IMU + START)
    lines: list[str] = []
    bridge = LiveBridge(map_, lines.append)
    found = [one for message in messages_of(motion) for one in bridge.receive(*message)]
    assert (found[-1].t < 1.6 + lasts) == anew
    assert bridge.report().lost == anew
    assert ("needs ranges until" in bridge.report().not_begun) == anew
    assert any(line.startswith("the filter begins anew: ") for line in lines) == anew


@pytest.mark.parametrize("blackout", [0.0, 2.0])
def test_the_trials_behind_a_long_silence_of_the_imu_start_over_behind_a_blackout(monkeypatch, blackout) -> None:
    """Headings tried over one ended 102 degrees off."""
    run_live_plainly(monkeypatch)
    motion = without(made_up(13.0), 9.02, 9.02 + blackout)
    keep = (motion.t_imu < 1.5) | (motion.t_imu > 1.7 + LOST)
    bridge = LiveBridge(as_map(RANGES + IMU + START), lambda line: None)
    for message in messages_of(motion._replace(t_imu=motion.t_imu[keep], imu=motion.imu[keep])):
        bridge.receive(*message)
    first = 9.05 + blackout if blackout else 1.75 + LOST  # of the ranges that count, every 0.05 s from 0.05 s on
    assert f"needs ranges until {first - 0.05 + TRIAL:.1f} s" in bridge.report().not_begun


LANDS = START.replace("heading: 0.5", "heading: 0.5, rests: true, lands: true")
TAGGED = """
ranges: {file: bag, topic: /uwb, anchor: to, tag: from, values: [range]}
anchors: {A: [0, 0, 0], B: [6, 0, 2], C: [6, 8, 0]}
tags: {L: [0, 0.3, 0], R: [0, -0.3, 0]}
"""
BOXES = "boxes: {file: bag, topic: /boxes, label: class, box: [left, top, right, bottom], room: room.yaml}\n"


@pytest.mark.parametrize(
    ("text", "said"), [(RANGES + IMU + LANDS, "start.lands"), (TAGGED, "tags"), (RANGES + IMU + BOXES, "boxes")]
)
def test_what_is_not_heard_live_is_one_line(text, said) -> None:
    map_ = as_map(text)
    with pytest.raises(InputError, match=f"^{said}: [^\n]*$"):
        LiveBridge(map_, lambda _: None)


@pytest.mark.long
def test_a_target_that_fails_gets_no_more_and_ctrl_c_ends_with_a_report() -> None:
    motion, map_, given = made_up(3.0), as_map(RANGES), []

    def fails(*_):
        raise OSError("no route\nto host")

    bridge = LiveBridge(map_, lambda _: None)
    bridge.add_target("mavlink", fails)
    bridge.add_target("mine", lambda *parts: given.append(parts))

    def interrupted():
        yield from messages_of(motion)
        yield None
        raise KeyboardInterrupt

    report = run_live(bridge, interrupted(), lambda _: None)
    assert report.failed == {"mavlink": "no route to host"}
    assert report.estimates == len(given) > 10


@pytest.mark.long
@pytest.mark.parametrize("kind", ["sqlite3", "mcap", "ros1"])
def test_a_recorded_bag_at_its_own_pace_gives_what_ortilo_replay_gives(tmp_path, kind: str) -> None:
    """Without a heading, so that eight are tried; ten times as fast."""
    motion = made_up(36.0, outliers=0.03)
    name = "bag.bag" if kind == "ros1" else "bag"
    write_bag(tmp_path / name, motion, kind)
    map_ = as_map(BAG_MAP[: BAG_MAP.index("truth:")].replace("BAG", name))
    expected = replay(read_recording(tmp_path, map_), map_, lambda _: None)[1][RAW][0]
    found = []
    bridge = LiveBridge(map_, lambda _: None)
    bridge.warm_up()
    bridge.add_target("kept", lambda told, wanted, lost: found.append(told))
    run_live(bridge, at_pace(bag_messages(tmp_path / name, bridge.topics), 10.0), lambda _: None)
    assert_same(found, expected)
