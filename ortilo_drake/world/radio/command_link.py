"""The radio link that carries the control packets to the rotors: loss and delay.

One packet a tick. It is lost as a sensor's message is (world/radio/link.py): at the rate of the state of a two-state
Markov chain, at sending. A packet sent at tick k with a delay of d ticks acts at tick k + d; what is in flight arrives.
In a tick in which nothing arrives the rotors either hold the last command that did or fall back to hover.

The sender hears nothing back, as over UDP: filter and servo take every command for applied at once, unless what
acted is reported (world/vehicle/acted_report.py). L. Schenato,
"To zero or to hold control inputs with lossy links?", IEEE Trans. Automatic Control 54 (2009), compares the two
strategies.
"""

import sys
from typing import Any

import numpy as np
from numba import njit
from pydrake.autodiffutils import AutoDiffXd
from pydrake.systems.framework import BasicVector_, LeafSystem_
from pydrake.systems.scalar_conversion import TemplateSystem

from ortilo_drake.loop.element import Array, Box, Element, Given, Number
from ortilo_drake.model.clock import tick_of
from ortilo_drake.model.placing import put
from ortilo_drake.model.scalars import time_in, values_of
from ortilo_drake.model.signals import N_U
from ortilo_drake.model.vehicle import Vehicle
from ortilo_drake.scenario import CommandLink as CommandLinkSettings
from ortilo_drake.scenario.loss_chain import loss_parameters
from ortilo_drake.world.noise import stream_id, uniforms
from ortilo_drake.world.radio.link import chain_after
from ortilo_drake.world.seeded_system import Seeded

_BAD = 0  # the state: whether the chain is bad, the command held, then the ring of packets in flight
_HELD = slice(1, 1 + N_U)
_FLYING = 1 + N_U
_PACKET = 1 + N_U  # a packet in flight: 1 if it was sent, and the command


@njit(cache=True)
def is_lost(k: int, bad: bool, loss: np.ndarray, seed: int, stream: np.uint64) -> bool:
    """Return whether the packet sent at tick k is lost; loss as loss_parameters returns it."""
    return uniforms(seed, stream, k, 1)[0] < loss[3 if bad else 2]


@njit(cache=True)
def applied_command(
    k: int,
    state: np.ndarray,
    u: np.ndarray,
    loss: np.ndarray,
    fallback: np.ndarray,
    holds: bool,
    seed: int,
    stream: np.uint64,
) -> np.ndarray:
    """Return the control that acts over tick k (4).

    Args:
        k: tick.
        state: the link's state, see CommandLink.
        u: the command sent at tick k (4); not read where the link delays.
        loss: see world/radio/link.py, loss_parameters (4).
        fallback: the command at hover (4).
        holds: whether a lost packet leaves the last command in force, or hover.
        seed: seed of all noise.
        stream: number of this noise stream.
    """
    d = (state.shape[0] - _FLYING) // _PACKET
    if d == 0:
        if not is_lost(k, state[_BAD] == 1.0, loss, seed, stream):
            return u.copy()
    else:
        row = _FLYING + (k % d) * _PACKET
        if state[row] == 1.0:
            return state[row + 1 : row + _PACKET].copy()
    return state[_HELD].copy() if holds else fallback.copy()


@njit(cache=True)
def arriving(k: int, state: np.ndarray, loss: np.ndarray, seed: int, stream: np.uint64) -> int:
    """Return the tick of the command that begins to act in tick k, -1 if none arrives; arguments as applied_command."""
    d = (state.shape[0] - _FLYING) // _PACKET
    if d == 0:
        return -1 if is_lost(k, state[_BAD] == 1.0, loss, seed, stream) else k
    return k - d if state[_FLYING + (k % d) * _PACKET] == 1.0 else -1


@njit(cache=True)
def link_after(
    k: int,
    state: np.ndarray,
    u: np.ndarray,
    applied: np.ndarray,
    loss: np.ndarray,
    seed: int,
    stream: np.uint64,
) -> np.ndarray:
    """Return the link's state at tick k + 1. Arguments as applied_command; applied is what that returned."""
    after = state.copy()
    bad = state[_BAD] == 1.0
    after[_BAD] = 1.0 if chain_after(k, bad, loss, seed, stream) else 0.0
    after[_HELD] = applied
    d = (state.shape[0] - _FLYING) // _PACKET
    if d:
        row = _FLYING + (k % d) * _PACKET  # read in this tick, so free
        after[row] = 0.0 if is_lost(k, bad, loss, seed, stream) else 1.0
        after[row + 1 : row + _PACKET] = u
    return after


def link_out(
    n: Any, k: int, seed: int, control: np.ndarray, link: np.ndarray, hover: np.ndarray, out: np.ndarray
) -> None:
    """Say the control that acts over tick k (4), and when the command that arrives in it was sent [s], -1 for none."""
    put(applied_command(k, link, control, n.loss, hover, n.holds != 0, seed, n.stream), out)
    sent = arriving(k, link, n.loss, seed, n.stream)
    out[N_U] = sent * n.h if sent >= 0 else -1.0


def link_step(n: Any, k: int, seed: int, control: np.ndarray, applied: np.ndarray, link: np.ndarray) -> None:
    """Go on to tick k + 1, see link_after."""
    put(link_after(k, link, control, applied, n.loss, seed, n.stream), link)


LINK = Element(
    "command_link",
    out=link_out,
    step=link_step,
    numbers=(Number("loss", (4,)), Number("holds", kind="i8"), Number("stream", kind="u8"), Number("h")),
    tables=(Array("hover"),),
    state=(Array("link"),),
    allocates=True,
)


def first_state(settings: CommandLinkSettings, hover_thrust: float) -> np.ndarray:
    """Return the link's state at first: the chain is good, hover acts, nothing is in flight."""
    start = np.zeros(_FLYING + settings.delay * _PACKET)
    start[_HELD] = [hover_thrust, 0.0, 0.0, 0.0]
    return start


def command_link_box(settings: CommandLinkSettings, hover_thrust: float, h: float) -> Box:
    """Return what carries the commands to the rotors: it reads them as they are sent, `control` (4).

    It says which control acts, `applied` (4), and when the command was sent that arrives now, `stamp` (1).
    """
    numbers = {"loss": loss_parameters(settings.loss, h), "holds": settings.when_lost == "hold", "h": h}
    numbers |= {"stream": stream_id("link/command")}
    tables = {"hover": np.array([hover_thrust, 0.0, 0.0, 0.0])}
    given = Given(numbers, start={"link": first_state(settings, hover_thrust)}, tables=tables)
    parts = {"applied": (0, N_U), "stamp": (N_U, 1)}
    return Box("command_link", LINK, N_U + 1, given, reads={"applied": "command_link.applied"}, parts=parts)


# Without a scope Drake reads the sources of all frames to find it.
@TemplateSystem.define("CommandLink_", T_list=[float, AutoDiffXd], scope=sys.modules[__name__])
def CommandLink_(T: type) -> type:
    """Return the link for a scalar type: float or AutoDiffXd, for which what is lost is a constant."""

    class Impl(LeafSystem_[T], Seeded):
        """Carries the control packets to the rotors, late, and some never.

        Ports:
            control (4): the command u of this tick, f_T absolute.
            applied (4, output): the control that acts over this tick; without a delay it depends on control.
            stamp (1, output): time of the tick whose command arrives now [s], -1 if none does; only if it tells.

        State (discrete, updated each tick): whether the loss chain is bad, which it is not at the start; the control
        that acted over the last tick, hover at the start; and d rows (sent, command) of packets in flight, none at the
        start.

        Args:
            settings: loss, strategy and delay.
            vehicle: whose hover thrust the link falls back to.
            seed: seed of all noise; the stream is 'link/command'.
            h: tick [s].
            tells: whether it tells which command arrives.
        """

        def _construct(
            self,
            settings: CommandLinkSettings,
            vehicle: Vehicle,
            seed: int,
            h: float,
            tells: bool = False,
            converter: Any = None,
        ) -> None:
            LeafSystem_[T].__init__(self, converter=converter)
            self.set_name("command_link")
            self.declare_seed(seed)
            self._arguments = {"settings": settings, "vehicle": vehicle, "seed": seed, "h": h, "tells": tells}
            functions = applied_command, link_after
            self._applied_command, self._link_after = (f if T is float else f.py_func for f in functions)
            self._loss, self._holds = loss_parameters(settings.loss, h), settings.when_lost == "hold"
            self._hover = np.array([vehicle.hover_thrust, 0.0, 0.0, 0.0])
            self._stream, self._h = stream_id("link/command"), h
            self._control = self.DeclareVectorInputPort("control", N_U)
            self._unread = np.zeros(N_U)
            self._is_late = settings.delay > 0
            self.DeclareDiscreteState(BasicVector_[T](first_state(settings, vehicle.hover_thrust)))
            self.DeclarePeriodicDiscreteUpdateEvent(h, 0.0, self._update)
            needs = {self.time_ticket(), self.xd_ticket(), self.all_parameters_ticket()}
            if tells:
                self.DeclareVectorOutputPort("stamp", 1, self._calc_stamp, prerequisites_of_calc=set(needs))
            if not self._is_late:
                needs.add(self._control.ticket())
            self._applied = self.DeclareVectorOutputPort(
                "applied", N_U, self._calc_applied, prerequisites_of_calc=needs
            )

        def _construct_copy(self, other: Any, converter: Any = None) -> None:
            Impl._construct(self, **other._arguments, converter=converter)

        def _calc_applied(self, context: Any, output: Any) -> None:
            k = tick_of(time_in(context), self._h)
            u = self._unread if self._is_late else self._control.Eval(context)
            state, seed = context.get_discrete_state_vector().CopyToVector(), self.seed_in(context)
            output.set_value(
                self._applied_command(k, state, u, self._loss, self._hover, self._holds, seed, self._stream)
            )

        def _calc_stamp(self, context: Any, output: Any) -> None:
            k = tick_of(time_in(context), self._h)
            state = values_of(context.get_discrete_state_vector().CopyToVector())
            sent = arriving(k, state, self._loss, self.seed_in(context), self._stream)
            output.SetAtIndex(0, sent * self._h if sent >= 0 else -1.0)

        def _update(self, context: Any, values: Any) -> None:
            k = tick_of(time_in(context), self._h)
            state, u, applied = (
                context.get_discrete_state_vector().CopyToVector(),
                self._control.Eval(context),
                self._applied.Eval(context),
            )
            values.set_value(self._link_after(k, state, u, applied, self._loss, self.seed_in(context), self._stream))

    return Impl
