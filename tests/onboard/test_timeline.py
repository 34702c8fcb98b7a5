"""What acted and what will: against lists in plain Python, a fine sampling in time, and cases by hand."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from played_box import PlayedBox

from ortilo_drake.model.signals import ACT_SIZE, ACTED_SIZE, ACTS, PAYLOAD
from ortilo_drake.onboard.commands.timeline import (
    NONE,
    command_log_box,
    expected_delay,
    first_acts,
    log_ticks,
    mean_control,
    none_sent,
    timeline_of,
    timeline_size,
    unpacked,
    with_command,
    with_report,
)
from ortilo_drake.scenario import load_scenario

H = 0.1
HOVER = 26.0


def u(k: float) -> list[float]:
    return [HOVER + k, k, -k, 2.0 * k]


def report(stamp: float, acts: list[tuple[float, float]]) -> np.ndarray:
    """The message of the newest of (since, stamp), ascending; the command of a stamp is that of its tick."""
    message = np.concatenate(([1.0, stamp], np.tile([-1.0, NONE, *u(0)], ACTS)))
    for i, (since, sent) in enumerate(reversed(acts[-ACTS:])):
        message[PAYLOAD + i * ACT_SIZE : PAYLOAD + (i + 1) * ACT_SIZE] = [since, sent, *u(round(sent / H))]
    return message


def sent(ticks: range, kept: int = 12) -> np.ndarray:
    rows = none_sent(kept)
    for row, k in zip(rows[len(rows) - len(ticks) :], ticks, strict=True):
        row[:] = [k * H, *u(k)]
    return rows


@given(st.lists(st.booleans(), min_size=30, max_size=30), st.lists(st.integers(0, 3), min_size=30, max_size=30))
@settings(max_examples=50, deadline=None)
def test_reports_that_are_lost_or_late_tell_the_same_in_the_end(lost: list[bool], late: list[int]) -> None:
    acts = [((k + 2.3) * H, k * H) for k in range(30)]
    arriving = sorted((k + d, k) for k, d in enumerate(late) if not lost[k] or k % ACTS == 0)
    known = first_acts(40, HOVER)
    for _, k in [*arriving, (99, 32)]:
        known = with_report(known, report(k * H, [act for act in acts if act[0] < k * H]))
    np.testing.assert_allclose(known[-30:, :2], acts)
    np.testing.assert_array_equal(known[-30:, 2:], [u(k) for k in range(30)])


def test_what_a_report_says_of_later_than_itself_is_not_believed() -> None:
    known = with_report(first_acts(4, HOVER), report(1.0, [(0.5, 0.3), (1.5, 0.4)]))
    assert known[-1, 0] == 0.5
    known = with_report(first_acts(4, HOVER), report(1.0, [(0.5, 0.6)]))  # acted before it was sent
    np.testing.assert_array_equal(known, first_acts(4, HOVER))
    np.testing.assert_array_equal(with_report(known, np.zeros(ACTED_SIZE)), known)


@pytest.mark.long
def test_commands_on_the_way_follow_what_acted() -> None:
    known = with_report(first_acts(6, HOVER), report(1.0, [(0.62, 0.4), (0.70, 0.5)]))
    tau = expected_delay(known, NONE)
    assert tau == pytest.approx(0.21)
    rows = timeline_of(known, 1.0, sent(range(4, 10)), tau, 0.025)
    # 0.5 acted; 0.6 and 0.7 should have by 0.81 and 0.91, and none was later than 0.22: lost. 0.8 and 0.9 will.
    np.testing.assert_allclose(rows[-4:, 0], [0.62, 0.70, 1.01, 1.11])
    np.testing.assert_allclose(rows[-4:, 1:], [u(4), u(5), u(8), u(9)])
    rows = timeline_of(known, 1.0, sent(range(4, 10)), 0.15, 0.1)  # 0.7 is late, and may come at any time
    np.testing.assert_allclose(rows[-3:, 0], [1.0, 1.0, 1.05])
    assert expected_delay(known, 0.15) == 0.15
    assert expected_delay(first_acts(3, HOVER), NONE) == 0.0


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=8), st.floats(0.0, 0.9), st.floats(0.01, 1.0))
@settings(max_examples=50, deadline=None)
def test_the_mean_is_that_of_a_fine_sampling(times: list[float], begin: float, span: float) -> None:
    rows = np.array([[-1.0, *u(0)], *([t, *u(k + 1)] for k, t in enumerate(sorted(times)))])
    moments = begin + span * (np.arange(20_000) + 0.5) / 20_000
    acting = rows[np.searchsorted(rows[:, 0], moments, side="right") - 1, 1:]
    np.testing.assert_allclose(mean_control(rows, begin, begin + span), acting.mean(axis=0), atol=2e-2)


def test_a_further_command_acts_after_the_last() -> None:
    rows = np.array([[0.0, *u(1)], [0.5, *u(2)]])
    assert with_command(rows, 0.3, np.array(u(3)))[-1, 0] == 0.5
    assert with_command(rows, 0.7, np.array(u(3)))[-1, 0] == 0.7


@pytest.mark.long
def test_the_log_of_an_onboard_half_without_reports_goes_by_the_delay_that_it_is_told() -> None:
    scenario = load_scenario("imu_uwb", ("commands={servo: predicted, delay: 0.25}",))
    h, kept = scenario.h, log_ticks(scenario)
    log = PlayedBox(command_log_box(scenario), h)
    for k in range(kept + 4):
        log.step(k, control=np.array(u(k)))
    vector = log.say(kept + 4, control=np.zeros(4))
    assert vector.size == timeline_size(kept)
    assert vector[0] == 0.25
    rows = unpacked(vector)
    np.testing.assert_allclose(rows[-kept:], [[k * h + 0.25, *u(k)] for k in range(4, kept + 4)])
