"""The radio link that carries one sensor's messages to the vehicle: rate, loss, blackouts and delay.

At tick k a message is sent if it is due (k a multiple of the divider), outside every blackout, and not
lost. Loss is the Gilbert-Elliott model: a Markov chain with a good and a bad state steps once a tick, and a
message is lost with the probability of its state (E. N. Gilbert, "Capacity of a burst-noise channel", 1960;
E. O. Elliott, 1963); independent (Bernoulli) loss is the same with one probability in both. A message sent
at tick k with a delay of d ticks arrives at tick k + d; d = 0 is the same tick.
"""

from typing import NamedTuple

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.loop.element import Box, Element, Values
from ortilo_drake.model.placing import fill, put
from ortilo_drake.model.scalars import values_of
from ortilo_drake.model.signals import ARRIVED, STAMP
from ortilo_drake.scenario import Link
from ortilo_drake.scenario.loss_chain import loss_parameters
from ortilo_drake.world.noise import four_uniforms, stream_id

NOT_SENT = -1
_TIME = 3  # a blackout's axis, after x, y, z
_LOST, _DELAY, _CHAIN = 0, 1, 2  # what each uniform number of a tick decides


class Radio(NamedTuple):
    """A link's settings, for compiled functions."""

    every: int
    """ticks from one message to the next."""
    delay: int
    """fixed delay [ticks]."""
    random: int
    """largest additional delay [ticks]."""
    loss: np.ndarray
    """probabilities (4) as loss_parameters returns them."""
    blackouts: np.ndarray
    """rows (axis, start, end) (n, 3): axes 0 to 2 in metres, 3 the time in whole ticks."""
    stream: np.uint64
    """number of the noise stream."""


@cached_njit(_nrt=False)
def delay_of_message(radio: Radio, k: int, p_WB: np.ndarray, bad: bool, seed: int) -> int:
    """Return the delay d [ticks] of the message of tick k; NOT_SENT if none is due, or it does not arrive.

    p_WB holds the vehicle's true position in its first three entries; `bad` is the state of the chain.
    """
    if k % radio.every != 0:
        return NOT_SENT
    for i in range(radio.blackouts.shape[0]):
        axis = int(radio.blackouts[i, 0])
        where = float(k) if axis == _TIME else p_WB[axis]
        if radio.blackouts[i, 1] <= where < radio.blackouts[i, 2]:
            return NOT_SENT
    lost = radio.loss[3 if bad else 2]
    if lost == 0.0 and radio.random == 0:
        return radio.delay
    u = four_uniforms(seed, radio.stream, k)
    if u[_LOST] < lost:
        return NOT_SENT
    return radio.delay + int(u[_DELAY] * (radio.random + 1))


@cached_njit(_nrt=False)
def chain_after(k: int, bad: bool, loss: np.ndarray, seed: int, stream: np.uint64) -> bool:
    """Return whether the chain is bad at tick k + 1, from what it is at tick k."""
    u = four_uniforms(seed, stream, k)[_CHAIN]
    return u >= loss[1] if bad else u < loss[0]


@cached_njit
def put_in_flight(flying: np.ndarray, arrival: int, message: np.ndarray) -> None:
    """Put a message (n) into the ring of messages in flight, rows (tick of arrival, message) (D, 1 + n).

    The ring has a row for each of the next D ticks, D the largest delay. If two messages arrive in one tick, the one
    with the newer stamp stays, because the port carries one.
    """
    row = flying[arrival % flying.shape[0]]
    if row[0] == arrival and row[2] > message[1]:
        return
    row[0] = arrival
    put(message, row, 1)


@register_jitable
def landing_row(flying: np.ndarray, k: int, newest: float) -> int:
    """Return the row of the message that lands at tick k with a stamp newer than `newest` [s]; NOT_SENT for none."""
    if flying.shape[0] > 0:
        row = k % flying.shape[0]
        if flying[row, 0] == k and flying[row, 1 + STAMP] > newest:
            return row
    return NOT_SENT


def blackout_rows(settings: Link, h: float) -> np.ndarray:
    """Return the blackouts of Radio (n, 3)."""

    def tick_from(time: float) -> int:
        return int(np.ceil(time / h - 1e-6))  # a time that is a tick up to rounding is that tick

    rows = [
        (_TIME, tick_from(blackout.start), tick_from(blackout.end))
        if blackout.kind == "time"
        else ("xyz".index(blackout.axis), blackout.start, blackout.end)
        for blackout in settings.blackouts
    ]
    return np.array(rows, dtype=float).reshape(-1, 3)


def radio_of(sensor: str, settings: Link, every: int, h: float) -> Radio:
    """Return the link of a sensor that sends a message every `every` ticks of h [s]; errors as in loss_parameters."""
    loss, blackouts = loss_parameters(settings.loss, h), blackout_rows(settings, h)
    return Radio(every, settings.delay, settings.random_delay, loss, blackouts, stream_id(f"link/{sensor}"))


def link_out(radio: Radio, k: int, seed: int, state: np.ndarray, out: np.ndarray) -> None:
    """Output delay_of_message's delay [ticks] (1), NOT_SENT where no message is sent, for a link without a chain."""
    out[0] = delay_of_message(radio, k, state, False, seed)


def bursty_out(radio: Radio, k: int, seed: int, state: np.ndarray, bad: np.ndarray, out: np.ndarray) -> None:
    """Same as `link_out`, for a link whose chain is bad or good."""
    out[0] = delay_of_message(radio, k, state, bad[0] != 0.0, seed)


def bursty_step(radio: Radio, k: int, seed: int, bad: np.ndarray) -> None:
    """Advance the chain by a tick."""
    bad[0] = 1.0 if chain_after(k, bad[0] != 0.0, radio.loss, seed, radio.stream) else 0.0


LINK = Element("link", out=link_out)
BURSTY = Element("bursty_link", out=bursty_out, step=bursty_step)


def late_out(k: int, message: np.ndarray, delay: np.ndarray, flying: np.ndarray, out: np.ndarray) -> None:
    """Output the message that lands in tick k, zeros if none does: this tick's, or one of those in flight."""
    fill(out, 0.0)
    now = delay[0] == 0.0 and message[ARRIVED] != 0.0
    landed = landing_row(flying, k, message[STAMP] if now else -np.inf)
    if landed != NOT_SENT:
        put(flying[landed, 1:], out)
    elif now:
        put(message, out)


def delayed_out(k: int, flying: np.ndarray, out: np.ndarray) -> None:
    """Same as `late_out`, for a link that delays every message: none lands in the tick in which it is sent."""
    fill(out, 0.0)
    landed = landing_row(flying, k, -np.inf)
    if landed != NOT_SENT:
        put(flying[landed, 1:], out)


def late_step(k: int, message: np.ndarray, delay: np.ndarray, flying: np.ndarray) -> None:
    """Put the message of tick k in flight, if it is late."""
    if delay[0] > 0.0 and message[ARRIVED] != 0.0:
        put_in_flight(flying, k + int(values_of(delay)[0]), message)


def sent_out(message: np.ndarray, delay: np.ndarray, out: np.ndarray) -> None:
    """Output the message of this tick where there is one and it is sent, else zeros."""
    fill(out, 0.0)
    if delay[0] == 0.0 and message[ARRIVED] != 0.0:
        put(message, out)


LATE = Element("late", out=late_out, step=late_step)
DELAYED = Element("delayed", out=delayed_out, step=late_step)
SENT = Element("sent", out=sent_out)


def link_box(sensor: str, settings: Link, every: int, h: float) -> Box:
    """Return the box that decides losses and delays of a sensor's messages; it reads the true state (12)."""
    has_chain = settings.loss.kind in ("bursts", "gilbert_elliott")  # which steps each tick
    given, element = (Values(start={"bad": np.zeros(1)}), BURSTY) if has_chain else (Values(), LINK)
    return Box(f"{sensor}_link", element, 1, given).with_groups(radio=radio_of(sensor, settings, every, h))


def is_late(settings: Link) -> bool:
    """Return whether a message may land in a later tick."""
    return settings.delay + settings.random_delay > 0


def delivery_box(sensor: str, message: Box, settings: Link) -> Box:
    """Return the box that delivers a sensor's messages as its link decides.

    No box is needed where no message is late and a message is there only when it is sent.
    """
    most, reads = settings.delay + settings.random_delay, {"message": message.name, "delay": f"{sensor}_link"}
    if not most:
        return Box(f"{sensor}_delivered", SENT, message.size, reads=reads)
    flying = np.tile(np.concatenate(([-1.0], np.zeros(message.size))), (most, 1))
    element = DELAYED if settings.delay else LATE
    return Box(f"{sensor}_delivered", element, message.size, Values(start={"flying": flying}), reads=reads)
