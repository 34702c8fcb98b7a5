"""The timing of ticks, against hand-made times."""

import json
import math
from dataclasses import asdict

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ortilo_drake.hil.real_time.tick_timing import Quantiles, TickTiming, quantiles

H = 0.01  # [s]
START = 1000.0  # the clock's zero is nowhere in particular [s]


def timing_of(latencies: list[float | None], late: list[float] | None = None) -> TickTiming:
    """Return the timing of ticks H apart, sent late by so much and answered after so much [s]; None for never."""
    timing = TickTiming(H)
    for k, latency in enumerate(latencies):
        due = START + k * H
        sent = due + (late[k] if late else 0.0)
        timing.sent(due, sent)
        if latency is not None:
            timing.answered(k, sent + latency)
    return timing


def test_quantiles_are_those_of_a_hand_made_list() -> None:
    # Of 1 to 101 the 99th percentile is the 99 % of the way from the first to the last: 1 + 0.99 * 100.
    found = quantiles(np.random.default_rng(1).permutation(np.arange(1.0, 102.0)))
    assert vars(found) == pytest.approx({"median": 51.0, "p99": 100.0, "max": 101.0})
    assert quantiles(np.array([])) == Quantiles(None, None, None)


def test_latency_is_from_sent_to_received() -> None:
    summary = timing_of([0.001, 0.005, 0.002], late=[0.0, 0.003, 0.001]).summary()
    assert summary.latency_ms.median == pytest.approx(2.0)
    assert summary.latency_ms.max == pytest.approx(5.0)
    assert summary.missed_deadlines == summary.unanswered == 0
    assert summary.lateness_ms == 0.0


def test_late_and_unanswered_ticks_miss_their_deadline() -> None:
    summary = timing_of([0.002, 0.013, None, 0.011, 0.004, None]).summary()
    assert summary.ticks == 6
    assert summary.unanswered == 2
    assert summary.missed_deadlines == 4
    assert summary.lateness_ms == pytest.approx(3.0)
    assert summary.latency_ms.median == pytest.approx(7.5)  # of those that were answered: 2, 4, 11, 13


def test_a_deadline_counts_from_when_a_tick_was_due() -> None:
    summary = timing_of([0.006, 0.006], late=[0.001, 0.005]).summary()  # 7 and 11 ms after they were due
    assert summary.latency_ms.max == pytest.approx(6.0)
    assert summary.missed_deadlines == 1
    assert summary.lateness_ms == pytest.approx(1.0)


def test_jitter_is_how_late_the_world_was() -> None:
    summary = timing_of([0.001] * 5, late=[0.0, 0.001, 0.004, 0.002, 0.003]).summary()
    assert vars(summary.jitter_ms) == pytest.approx({"median": 2.0, "p99": 3.96, "max": 4.0})


@pytest.mark.parametrize("factor", [0.5, 1.0, 2.0])
def test_the_real_time_factor_is_simulated_by_wall_time(factor: float) -> None:
    timing = TickTiming(H)
    for k in range(11):
        timing.sent(START + k * H, START + k * H / factor)
    assert timing.summary().real_time_factor == pytest.approx(factor)


def test_the_first_of_several_answers_counts_and_none_to_a_tick_not_sent() -> None:
    timing = timing_of([0.002, None])
    timing.answered(0, START + 0.009)
    timing.answered(2, START)
    np.testing.assert_allclose(timing.latencies_ms(), [2.0])
    timing.sent(START + 2 * H, START + 2 * H)
    assert timing.summary().unanswered == 2


def test_no_ticks_and_one_give_no_figures_but_json() -> None:
    for ticks in (0, 1):
        summary = timing_of([None] * ticks).summary()
        assert json.loads(json.dumps(asdict(summary))) == asdict(summary)
        assert summary.real_time_factor is None
        assert summary.latency_ms.median is None
        assert summary.missed_deadlines == summary.unanswered == ticks


# Whole microseconds, and never the deadline itself: which side of it rounding falls on means nothing.
MICROSECONDS = st.none() | st.integers(0, 50_000).filter(lambda us: us != round(1e6 * H))


@given(st.lists(MICROSECONDS, min_size=1, max_size=60), st.randoms(use_true_random=False))
def test_counts_are_those_of_the_list_in_whatever_order_answers_come(us: list[int | None], random: object) -> None:
    timing = TickTiming(H)
    for k in range(len(us)):
        timing.sent(START + k * H, START + k * H)
    order = list(enumerate(us))
    random.shuffle(order)  # type: ignore[attr-defined]  # random.Random, which Hypothesis does not say
    for k, latency in order:
        if latency is not None:
            timing.answered(k, START + k * H + 1e-6 * latency)
    summary, answered = timing.summary(), [latency for latency in us if latency is not None]
    assert summary.unanswered == us.count(None)
    assert summary.missed_deadlines == sum(latency is None or latency > 1e6 * H for latency in us)
    np.testing.assert_allclose(timing.latencies_ms(), np.array(answered) / 1e3, atol=1e-6)
    worst = max(answered, default=0) / 1e3 - 1e3 * H
    assert math.isclose(summary.lateness_ms, max(0.0, worst), abs_tol=1e-6)
