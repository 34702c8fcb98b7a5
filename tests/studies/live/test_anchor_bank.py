"""An anchor that is not where the map has it, found by the filter that frees its place."""

import re
from itertools import pairwise

import numpy as np
import pytest
from live_messages import IMU, RANGES, START, messages_of
from made_up_motion import ANCHORS, BIASES, as_map, made_up, quick_place
from scipy.optimize import least_squares
from usd_logs import util_folder, util_map

from ortilo_drake.interop.recorded.live_rows import Block, parted
from ortilo_drake.interop.recorded.recording import read_recording
from ortilo_drake.loop.plain import plain_source
from ortilo_drake.studies.live import anchor_bank as anchor_bank_module
from ortilo_drake.studies.live import live_filter
from ortilo_drake.studies.live.anchor_bank import SETTLED, AnchorWatch, anchor_bank, follow_ranges
from ortilo_drake.studies.live.live_bridge import LiveBridge
from ortilo_drake.studies.live.live_warnings import LiveWarnings
from ortilo_drake.studies.live.stamped_estimate import Limits
from ortilo_drake.studies.recorded.filter_types import RANGE, Events


def events_of(motion) -> Events:
    k, n = motion.r.shape
    t, none = np.repeat(motion.t_r, n), np.zeros(k * n, np.int64)
    return Events(t, none + RANGE, np.tile(np.arange(n), k), none - 1, motion.r.ravel(), none)


def test_the_estimate_is_that_of_least_squares_on_all_ranges() -> None:
    """A body at rest whose ranges have one stamp: one system of equations with the same priors, by SciPy."""
    rng, p = np.random.default_rng(0), np.array([2.5, 3.0, 1.2])
    anchors, n = ANCHORS.copy(), len(ANCHORS)
    anchors[2] += [0.1, 0.1, 0.0]
    r = np.linalg.norm(p - ANCHORS, axis=1) + 0.003 * rng.standard_normal((40, n))
    none = np.zeros(40 * n, np.int64)
    events = Events(np.zeros(40 * n), none + RANGE, np.tile(np.arange(n), 40), none - 1, r.ravel(), none)
    bank = anchor_bank(anchors, p + 0.02, 0.0, 0.02)
    plain_source(follow_ranges)(bank, events, 1.0, 0.06, 100.0)

    def residuals(y: np.ndarray) -> np.ndarray:
        moved = anchors.copy()
        moved[2] += y[3 + n :]
        expected = np.linalg.norm(y[:3] - moved, axis=1) + y[3 : 3 + n]
        start = np.concatenate(((y[:3] - p - 0.02) / 0.5, y[3 : 3 + n] / 0.02, y[3 + n :] / 0.5))
        return np.concatenate((((r - expected) / 0.06).ravel(), start))

    found = least_squares(residuals, np.concatenate((p, np.zeros(n + 3)))).x
    estimate = np.delete(bank.x[3], [3, 4, 5])  # the third anchor's filter, without the velocity
    assert np.abs(found[-3:]).max() > 0.02
    np.testing.assert_allclose(estimate, found, atol=0.002)  # it is linearised once for each range


@pytest.mark.long
@pytest.mark.parametrize("wrong", [None, 0, 2, 5])
def test_an_anchor_half_a_metre_off_is_named_with_its_place(wrong) -> None:
    motion, anchors = made_up(40.0), ANCHORS.copy()
    if wrong is not None:
        anchors[wrong] += [0.5, 0.0, 0.0]
    map_, events = (
        as_map(f"ranges: {{file: b, topics: [a, b, c, d, e, f], values: [r]}}\nanchors: {anchors.tolist()}"),
        events_of(motion),
    )
    watch = AnchorWatch(anchors, map_.filter, 0.06)
    times = np.arange(0.5, 40.0, 0.5)
    for begin, end in pairwise(times):
        part = (events.t > begin) & (events.t <= end)
        place = np.array([3.0, 4.0 + 2.5 * np.sin(1.0), 1.4])
        watch.advance(Events(*(column[part] for column in events)), place, end, 0.1)
        assert watch.wrong is None or end > SETTLED[0]
    assert (watch.wrong is None) == (wrong is None)
    if wrong is None:
        return
    assert watch.wrong.anchors == [(wrong,)]
    np.testing.assert_allclose(watch.wrong.place, ANCHORS[wrong], atol=0.2)
    assert np.abs(BIASES).max() == 0.2  # which the ranges have beside
    lines = list[str]()
    filter_ = live_filter.LiveFilter(map_, anchors)
    filter_.places = watch
    LiveWarnings(map_, lines.append).look_at(filter_)
    assert lines[0].startswith(f"warning  anchor {'abcdef'[wrong]!r}: about [")


@pytest.mark.long
@pytest.mark.parametrize("pair", [(0, 1), (1, 3)])
def test_two_exchanged_anchors_are_named_no_heading_is_and_an_autopilot_gets_nothing(pair) -> None:
    """The filter of the turn alone calls the heading wrong by -80 and -38 degrees, after 5 s."""
    order = np.arange(6)
    order[list(pair)] = pair[::-1]
    start = START.replace("[3, 6.1, 1.4]", str(quick_place(np.zeros(1))[0].tolist()))
    map_ = as_map(RANGES.replace(str(ANCHORS.tolist()), str(ANCHORS[order].tolist())) + IMU + start)
    lines = list[str]()
    bridge = LiveBridge(map_, lines.append)
    for message in messages_of(made_up(9.0, place=quick_place)):
        bridge.receive(*message)
    names = f"'/r{pair[0]}' and '/r{pair[1]}'"
    assert any(line.startswith(f"warning  anchors {names}: exchanged they fit the ranges better") for line in lines)
    assert not any(line.startswith("warning  heading") for line in lines)
    assert bridge._filter.why_unfit(False) == "two anchors are exchanged"


@pytest.mark.long
def test_noise_that_is_too_small_is_named_with_what_mends_it_and_no_anchor_is() -> None:
    """The ranges have 0.15 m, the map 0.06 m: one is beyond four of its deviations in 10, and its covariance too small.

    Six times as large, the variance is what it should be, and nobody need hold the estimates back.
    """
    messages = messages_of(made_up(20.0, noise=0.15))
    lines, filter_, made, sent = played(as_map(RANGES + IMU + START), messages)
    assert filter_.places.wrong is None
    assert filter_.places.scatter == pytest.approx(0.15, abs=0.03)
    (line,) = (line for line in lines if line.startswith("warning  noise: a range scatters by"))
    assert sent[-1].t == made[-1].t
    np.testing.assert_allclose(sent[-1].covariance, filter_.places.widened * made[-1].covariance)
    assert filter_.places.widened == pytest.approx(0.15**2 / (0.03**2 + 0.05**2), rel=0.4)
    mended = as_map(RANGES + IMU + START + re.search(r"`(filter: .*)`", line)[1])
    lines, filter_, made, sent = played(mended, messages)
    assert not any("warning" in line for line in lines)
    assert len(sent) == len(made) > 150


def played(map_, messages):
    """Return what a bridge says, its filter, the estimates that it makes, and those that an autopilot gets."""
    lines, sent = list[str](), []
    bridge = LiveBridge(map_, lines.append)
    bridge.add_target("mavlink", lambda one, *_: sent.append(one), limits=Limits(5.0, 1.0))
    made = [one for message in messages for one in bridge.receive(*message)]
    return lines, bridge._filter, made, sent


@pytest.mark.long
@pytest.mark.parametrize("name", ["0425-traj4", "0426-traj12"])
def test_in_recorded_flights_whose_noise_is_larger_than_the_default_no_right_anchors_are_called_exchanged(name) -> None:
    """Before the larger noise was tried beside them, '2' and '7' were, and '0' and '4'."""
    map_ = as_map(util_map(name, "{}").replace(", lands: true", ""))
    recording = read_recording(util_folder(), map_)
    filter_, left = live_filter.LiveFilter(map_, recording.anchors), Block(*recording[1:3], recording.looks)
    for t in np.arange(0.5, 25.0, 0.5):
        now, left = parted(left, t)
        filter_.advance(t, now)
    assert filter_.places.wrong is None
    assert 0.12 < filter_.places.scatter < 0.35


def test_after_a_silence_the_filters_begin_at_the_antenna_and_keep_what_they_know_of_the_anchors(monkeypatch) -> None:
    monkeypatch.setattr(anchor_bank_module, "follow_ranges", plain_source(follow_ranges))
    motion = made_up(4.0)
    watch, events, far = AnchorWatch(ANCHORS, as_map(RANGES).filter, 0.06), events_of(motion), np.array([9.0, 9.0, 9.0])
    before, after = (Events(*(part[rows] for part in events)) for rows in (events.t < 1.5, events.t > 3.5))
    watch.advance(before, np.array([3.0, 6.1, 1.4]), 0.0, 0.1)
    watch.advance(before, far, 1.5, 0.1)
    bank = watch._bank
    known = bank.x[:, 6:].copy(), bank.C[:, 6:, 6:].copy()
    watch.advance(after, far, 4.0, 3.0)  # the main filter does not know where it is either
    assert not np.allclose(bank.x[:, :3], far)
    watch.advance(after, far, 4.0, 0.1)
    np.testing.assert_array_equal(bank.x[:, :3], np.tile(far, (25, 1)))
    np.testing.assert_array_equal(bank.x[:, 6:], known[0])
    np.testing.assert_array_equal(bank.C[:, 6:, 6:], known[1])
