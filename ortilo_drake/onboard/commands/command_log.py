"""The onboard half's own record of its commands: which it sent, and which of them acted."""

from typing import Any

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.loop.element import Array, Box, Element, Number, Values
from ortilo_drake.model.clock import history_ticks
from ortilo_drake.model.placing import fill, put
from ortilo_drake.model.signals import ARRIVED, STAMP
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
def say_timeline(n: Any, acts: np.ndarray, heard: float, sent: np.ndarray, out: np.ndarray) -> None:
    """Output the timeline of what acted, is known until `heard` [s] and was sent."""
    tau = expected_delay(acts, n.delay)
    put(packed(tau, timeline_of(acts, heard, sent, tau, n.slack), out.size), out)


@register_jitable
def keep_command(control: np.ndarray, t: float, sent: np.ndarray) -> None:
    """Keep the command of time t [s] among those sent, the oldest goes."""
    last = sent.shape[0] - 1
    for i in range(last):
        put(sent[i + 1], sent[i])
    sent[last, 0] = t
    put(control, sent[last], 1)


@register_jitable
def heard_until(heard: float, message: np.ndarray) -> float:
    """Return until when it is known what acted [s], with a report."""
    return max(heard, message[STAMP] if message[ARRIVED] != 0.0 else NONE)


def deaf_out(n: Any, sent: np.ndarray, acts: np.ndarray, out: np.ndarray) -> None:
    """Output the timeline of a log that hears no report."""
    say_timeline(n, acts, NONE, sent, out)


def deaf_step(n: Any, k: int, control: np.ndarray, sent: np.ndarray) -> None:
    """Keep the command of tick k."""
    keep_command(control, k * n.h, sent)


def log_out(n: Any, acted: np.ndarray, sent: np.ndarray, acts: np.ndarray, heard: np.ndarray, out: np.ndarray) -> None:
    """Output the timeline, by the report that landed in this tick and those before."""
    say_timeline(n, with_report(acts, acted), heard_until(heard[0], acted), sent, out)


def log_step(
    n: Any, k: int, control: np.ndarray, acted: np.ndarray, sent: np.ndarray, acts: np.ndarray, heard: np.ndarray
) -> None:
    """Keep the command of tick k and what is known to have acted."""
    keep_command(control, k * n.h, sent)
    after = with_report(acts, acted)
    for i in range(acts.shape[0]):
        put(after[i], acts[i])
    fill(heard, heard_until(heard[0], acted))


_NUMBERS = (Number("delay"), Number("slack"), Number("h"))
DEAF_LOG = Element(
    "deaf_command_log",
    out=deaf_out,
    step=deaf_step,
    numbers=_NUMBERS,
    tables=(Array("acts", 2),),
    state=(Array("sent", 2),),
    allocates=True,
)
LOG = Element(
    "command_log",
    out=log_out,
    step=log_step,
    numbers=_NUMBERS,
    state=(Array("sent", 2), Array("acts", 2), Array("heard")),
    allocates=True,
)


def command_log_box(scenario: Belief) -> Box:
    """Return the record of commands: it reads the control (4) and, where it is heard, the report `acted` (50)."""
    commands, h, ticks = scenario.commands, scenario.h, log_ticks(scenario)
    numbers = {"delay": NONE if commands.delay is None else commands.delay, "slack": SLACK * h, "h": h}
    sent, acts = none_sent(ticks), first_acts(ticks, scenario.vehicle.hover_thrust)
    if commands.are_reported:
        given = Values(numbers, start={"sent": sent, "acts": acts, "heard": np.array([NONE])})
        return Box("command_log", LOG, timeline_size(ticks), given)
    given = Values(numbers, start={"sent": sent}, tables={"acts": acts})
    return Box("command_log", DEAF_LOG, timeline_size(ticks), given)
