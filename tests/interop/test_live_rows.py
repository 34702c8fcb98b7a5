"""Live messages become rows in the order of their stamps; what cannot be used is counted, and nothing stops."""

import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from live_messages import IMU, RANGES, imu_message, range_message
from made_up_motion import as_map

from ortilo_drake.interop.recorded.live_rows import LiveRows
from ortilo_drake.model.typed_yaml import InputError


def fed(rows, *messages):
    """Feed (topic, message) and return the lines said."""
    return [line for topic, message in messages for line in rows.add(topic, 0, message)]


def all_ranges(t, r=1.0):
    return [(f"/r{i}", range_message(t, r + i)) for i in range(6)]


def test_rows_come_in_the_order_of_their_stamps_however_topics_take_turns() -> None:
    rows = LiveRows(as_map(RANGES), lag=1.0)
    rng, t = np.random.default_rng(0), np.arange(10.0, 12.0, 0.1)
    messages = [(f"/r{i}", range_message(one, 1.0 + i)) for i in range(6) for one in t]
    delays = np.concatenate([np.sort(t + rng.uniform(0.0, 0.5, len(t))) for _ in range(6)])
    blocks = []
    for k in np.argsort(delays, kind="stable"):
        assert not fed(rows, messages[k])
        due = rows.before()
        if due is not None:
            horizon, block = due
            assert (block.ranges.t < horizon).all()
            blocks.append(block.ranges)
    blocks.append(rows.before(ended=True)[1].ranges)
    got = np.column_stack([np.concatenate([block[i] for block in blocks]) for i in (0, 1, 2)])
    expected = [(one - 10.0, i, 1.0 + i) for one in t for i in range(6)]
    np.testing.assert_allclose(got, expected, atol=1e-8)
    assert rows.origin == 10.0
    assert rows.counts() == {}


def test_a_topic_that_is_silent_holds_the_others_back_by_the_lag_and_is_named() -> None:
    rows = LiveRows(as_map(RANGES + IMU), lag=0.2)
    for k in range(4):
        fed(rows, *all_ranges(5.0 + 0.1 * k))
    horizon, block = rows.before()
    assert horizon == pytest.approx(0.3 - 0.2)
    assert len(block.ranges.t) == 6  # those at 5.0; 5.1 is not before the horizon
    lines = [line for k in range(25) for line in fed(rows, *all_ranges(5.4 + 0.1 * k))]
    assert lines == ["/imu (imu): silent for 2 s"]
    assert fed(rows, ("/imu", imu_message(7.8))) == ["/imu (imu): heard again"]
    fed(rows, ("/imu", imu_message(6.0)))
    assert rows.counts() == {"/imu (imu): backward stamps": 1}


def test_topics_that_fall_silent_together_are_told_of_in_one_line() -> None:
    """A gap of all ranges was told twelve times in a room of twelve anchors, and its end again."""
    rows, lines = LiveRows(as_map(RANGES + IMU)), []
    for k in range(160):
        t = 5.0 + 0.1 * k
        lines += fed(rows, ("/imu", imu_message(t)))
        if t > 6.0 and not 7.0 < t < 11.0:
            lines += fed(rows, *all_ranges(t)[: 6 if t < 14.0 else 5])
    assert lines == [
        "all topics of ranges: silent for 2 s",
        "all topics of ranges: heard again",
        "/r5 (ranges): silent for 2 s",
    ]


def test_a_row_that_comes_after_its_turn_is_counted_and_left_out() -> None:
    rows = LiveRows(as_map(RANGES), lag=0.2)
    for k in range(10):
        fed(rows, *all_ranges(5.0 + 0.1 * k)[1:])
    horizon, _ = rows.before()
    assert horizon == pytest.approx(0.7)
    fed(rows, ("/r0", range_message(5.3, 1.0)), ("/r0", range_message(5.8, 1.0)))
    assert rows.counts() == {"/r0 (ranges): rows that came too late": 1}
    assert 0 in rows.before(ended=True)[1].ranges.anchor


@pytest.mark.parametrize(("delay", "said"), [(0.08, None), (0.15, "--lag 0.15 takes them"), (3.0, "another clock?")])
def test_a_topic_later_than_the_lag_is_warned_of_once_with_the_lag_it_needs(delay, said) -> None:
    """IMU samples reach the bridge so much later than ranges of the same stamps do."""
    rows, lines = LiveRows(as_map(RANGES + IMU), lag=0.1), list[str]()
    arrivals = [(5.0 + 0.05 * k, one) for k in range(200) for one in all_ranges(5.0 + 0.05 * k)]
    arrivals += [(5.0 + 0.05 * k + delay + 0.001, ("/imu", imu_message(5.0 + 0.05 * k))) for k in range(200)]
    for _, message in sorted(arrivals, key=lambda one: one[0]):
        lines += fed(rows, message)
        rows.before()
    found = [line for line in lines if "warning" in line]
    assert len(found) == (said is not None)
    if said is not None:
        assert found[0].startswith("warning  /imu: 10 messages are not used")
        assert said in found[0]


@pytest.mark.parametrize(
    ("gains", "said"), [(0.004, "the clock of /r3 is fast by "), (-0.004, "the clock of /r3 is slow by ")]
)
def test_a_clock_that_drifts_is_named_with_its_rate(gains, said) -> None:
    """The stamps of one topic's clock; all arrive up to 5 ms after they were made."""
    rows, lines, rng = LiveRows(as_map(RANGES), lag=0.03), list[str](), np.random.default_rng(1)
    for k in range(800):
        t = 1000.0 + 0.05 * k
        for i in range(6):
            stamp = t + (gains * (t - 1000.0) if i == 3 else 0.0)
            lines += rows.add(f"/r{i}", round(1e9 * (t + rng.uniform(0.0, 0.005))), range_message(stamp, 1.0))
        rows.before()
    found = [line for line in lines if "warning" in line]
    assert found
    for line in found:
        assert said in line
        assert float(re.search(r"by ([0-9.]+)% \(", line)[1]) == pytest.approx(0.4, abs=0.02)


def test_rows_dropped_long_ago_are_no_cause_of_a_silence() -> None:
    rows, lines = LiveRows(as_map(RANGES + IMU)), []
    for k in range(100):
        t = 5.0 + 0.1 * k
        lines += fed(rows, ("/imu", imu_message(t if t < 11.0 else 10.9)))
        lines += [] if 7.0 < t < 10.0 else fed(rows, *all_ranges(t), *all_ranges(4.0 if k == 10 else t))
    assert lines[0] == "all topics of ranges: silent for 2 s"  # not: 12 backward and duplicate stamps
    assert lines[-1].startswith("/imu (imu): silent for 2 s. What came is not used: ")
    assert "duplicate stamps, first in message 61" in lines[-1]


def test_what_cannot_be_used_is_counted_by_its_reason() -> None:
    rows = LiveRows(as_map(RANGES + IMU))
    good = [(f"/r{i}", range_message(1.0, 2.0)) for i in range(6)]
    bad = [("/r0", range_message(1.0 + 0.1 * k, r)) for k, r in enumerate((np.nan, 0.0, 1e6), 1)]
    bad += [("/r0", range_message(1.3, 2.0)), ("/r0", range_message(1.2, 2.0))]
    bad += [("/imu", imu_message(1.1, rates=(np.inf, 0.0, 0.0)))]
    fed(rows, *good, *bad)
    _, block = rows.before(ended=True)
    assert rows.counts() == {
        "/r0 (ranges): ranges that are NaN or empty": 1,
        "/r0 (ranges): ranges of 0 or less": 1,
        "/r0 (ranges): ranges of more than 100 km": 1,
        "/r0 (ranges): duplicate stamps": 1,
        "/r0 (ranges): backward stamps": 1,
        "/imu (imu): rows with NaN, infinity or an empty cell": 1,
    }
    assert len(block.ranges.t) == 6
    assert len(block.imu.t) == 0


def test_a_message_of_another_type_and_a_stranger_are_said_once_and_counted() -> None:
    rows = LiveRows(as_map(RANGES))
    lines = fed(rows, ("/r0", imu_message(1.0)), ("/r0", imu_message(1.1)), ("/x", None), ("/x", None), ("/r1", None))
    assert lines == [
        "/r0: SimpleNamespace has no field 'range'",
        "/x: is not in the map",
        "/r1: NoneType has no field 'range'",
    ]
    assert rows.counts() == {
        "/r0 (ranges): messages without a field asked for": 2,
        "/r1 (ranges): messages without a field asked for": 1,
        "messages of topics that are not in the map": 2,
    }


@pytest.mark.parametrize("odd", [1.0, 2e9])
def test_a_first_stamp_by_a_clock_that_was_not_set_is_forgotten(odd: float) -> None:
    rows = LiveRows(as_map(RANGES))
    fed(rows, ("/r0", range_message(odd, 3.0)))
    rows.before()
    for k in range(20):
        fed(rows, *all_ranges(1e9 + 0.1 * k))
        rows.before()
    far = "/r0 (ranges): rows with a stamp more than an hour from the others"
    assert rows.counts() == {far: 1}
    fed(rows, ("/r0", range_message(odd, 3.0)))  # and later on it is one spoilt number
    assert rows.counts() == {far: 2}
    assert rows.origin == 1e9


def test_rows_that_name_their_anchor_may_come_out_of_order() -> None:
    text = "ranges: {file: bag, topic: /r, values: [range], anchor: frame}\n"
    text += "anchors: {a: [0, 0, 0], b: [1, 0, 0], c: [0, 1, 0]}\n"
    rows = LiveRows(as_map(text))
    for t, name in ((5.0, "b"), (5.02, "a"), (5.01, "c"), (5.02, "a"), (5.03, "d")):
        message = range_message(t, 1.0)
        message.frame = name
        fed(rows, ("/r", message))
    _, block = rows.before(ended=True)
    assert block.ranges.anchor.tolist() == [1, 2, 0]
    assert sum(rows.counts().values()) == 2  # the repetition and the stranger


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            RANGES.replace(f"topics: {TOPICS}", "time: t").replace("[range]", "[1, 2, 3, 4, 5, 6]"),
            "each live source needs a `topic`",
        )
        for TOPICS in ("[/r0, /r1, /r2, /r3, /r4, /r5]",)
    ]
    + [
        (RANGES + IMU.replace("/imu}", "/imu, zero: first}"), "one clock"),
        (RANGES + IMU + "command: {file: bag, topic: /u, thrust: data}\n", "command"),
        (RANGES[: RANGES.index("anchors")] + "anchors: nowhere.yaml\n", "no such file"),
    ],
)
def test_a_map_that_only_files_can_answer_is_refused(text: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        LiveRows(as_map(text))


def test_a_px4_s_own_imu_is_heard_by_the_map_of_the_guide() -> None:
    """px4_msgs/SensorCombined has no header: its stamp counts microseconds, its axes are forward, right, down."""
    text = (Path(__file__).parents[2] / "docs/how_to/real_sensors.md").read_text(encoding="utf-8")
    px4 = next(block for block in re.findall(r"```yaml\n(.*?)```", text, re.DOTALL) if "sensor_combined" in block)
    rows = LiveRows(as_map(RANGES + px4))
    for k in range(5):
        t = 1_700_000_000.0 + 0.1 * k
        message = SimpleNamespace(
            timestamp=round(t * 1e6),
            gyro_rad=np.array([0.1, 0.2, 0.3], np.float32),
            accelerometer_m_s2=np.array([0.4, 0.5, -9.8], np.float32),
        )
        assert fed(rows, *all_ranges(t), ("/fmu/out/sensor_combined", message)) == []
    _, block = rows.before(ended=True)
    assert rows.counts() == {}
    np.testing.assert_allclose(block.imu.t, 0.1 * np.arange(5), atol=1e-6)
    np.testing.assert_allclose(block.imu.rates[0], [0.1, -0.2, -0.3], rtol=1e-6)
    np.testing.assert_allclose(block.imu.force[0], [0.4, -0.5, 9.8], rtol=1e-6)
