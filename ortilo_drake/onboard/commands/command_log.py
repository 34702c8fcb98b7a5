"""The onboard half's own record of its commands: which it sent, and which of them acted."""

from typing import Any

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.loop.element import Box, Element, Values
from ortilo_drake.model.clock import history_ticks
from ortilo_drake.model.placing import fill, put
from ortilo_drake.model.signals import ACTED_SIZE, ARRIVED, STAMP
from ortilo_drake.onboard.commands.timeline import (
    NONE,
    ROW,
    expected_delay,
    first_acts,
    none_sent,
    packed,
    timeline_of,
    with_report,
)
from ortilo_drake.scenario import Belief

SLACK = 0.25  # ticks
MARGIN = 0.5  # [s]


def timeline_size(ticks: int) -> int:
    """Return the size of the timeline of a log that keeps so many ticks."""
    return 2 + 2 * ticks * ROW


def log_ticks(scenario: Belief) -> int:
    """Return the number of ticks to keep: the filter's horizon, a command's longest way, and some more."""
    longest = max(getattr(scenario.estimator, "horizon", 0.0), scenario.commands.delay or 0.0)
    return history_ticks(longest + MARGIN, scenario.h)


@register_jitable
def heard_until(heard: float, message: np.ndarray) -> float:
    """Return until when it is known what acted [s], with a report."""
    return max(heard, message[STAMP] if message[ARRIVED] != 0.0 else NONE)


def log_out(n: Any, acted: np.ndarray, sent: np.ndarray, acts: np.ndarray, heard: np.ndarray, out: np.ndarray) -> None:
    """Output the timeline, by the report that landed in this tick and those before."""
    known = with_report(acts, acted)
    tau = expected_delay(known, n.delay)
    rows = timeline_of(known, heard_until(heard[0], acted), sent, tau, n.slack)
    put(packed(tau, rows, out.size), out)


def log_step(
    n: Any, k: int, control: np.ndarray, acted: np.ndarray, sent: np.ndarray, acts: np.ndarray, heard: np.ndarray
) -> None:
    """Keep the command of tick k, the oldest goes, and what is known to have acted."""
    last = sent.shape[0] - 1
    for i in range(last):
        put(sent[i + 1], sent[i])
    sent[last, 0] = k * n.h
    put(control, sent[last], 1)
    after = with_report(acts, acted)
    for i in range(acts.shape[0]):
        put(after[i], acts[i])
    fill(heard, heard_until(heard[0], acted))


LOG = Element("command_log", out=log_out, step=log_step, allocates=True)


def command_log_box(scenario: Belief) -> Box:
    """Return the record of commands: it reads the control (4) and, where it is heard, the report `acted` (50)."""
    commands, h, ticks = scenario.commands, scenario.h, log_ticks(scenario)
    numbers = {"delay": NONE if commands.delay is None else commands.delay, "slack": SLACK * h, "h": h}
    start = {"sent": none_sent(ticks), "acts": first_acts(ticks, scenario.vehicle.hover_thrust), "heard": [NONE]}
    tables = {} if commands.are_reported else {"acted": np.zeros(ACTED_SIZE)}  # a report that never comes
    return Box("command_log", LOG, timeline_size(ticks), Values(numbers, start, tables))
