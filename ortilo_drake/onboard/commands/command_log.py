"""The onboard half's own record of its commands: which it sent, and which of them acted."""

from typing import Any

import numpy as np
from numba.extending import register_jitable
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from ortilo_drake.loop.element import Array, Box, Element, Given, Number
from ortilo_drake.model.clock import history_ticks
from ortilo_drake.model.placing import fill, put
from ortilo_drake.model.signals import ACT_SIZE, ACTED_SIZE, ARRIVED, N_U, STAMP
from ortilo_drake.onboard.commands.timeline import (
    NONE,
    ROW,
    SENT_SIZE,
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
    """Return how many ticks to keep: what the filter may go back, what may be on its way, and some more."""
    longest = max(getattr(scenario.estimator, "horizon", 0.0), scenario.commands.delay or 0.0)
    return history_ticks(longest + MARGIN, scenario.h)


def make_command_log(scenario: Belief) -> "CommandLog":
    """Return the record of commands that a scenario wants."""
    commands = scenario.commands
    thrust = scenario.vehicle.hover_thrust
    return CommandLog(log_ticks(scenario), thrust, commands.delay, scenario.h, commands.are_reported)


@register_jitable
def say_timeline(n: Any, acts: np.ndarray, heard: float, sent: np.ndarray, out: np.ndarray) -> None:
    """Say the timeline of what acted, is known until `heard` [s] and was sent."""
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
    """Say the timeline of a log that hears no report."""
    say_timeline(n, acts, NONE, sent, out)


def deaf_step(n: Any, k: int, control: np.ndarray, sent: np.ndarray) -> None:
    """Keep the command of tick k."""
    keep_command(control, k * n.h, sent)


def log_out(n: Any, acted: np.ndarray, sent: np.ndarray, acts: np.ndarray, heard: np.ndarray, out: np.ndarray) -> None:
    """Say the timeline, by the report that landed in this tick and those before."""
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
        given = Given(numbers, start={"sent": sent, "acts": acts, "heard": np.array([NONE])})
        return Box("command_log", LOG, timeline_size(ticks), given)
    given = Given(numbers, start={"sent": sent}, tables={"acts": acts})
    return Box("command_log", DEAF_LOG, timeline_size(ticks), given)


class CommandLog(LeafSystem):
    """Keeps the commands of the last ticks, and what of them is known to have acted.

    Ports:
        control (4): the command u_k of this tick, f_T absolute.
        acted (50): the world's report; only where it is heard.
        timeline (n, output): [tau, number of rows, rows (since, u)], see timeline.py, by all that was heard in this
            tick and all commands before this one. It does not depend on control.

    State (discrete, updated each tick), in this order: the commands sent (N, 5), rows (time of the tick, u), ascending;
    what acted (N, 6), rows as the report's but ascending; until when that is known [s] (1).

    Args:
        ticks: N.
        hover_thrust: what acts before anything is known [N].
        delay: tau [s]; None takes it from what acted.
        h: tick [s].
        hears: whether there is a report.
    """

    def __init__(self, ticks: int, hover_thrust: float, delay: float | None, h: float, hears: bool):
        super().__init__()
        self.set_name("command_log")
        self._given, self._slack, self._size = NONE if delay is None else delay, SLACK * h, timeline_size(ticks)
        self._control = self.DeclareVectorInputPort("control", N_U)
        self._acted = self.DeclareVectorInputPort("acted", ACTED_SIZE) if hears else None
        self._sent = self.DeclareDiscreteState(none_sent(ticks).ravel())
        self._acts = self.DeclareDiscreteState(first_acts(ticks, hover_thrust).ravel())
        self._heard = self.DeclareDiscreteState([NONE])
        self.DeclarePeriodicDiscreteUpdateEvent(h, 0.0, self._update)
        needs = {self.xd_ticket()} | ({self._acted.ticket()} if self._acted is not None else set())
        self.DeclareVectorOutputPort("timeline", self._size, self._calc_timeline, prerequisites_of_calc=needs)

    def _known(self, context: Context) -> tuple[np.ndarray, float]:
        """Return what acted, and until when that is known, with this tick's report."""
        acts = context.get_discrete_state(self._acts).value().reshape(-1, ACT_SIZE)
        heard = float(context.get_discrete_state(self._heard)[0])
        if self._acted is None:
            return acts, heard
        message = self._acted.Eval(context)
        return with_report(acts, message), max(heard, message[STAMP] if message[ARRIVED] else NONE)

    def _calc_timeline(self, context: Context, output: BasicVector) -> None:
        acts, heard = self._known(context)
        sent = context.get_discrete_state(self._sent).value().reshape(-1, SENT_SIZE)
        tau = expected_delay(acts, self._given)
        output.set_value(packed(tau, timeline_of(acts, heard, sent, tau, self._slack), self._size))

    def _update(self, context: Context, values: DiscreteValues) -> None:
        sent = context.get_discrete_state(self._sent).value().reshape(-1, SENT_SIZE)
        newest = np.concatenate(([context.get_time()], self._control.Eval(context)))
        acts, heard = self._known(context)
        values.set_value(self._sent, np.concatenate((sent[1:].ravel(), newest)))
        values.set_value(self._acts, acts.ravel())
        values.set_value(self._heard, [heard])
