"""Faults of a bad link, packet by packet, as a pure function of (seed, channel, number of the packet).

Every packet of a channel draws its own uniform numbers (world/noise.py), so its fate depends neither on the clock nor
on other channels, except where a rate limit makes packets of one direction wait for each other. Loss is the
Gilbert-Elliott model (E. N. Gilbert, "Capacity of a burst-noise channel", 1960; E. O. Elliott, 1963) with one chain a
channel.
"""

from collections import Counter
from typing import Annotated

import numpy as np
from pydantic import Field

from ortilo_drake.model.typed_yaml import Frozen
from ortilo_drake.world.noise import stream_id, uniforms

Probability = Annotated[float, Field(ge=0.0, le=1.0)]
Seconds = Annotated[float, Field(ge=0.0, le=60.0)]
_CHAIN, _LOST, _DELAY, _TWICE, _SECOND_DELAY, _HELD, _N = 0, 1, 2, 3, 4, 5, 6  # uses of the uniform numbers


class Faults(Frozen):
    """The faults of one direction; none by default.

    Attributes:
        loss: probability of losing a packet outside a burst.
        burst_loss: the same within a burst.
        into_burst: probability that a burst begins with a packet.
        out_of_burst: probability that it ends with a packet.
        delay: mean delay [s].
        spread: greatest deviation from it [s], uniform; a delay below zero is zero. Packets overtake each other.
        duplicate: probability that a packet comes twice, each with a delay of its own.
        held: probability that a packet is held back, so that others overtake it.
        hold: how long it is held back [s].
        rate: greatest number of packets per second; 0 for any.
        queue: number of packets that may wait for their turn under a rate; more are lost.
    """

    loss: Probability = 0.0
    burst_loss: Probability = 1.0
    into_burst: Probability = 0.0
    out_of_burst: Probability = 0.5
    delay: Seconds = 0.0
    spread: Seconds = 0.0
    duplicate: Probability = 0.0
    held: Probability = 0.0
    hold: Seconds = 0.1
    rate: float = Field(default=0.0, ge=0.0, le=1e6)
    queue: int = Field(default=100, ge=1, le=100_000)


def delay_of(faults: Faults, u: float) -> float:
    """Return the delay [s] that a uniform number gives."""
    return max(0.0, faults.delay + faults.spread * (2.0 * u - 1.0))


def delays_of_packet(faults: Faults, in_burst: bool, u: np.ndarray) -> list[float]:
    """Return the delay [s] of each copy of a packet that arrives, by its uniform numbers (6): none, one or two."""
    if u[_LOST] < (faults.burst_loss if in_burst else faults.loss):
        return []
    hold = faults.hold if u[_HELD] < faults.held else 0.0
    copies = (_DELAY, _SECOND_DELAY) if u[_TWICE] < faults.duplicate else (_DELAY,)
    return [hold + delay_of(faults, float(u[i])) for i in copies]


class FaultModel:
    """The faults of one direction of a link, packet by packet: it counts each channel's packets and keeps its bursts.

    Each direction, by its name, has random numbers of its own from the seed.
    """

    def __init__(self, faults: Faults, seed: int, name: str):
        self._faults, self._seed, self._name = faults, seed, name
        self._numbers: Counter[str] = Counter()
        self._in_burst: dict[str, bool] = {}
        self._free = -np.inf  # time [s] from which the next packet may go under a rate
        self.counts: Counter[str] = Counter(taken=0, lost=0, crowded=0, duplicated=0, sent=0)

    def _steps_into_burst(self, channel: str, u: float) -> bool:
        bad = self._in_burst.get(channel, False)
        bad = u >= self._faults.out_of_burst if bad else u < self._faults.into_burst
        self._in_burst[channel] = bad
        return bad

    def _turn(self, now: float) -> float | None:
        """Return the time at which a packet may go; None if too many wait."""
        if not self._faults.rate:
            return now
        turn = max(now, self._free)
        if (turn - now) * self._faults.rate > self._faults.queue:
            return None
        self._free = turn + 1.0 / self._faults.rate
        return turn

    def due_times(self, channel: str, now: float) -> list[float]:
        """Return the times [s] at which copies of a packet taken now arrive: none, one or two."""
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
