"""The world's report of the commands that acted, and from when.

A message holds the newest ACTS commands, so that the content of a lost message is in the next.
"""

from typing import Any

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.loop.element import Box, Element, Values
from ortilo_drake.model.placing import put
from ortilo_drake.model.signals import ACT_SIZE, ACTED_SIZE, ACTS, ARRIVED, N_U, PAYLOAD, STAMP
from ortilo_drake.model.vehicle import Vehicle

NO_COMMAND = -1.0  # the stamp of what acts without a command
_SINCE, _STAMP, _U = 0, 1, 2


@cached_njit
def acts_after(acts: np.ndarray, t: float, stamp: float, u: np.ndarray, h: float) -> np.ndarray:
    """Return the newest commands that acted (ACTS, 6), newest first, once u (4) acts at time t [s].

    acts holds the previous rows (since, stamp, u). The stamp is the time of the tick that sent the command u [s],
    NO_COMMAND if no command gave u. A held command adds no row. A control without a command, such as the failsafe's,
    adds at most one row per tick of h [s].
    """
    newest = acts[0]
    if stamp >= 0.0:
        is_new = stamp != newest[_STAMP]
    else:
        is_new = np.any(u != newest[_U:]) and (newest[_STAMP] >= 0.0 or t - newest[_SINCE] >= h * (1.0 - 1e-6))
    if not is_new:
        return acts.copy()
    after = np.empty_like(acts)
    after[1:] = acts[:-1]
    after[0, _SINCE], after[0, _STAMP] = t, stamp
    after[0, _U:] = u
    return after


def first_acts(hover_thrust: float) -> np.ndarray:
    """Return the commands that acted before the first one (ACTS, 6): hover."""
    return np.tile([-1.0, NO_COMMAND, hover_thrust, 0.0, 0.0, 0.0], (ACTS, 1))


def report_out(n: Any, k: int, acts: np.ndarray, out: np.ndarray) -> None:
    """Output the commands that acted before tick k, a message (50)."""
    out[ARRIVED], out[STAMP] = 1.0, k * n.h
    for i in range(ACTS):
        put(acts[i], out, PAYLOAD + i * ACT_SIZE)


def report_step(n: Any, k: int, control: np.ndarray, stamp: np.ndarray, acts: np.ndarray) -> None:
    """Record the command that begins to act in tick k, see acts_after."""
    after = acts_after(acts, k * n.h, stamp[0], control, n.h)
    for i in range(ACTS):
        put(after[i], acts[i])


def now_out(n: Any, k: int, out: np.ndarray) -> None:
    """Output the time of the tick [s] (1)."""
    out[0] = k * n.h


REPORT = Element("acted_report", out=report_out, step=report_step, allocates=True)
NOW = Element("now", out=now_out)


def report_box(hover_thrust: float, h: float) -> Box:
    """Return the box that reports which commands acted; it reads the acting control (4) and its `stamp` (1)."""
    return Box("acted", REPORT, ACTED_SIZE, Values({"h": h}, start={"acts": first_acts(hover_thrust)}))


def now_box(h: float) -> Box:
    """Return the box of the tick's time, the stamp of a command that acts at once."""
    return Box("now", NOW, 1, Values({"h": h}))


class ActedReport(LeafSystem):
    """Outputs the commands that acted, and from when.

    Ports:
        control (4): the control that acts from now on.
        stamp (1): time when the command that begins to act now was sent [s], NO_COMMAND if none does; only if is_late.
        mode (1): index in failsafe.MODES; only if has_failsafe. A control of the failsafe is no command.
        acted (50, output): [arrived, stamp, ACTS rows of (since, stamp, u)], the commands that acted before now.

    State (discrete, updated every period): those rows.

    Args:
        vehicle: its hover thrust acts before the first command.
        h: tick [s].
        period: how often a command may begin to act [s].
        is_late: whether the stamp comes by a port, else a command acts in the tick that sent it.
        has_failsafe: whether there is a failsafe, whose mode comes by a port.
    """

    def __init__(self, vehicle: Vehicle, h: float, period: float, is_late: bool, has_failsafe: bool):
        super().__init__()
        self.set_name("acted_report")
        self._h = h
        self._control = self.DeclareVectorInputPort("control", N_U)
        self._stamp = self.DeclareVectorInputPort("stamp", 1) if is_late else None
        self._mode = self.DeclareVectorInputPort("mode", 1) if has_failsafe else None
        self._rows = self.DeclareDiscreteState(first_acts(vehicle.hover_thrust).ravel())
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)
        needs = {self.time_ticket(), self.xd_ticket()}
        self.DeclareVectorOutputPort("acted", ACTED_SIZE, self._calc_acted, prerequisites_of_calc=needs)

    def _stamp_in(self, context: Context) -> float:
        if self._mode is not None and self._mode.Eval(context)[0] != 0.0:
            return NO_COMMAND
        return float(context.get_time() if self._stamp is None else self._stamp.Eval(context)[0])

    def _update(self, context: Context, values: DiscreteValues) -> None:
        acts = context.get_discrete_state(self._rows).value().reshape(ACTS, ACT_SIZE)
        after = acts_after(acts, context.get_time(), self._stamp_in(context), self._control.Eval(context), self._h)
        values.set_value(self._rows, after.ravel())

    def _calc_acted(self, context: Context, output: BasicVector) -> None:
        message = np.empty(ACTED_SIZE)
        message[ARRIVED], message[STAMP] = 1.0, context.get_time()
        message[PAYLOAD:] = context.get_discrete_state(self._rows).value()
        output.set_value(message)
