"""A solver of fixes: a function of a message and the estimate that returns a value and its covariance."""

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from ortilo_drake.loop.element import Box, Element, Values
from ortilo_drake.model.parts import Compiled
from ortilo_drake.model.placing import fill, put
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import ARRIVED, N_XBAR, PAYLOAD, STAMP
from ortilo_drake.scenario import Belief

Solve = Callable[[np.ndarray, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray] | None]


class FixSolver(LeafSystem):
    """A system that solves each message for a fix, without memory.

    Ports:
        <name> (2 + n): a message [arrived, stamp, payload].
        estimate (15), covariance (225): of the filter, where the solver starts; at the tick of the message's stamp if
            the filter replays late messages.
        fix (2 + m + m^2, output): [arrived, stamp, value, covariance row by row]; zeros if nothing arrived or there is
            no solution.

    Args:
        name: name of the message.
        payload: n, size of the payload.
        rows: m, number of rows of the value.
        solve: (payload (n), xhat (15), P (15, 15)) -> value (m) and covariance (m, m), or None.
    """

    def __init__(self, name: str, payload: int, rows: int, solve: Solve):
        super().__init__()
        self.set_name(f"{name}_fix")
        self._solve = solve
        self._message = self.DeclareVectorInputPort(name, PAYLOAD + payload)
        self._estimate = self.DeclareVectorInputPort("estimate", N_XBAR)
        self._covariance = self.DeclareVectorInputPort("covariance", N_XBAR * N_XBAR)
        needs = {self._message.ticket(), self._estimate.ticket(), self._covariance.ticket()}
        size = PAYLOAD + rows + rows * rows
        self.DeclareVectorOutputPort("fix", size, self._calc_fix, prerequisites_of_calc=needs)

    def _calc_fix(self, context: Context, output: BasicVector) -> None:
        message, found = self._message.Eval(context), None
        if message[ARRIVED]:
            P = self._covariance.Eval(context).reshape(N_XBAR, N_XBAR)
            found = self._solve(message[PAYLOAD:], self._estimate.Eval(context), P)
        fix = np.zeros(output.size())
        if found is not None:
            value, covariance = found
            fix[ARRIVED], fix[STAMP] = 1.0, message[STAMP]
            fix[PAYLOAD:] = np.concatenate((np.ravel(value), np.ravel(covariance)))
        output.set_value(fix)


@lru_cache(maxsize=64)
def compiled_fix_out(solve: Callable[..., np.ndarray]) -> Callable[..., None]:
    """Return the output function of an element that computes the fix of an arrived message with `solve`."""

    def say(numbers: Any, message: np.ndarray, belief: np.ndarray, out: np.ndarray) -> None:
        """Output [1, stamp, value, covariance row by row]; zeros if nothing arrived or there is no solution."""
        fill(out, 0.0)
        if message[ARRIVED] != 0.0:
            P = (
                belief[N_XBAR:].copy().reshape((N_XBAR, N_XBAR))
            )  # copies, because a user's function may change its arguments
            fix = solve(numbers, message[PAYLOAD:].copy(), belief[:N_XBAR].copy(), P)
            if fix.size > 0:
                if fix.size != out.size - PAYLOAD:
                    raise ValueError("returns another number of values than its rows have, with their covariance")
                out[ARRIVED], out[STAMP] = 1.0, message[STAMP]
                put(fix, out, PAYLOAD)

    return say


def own_fix_box(name: str, share: Compiled, rows: int, scenario: Belief, room: Room) -> Box | None:
    """Return the solver's box of an own sensor; it reads the arrived message and the belief of [x; i] (240).

    The result is None if the share has no solver, that is, if the message itself begins with the value; rows is m.
    """
    if share.solve is None:
        return None
    element = Element("own_fix", out=compiled_fix_out(share.solve), allocates=True, checked=True)
    box = Box(f"{name}_fix", element, PAYLOAD + rows + rows * rows)
    return box.with_groups(numbers=share.numbers(scenario, room))


def read_out(message: np.ndarray, V: np.ndarray, out: np.ndarray) -> None:
    """Output [1, stamp, value, covariance row by row] of a message that begins with the value; zeros if none came."""
    fill(out, 0.0)
    if message[ARRIVED] != 0.0:
        put(message[: out.size - V.size], out)  # includes the covariance if the message holds it
        put(V, out, out.size - V.size)


def fix_reader_box(name: str, rows: int, V: np.ndarray | None) -> Box:
    """Return the box that reads the fix from a message that begins with the value (m numbers, `rows`).

    V is the covariance of the value (m, m); None if the message holds it.
    """
    table = np.zeros(0) if V is None else np.ravel(V)
    return Box(name, Element("fix_reader", out=read_out), PAYLOAD + rows + rows * rows, Values(tables={"V": table}))
