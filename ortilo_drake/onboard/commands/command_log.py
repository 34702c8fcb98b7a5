"""The onboard half's own record of its commands: which it sent, and which of them acted."""

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from ortilo_drake.model.clock import history_ticks
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
