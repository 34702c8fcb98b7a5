"""The radio link that carries the control packets to the rotors: loss and delay.

One packet is sent per tick. As a sensor's message (world/radio/link.py), it is lost at sending, at the rate of the
state of a two-state Markov chain. A packet sent at tick k with a delay of d ticks acts at tick k + d; a packet in
flight arrives. In a tick in which nothing arrives the rotors either hold the last command that arrived or fall back to
hover.

There is no acknowledgement, as over UDP: filter and servo take every command for applied at once, unless the world
reports which commands acted (world/vehicle/acted_report.py). L. Schenato, "To zero or to hold control inputs with lossy
links?", IEEE Trans. Automatic Control 54 (2009), compares the two strategies.
"""

from dataclasses import replace
from typing import Any

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.loop.element import Box, Element, Values
from ortilo_drake.model.placing import put
from ortilo_drake.model.signals import N_U
from ortilo_drake.scenario import CommandLink as CommandLinkSettings
from ortilo_drake.scenario.loss_chain import loss_parameters
from ortilo_drake.world.noise import stream_id, uniforms
from ortilo_drake.world.radio.link import chain_after

_BAD = 0  # the state: whether the chain is bad, the command held, then the ring of packets in flight
_HELD = 1
_FLYING = 1 + N_U
_PACKET = 1 + N_U  # a packet in flight: 1 if it was sent, and the command


@cached_njit
def is_lost(k: int, bad: bool, loss: np.ndarray, seed: int, stream: np.uint64) -> bool:
    """Return whether the packet sent at tick k is lost; loss as loss_parameters returns it."""
    return uniforms(seed, stream, k, 1)[0] < loss[3 if bad else 2]


@cached_njit
def arriving(k: int, state: np.ndarray, loss: np.ndarray, seed: int, stream: np.uint64) -> int:
    """Return the tick of the command that begins to act in tick k, -1 if none arrives.

    The state's layout is above (_BAD). loss (4) is what loss_parameters returns; seed and stream are the noise's.
    """
    d = (state.shape[0] - _FLYING) // _PACKET
    if d == 0:
        return -1 if is_lost(k, state[_BAD] == 1.0, loss, seed, stream) else k
    return k - d if state[_FLYING + (k % d) * _PACKET] == 1.0 else -1


@register_jitable
def put_applied(n: Any, k: int, seed: int, u: np.ndarray, link: np.ndarray, hover: np.ndarray, out: np.ndarray) -> None:
    """Write the control that acts over tick k (4), and the sending time of the command arriving in it [s], else -1.

    The control is the arriving one, else the last one or `hover`. u (4) is the command sent at tick k; it is not read
    if the link delays.
    """
    sent = arriving(k, link, n.loss, seed, n.stream)
    if sent == k:
        put(u, out)
    elif sent >= 0:
        row = _FLYING + (k % (k - sent)) * _PACKET
        put(link[row + 1 : row + _PACKET], out)
    elif n.holds:
        put(link[_HELD : _HELD + N_U], out)
    else:
        put(hover, out)
    out[N_U] = sent * n.h if sent >= 0 else -1.0


def link_out(
    n: Any, k: int, seed: int, control: np.ndarray, link: np.ndarray, hover: np.ndarray, out: np.ndarray
) -> None:
    """Output the control that acts over tick k and the sending time of the arriving command (5), see put_applied."""
    put_applied(n, k, seed, control, link, hover, out)


def delayed_out(n: Any, k: int, seed: int, link: np.ndarray, hover: np.ndarray, out: np.ndarray) -> None:
    """Same as `link_out`, for a link that delays: no command acts in the tick in which it is sent."""
    put_applied(n, k, seed, hover, link, hover, out)


def link_step(n: Any, k: int, seed: int, control: np.ndarray, applied: np.ndarray, link: np.ndarray) -> None:
    """Advance the link's state to tick k + 1; `applied` is the control that acted over tick k."""
    bad = link[_BAD] == 1.0
    link[_BAD] = 1.0 if chain_after(k, bad, n.loss, seed, n.stream) else 0.0
    put(applied, link, _HELD)
    d = (link.shape[0] - _FLYING) // _PACKET
    if d:
        row = _FLYING + (k % d) * _PACKET  # read in this tick, so free
        link[row] = 0.0 if is_lost(k, bad, n.loss, seed, n.stream) else 1.0
        put(control, link, row + 1)


LINK = Element("command_link", out=link_out, step=link_step, allocates=True)
DELAYED = replace(LINK, name="delayed_command_link", out=delayed_out)


def command_link_box(settings: CommandLinkSettings, hover_thrust: float, h: float) -> Box:
    """Return the box that carries the commands to the rotors; it reads the sent command `control` (4).

    It outputs the control that acts, `applied` (4), and the time the command arriving now was sent, `stamp` (1).
    """
    numbers = {"loss": loss_parameters(settings.loss, h), "holds": settings.when_lost == "hold", "h": h}
    numbers |= {"stream": stream_id("link/command")}
    link = np.zeros(_FLYING + settings.delay * _PACKET)  # the chain is good, hover acts, nothing is in flight
    link[_HELD] = hover_thrust
    given = Values(numbers, {"link": link}, {"hover": np.array([hover_thrust, 0.0, 0.0, 0.0])})
    parts = {"applied": (0, N_U), "stamp": (N_U, 1)}
    element = DELAYED if settings.delay else LINK
    return Box("command_link", element, N_U + 1, given, reads={"applied": "command_link.applied"}, parts=parts)
