"""Takes whatever comes on a bus."""

import time
from collections import Counter, deque
from collections.abc import Iterable
from functools import partial
from typing import Any, Final, NamedTuple

from ortilo_drake.hil.bus import Bus
from ortilo_drake.hil.packet_checks import BadPacket, Flight
from ortilo_drake.hil.packets import CHANNELS
from ortilo_drake.hil.unpack import Packet, decode

REMEMBERED: Final = 4096  # ticks of a channel by which a duplicate is known: more than a link holds a packet back


class Arrival(NamedTuple):
    """A packet, and when it came: time.perf_counter() [s]."""

    received: float
    packet: Packet


class Inbox:
    """Takes what comes on our channels, refuses and counts what is not of this flight, and never raises on any of it.

    Args:
        bus: the bus; only poll handles its subscriptions.
        names: the channels to listen on, keys of CHANNELS.
        flight: what packets are checked against; None lets only a hello pass, until begin.
    """

    def __init__(self, bus: Bus, names: Iterable[str], flight: Flight | None = None):
        self.flight = flight
        self._bus = bus
        self._raw: deque[tuple[str, float, bytes]] = deque()
        self._newest = dict.fromkeys(names, -1)
        self._seen: dict[str, dict[int, None]] = {name: {} for name in self._newest}  # a set that keeps its order
        self._distinct: Counter[str] = Counter()
        self._first: dict[str, int] = {}
        self._count: Counter[str] = Counter()
        self._refused: Counter[str] = Counter()
        for name in self._newest:
            bus.subscribe(CHANNELS[name], partial(self._keep, name))

    def _keep(self, name: str, data: bytes) -> None:
        self._raw.append((name, time.perf_counter(), data))

    def begin(self, flight: Flight) -> None:
        """Take the packets of a flight from now on, and count anew."""
        self.flight = flight
        self._count.clear()
        self._refused.clear()

    def poll(self, timeout_ms: int = 0) -> list[Arrival]:
        """Return what has come and passed, in order of arrival; wait for the first as long as given.

        A duplicate of one of the last REMEMBERED ticks of its channel is dropped. A late one, of an older tick than
        the newest of its channel, is returned.
        """
        self._bus.handle(timeout_ms)
        arrivals = []
        while self._raw:
            name, received, data = self._raw.popleft()
            try:
                packet = decode(name, data, self.flight)
            except BadPacket as problem:
                self._refused[problem.reason] += 1
                continue
            if packet.name == "hello" and self.flight and packet.value.session != self.flight.session:
                self._refused["foreign"] += 1
                continue
            if packet.tick >= 0 and not self._is_new(name, packet.tick):
                continue
            self._count["accepted"] += 1
            arrivals.append(Arrival(received, packet))
        return arrivals

    def _is_new(self, name: str, tick: int) -> bool:
        """Note a tick; return whether it is the first packet of its channel and tick."""
        seen, newest = self._seen[name], self._newest[name]
        if tick in seen:
            self._count["duplicates"] += 1
            return False
        seen[tick] = None
        if len(seen) > REMEMBERED:
            del seen[next(iter(seen))]
        self._distinct[name] += 1
        self._count["late"] += tick < newest
        self._newest[name] = max(newest, tick)
        self._first[name] = min(self._first.get(name, tick), tick)
        return True

    def counts(self, name: str = "") -> dict[str, Any]:
        """Return how many packets were accepted, of these late, duplicates, refused by reason, and lost, for JSON.

        Lost are the gaps in a channel's ticks since the first heard, of the channel named or of none: a sensor does
        not speak in every tick.
        """
        lost = self._newest[name] + 1 - self._first.get(name, 0) - self._distinct[name] if name else 0
        plain = {key: self._count[key] for key in ("accepted", "late", "duplicates")}
        return plain | {"lost": lost, "rejected": self._refused.total(), "refused": dict(sorted(self._refused.items()))}
