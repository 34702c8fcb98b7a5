"""A process between the halves that passes their packets on, with the faults of a bad link.

Every packet of a channel draws its own uniform numbers (world/noise.py), a pure function of seed, channel and packet
number. So its faults depend neither on the clock nor on other channels, except where a rate limit makes packets of one
direction wait for each other. Loss follows the Gilbert-Elliott model (E. N. Gilbert, "Capacity of a burst-noise
channel", 1960; E. O. Elliott, 1963) with one chain for each channel.

Each half has its own bus. The world serves its bus and the relay joins it. The relay serves the other bus and the
onboard half joins it. Listeners, and users who request a goal, are on the world's bus. Both buses have the same key.
"""

import heapq
import itertools
import time
from collections import Counter
from functools import partial
from threading import Event
from typing import Annotated, Final

import numpy as np
from pydantic import Field

from ortilo_drake.hil.wire.address import address
from ortilo_drake.hil.wire.bus import Bus
from ortilo_drake.hil.wire.packets import NO_TICK, channel_of, ports
from ortilo_drake.hil.wire.urls import DEFAULT_URL, ONBOARD_URL
from ortilo_drake.model.typed_yaml import Frozen, InputError
from ortilo_drake.world.noise import stream_id, uniforms

Probability = Annotated[float, Field(ge=0.0, le=1.0)]
Seconds = Annotated[float, Field(ge=0.0, le=60.0)]
_CHAIN, _LOST, _DELAY, _TWICE, _SECOND_DELAY, _HELD, _N = 0, 1, 2, 3, 4, 5, 6  # uses of the uniform numbers


class Faults(Frozen):
    """The faults of one direction of the link; no faults by default."""

    loss: Probability = 0.0
    """probability of losing a packet outside a burst."""
    burst_loss: Probability = 1.0
    """probability of losing a packet within a burst."""
    into_burst: Probability = 0.0
    """probability that a burst begins with a packet."""
    out_of_burst: Probability = 0.5
    """probability that a burst ends with a packet."""
    delay: Seconds = 0.0
    """mean delay [s]."""
    spread: Seconds = 0.0
    """largest deviation from the mean delay [s], uniform; a negative delay becomes 0. Packets may overtake others."""
    duplicate: Probability = 0.0
    """probability that a packet comes twice, each time with its own delay."""
    held: Probability = 0.0
    """probability that a packet is held back, so that others overtake it."""
    hold: Seconds = 0.1
    """time for which such a packet is held back [s]."""
    rate: float = Field(default=0.0, ge=0.0, le=1e6)
    """largest number of packets per second; 0 for no limit."""
    queue: int = Field(default=100, ge=1, le=100_000)
    """largest number of packets that wait because of the rate; more are lost."""


def delay_of(faults: Faults, u: float) -> float:
    """Return the delay [s] for a uniform number u in [0, 1)."""
    return max(0.0, faults.delay + faults.spread * (2.0 * u - 1.0))


def delays_of_packet(faults: Faults, in_burst: bool, u: np.ndarray) -> list[float]:
    """Return the delays [s] of the copies (none, one or two) of a packet that arrive, given its uniform numbers (6)."""
    if u[_LOST] < (faults.burst_loss if in_burst else faults.loss):
        return []
    hold = faults.hold if u[_HELD] < faults.held else 0.0
    copies = (_DELAY, _SECOND_DELAY) if u[_TWICE] < faults.duplicate else (_DELAY,)
    return [hold + delay_of(faults, float(u[i])) for i in copies]


class FaultModel:
    """The faults of one direction of a link, packet by packet, with the packet count and burst state of each channel.

    Each direction has its own random numbers, from the seed and the direction's name.
    """

    def __init__(self, faults: Faults, seed: int, name: str):
        self._faults, self._seed, self._name = faults, seed, name
        self._numbers: Counter[str] = Counter()
        self._in_burst: dict[str, bool] = {}
        self._free = -np.inf  # time from which the rate limit allows the next packet [s]
        self.counts: Counter[str] = Counter(taken=0, lost=0, crowded=0, duplicated=0, sent=0)

    def _steps_into_burst(self, channel: str, u: float) -> bool:
        bad = self._in_burst.get(channel, False)
        bad = u >= self._faults.out_of_burst if bad else u < self._faults.into_burst
        self._in_burst[channel] = bad
        return bad

    def _turn(self, now: float) -> float | None:
        """Return the time at which a packet may leave [s]; None if too many packets wait."""
        if not self._faults.rate:
            return now
        turn = max(now, self._free)
        if (turn - now) * self._faults.rate > self._faults.queue:
            return None
        self._free = turn + 1.0 / self._faults.rate
        return turn

    def due_times(self, channel: str, now: float) -> list[float]:
        """Return the arrival times [s] of the copies (none, one or two) of a packet taken at the time `now` [s]."""
        u = uniforms(self._seed, stream_id(f"{self._name} {channel}"), self._numbers[channel], _N)
        self._numbers[channel] += 1
        self.counts["taken"] += 1
        delays = delays_of_packet(self._faults, self._steps_into_burst(channel, u[_CHAIN]), u)
        if not delays:
            self.counts["lost"] += 1
            return []
        turn = self._turn(now)
        if turn is None:
            self.counts["crowded"] += 1
            return []
        self.counts["duplicated"] += len(delays) - 1
        return [turn + delay for delay in delays]


_FROM_ONBOARD: Final = ("command", "telemetry")
_FROM_ONBOARD_LARGEST: Final = 2**18  # [bytes]; telemetry of a sensor with 170 rows; pictures go the other way only
_WAIT = 1  # longest wait for packets of the world in one turn [ms]


class _Direction:
    """The packets on their way from one half's bus to the other's, the next due first."""

    def __init__(self, half: str, source: Bus, target: Bus, faults: FaultModel):
        self._target, self.faults = target, faults
        self._due: list[tuple[float, int, str, bytes]] = []
        self._order = itertools.count()  # decides between equal times: first come, first served
        for name in (*_FROM_ONBOARD, *NO_TICK) if half == "onboard" else (*ports(), "tick", *NO_TICK):
            source.subscribe(channel_of(name), partial(self._take, name))

    def _take(self, name: str, data: bytes) -> None:
        for due in self.faults.due_times(name, time.monotonic()):
            heapq.heappush(self._due, (due, next(self._order), channel_of(name), data))

    def release(self, now: float) -> None:
        """Publish the packets that are due."""
        while self._due and self._due[0][0] <= now:
            _, _, channel, data = heapq.heappop(self._due)
            self._target.publish(channel, data)
            self.faults.counts["sent"] += 1


def run_relay(
    key: bytes,
    url_world: str = DEFAULT_URL,
    url_onboard: str = ONBOARD_URL,
    to_onboard: Faults | None = None,
    to_world: Faults | None = None,
    seed: int = 1,
    seconds: float = float("inf"),
    stop: Event | None = None,
    ready: Event | None = None,
) -> dict[str, dict[str, int]]:
    """Pass packets on for `seconds`, or until `stop` is set or Ctrl-C is pressed; then return the counts of packets.

    The world serves the bus at `url_world`, the relay the one at `url_onboard`, with the same key. `ready` is set once
    the relay listens. The faults of each direction, none by default, are drawn with the seed. The counts for
    "to_onboard" and "to_world" are of packets taken, lost, crowded (dropped from a full queue), duplicated and sent;
    packets not yet due at the end are not sent. InputError if a bus cannot be opened or both are the same.
    """
    if address(url_world) == address(url_onboard):
        raise InputError(f"url: {url_world!r}: the relay needs two different buses, one for each half")
    with (
        Bus(url_world, key) as world,
        Bus(url_onboard, key, serves=True, largest=_FROM_ONBOARD_LARGEST) as onboard,
    ):
        directions = {
            "to_onboard": _Direction("world", world, onboard, FaultModel(to_onboard or Faults(), seed, "to_onboard")),
            "to_world": _Direction("onboard", onboard, world, FaultModel(to_world or Faults(), seed, "to_world")),
        }
        uniforms(seed, stream_id("compile now"), 0, 1)  # so that numba does not compile at the first packet
        if ready:
            ready.set()
        end = time.monotonic() + seconds
        try:
            while time.monotonic() < end and not (stop and stop.is_set()):
                world.handle(_WAIT)
                onboard.handle(0)
                for each in directions.values():
                    each.release(time.monotonic())
        except KeyboardInterrupt:
            pass
        return {name: dict(each.faults.counts) for name, each in directions.items()}
