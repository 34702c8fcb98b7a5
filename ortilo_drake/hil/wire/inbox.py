"""The inbox: packets from a bus, checked and without duplicates."""

import time
from collections import Counter, deque
from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial
from typing import Final, NamedTuple

from ortilo_drake.hil.wire.bus import Bus
from ortilo_drake.hil.wire.packet_checks import BadPacket, Flight
from ortilo_drake.hil.wire.packets import Goal, Hello, channel_of
from ortilo_drake.hil.wire.unpack import Packet, decode
from ortilo_drake.hil.wire.window import Window

GOAL_AGE: Final = 10.0  # an older request is refused [s]


class Arrival(NamedTuple):
    """A packet, and when it came: time.perf_counter() [s]."""

    received: float
    packet: Packet


@dataclass(frozen=True)
class PacketCounts:
    """Counts of an inbox.

    Attributes:
        accepted: packets taken.
        late: of these, those that a newer one had overtaken.
        duplicates: taken before.
        lost: gaps in the ticks of a channel, since the first it heard.
        rejected: refused.
        refused: the same by reason.
    """

    accepted: int
    late: int
    duplicates: int
    lost: int
    rejected: int
    refused: dict[str, int]


class Inbox:
    """Receives the packets of a flight from our channels; refuses and counts all others, and never raises.

    A packet is taken once: one for each tick of a channel. Hellos and goals are taken as often as they come. A packet
    from before this half joined the flight is refused as "old". Refused are also those that fail packet_checks.py, and
    what the bus refuses (bus.Bus).

    Args:
        bus: the bus; only poll handles its subscriptions.
        names: the channels to listen on, of packets.KINDS or a sensor.
        flight: the flight that packets are checked against; with None only hellos pass, until begin.

    Attributes:
        flight: the flight.
        tick: the newest tick heard of; -1 before any.
    """

    def __init__(self, bus: Bus, names: Iterable[str], flight: Flight | None = None):
        self.flight, self.tick = flight, -1
        self._bus = bus
        self._raw: deque[tuple[str, float, bytes]] = deque()
        self._newest = dict.fromkeys(names, -1)
        self._windows = {name: Window() for name in self._newest}
        self._joined = 0
        self._distinct: Counter[str] = Counter()
        self._first: dict[str, int] = {}
        self._count: Counter[str] = Counter()
        self._refused: Counter[str] = Counter()
        self._takers = {channel_of(name): partial(self._keep, name) for name in self._newest}
        for channel, take in self._takers.items():
            bus.subscribe(channel, take)

    def leave(self) -> None:
        """Take nothing more from the bus."""
        for channel, take in self._takers.items():
            self._bus.unsubscribe(channel, take)

    def _keep(self, name: str, data: bytes) -> None:
        self._raw.append((name, time.perf_counter(), data))

    def begin(self, flight: Flight, tick: int = 0) -> None:
        """Take the packets of a flight from a tick on, and count anew."""
        self.flight, self._joined, self.tick = flight, tick, tick - 1
        self._windows = {name: Window(tick) for name in self._newest}
        self._count.clear()
        self._refused.clear()
        self._bus.refused.clear()

    def poll(self, timeout_ms: int = 0) -> list[Arrival]:
        """Return the packets that came and passed the checks, in order of arrival; wait for the first as long as given.

        A late packet, of an older tick than the newest of its channel, is returned.
        """
        self._bus.handle(timeout_ms)
        arrivals = []
        while self._raw:
            name, received, data = self._raw.popleft()
            try:
                packet = decode(name, data, self.flight)
                is_new = self._is_new(name, packet)
            except BadPacket as problem:
                self._refused[problem.reason] += 1
                continue
            self._count["accepted" if is_new else "duplicates"] += 1
            if is_new:
                arrivals.append(Arrival(received, packet))
        return arrivals

    def _is_new(self, name: str, packet: Packet) -> bool:
        """Note a packet; return whether it is new. BadPacket if it is older than what is remembered."""
        if isinstance(packet.value, Hello):
            self._check_hello(packet.value)
            return True
        if isinstance(packet.value, Goal):
            goal, age = packet.value, GOAL_AGE / self.flight.h if self.flight else 0.0
            if goal.tick < max(self._joined, self.tick - age):
                raise BadPacket("old")
            return True  # a repeated request asks for its answer again
        window, newest, tick = self._windows[name], self._newest[name], packet.tick
        if window.is_old(tick):
            raise BadPacket("old")
        if window.is_known(tick):
            return False
        window.add(tick)
        self._distinct[name] += 1
        self._count["late"] += tick < newest
        self._newest[name] = max(newest, tick)
        self._first[name] = min(self._first.get(name, tick), tick)
        self.tick = max(self.tick, tick)
        return True

    def _check_hello(self, hello: Hello) -> None:
        if self.flight and hello.session != self.flight.session:
            raise BadPacket("foreign")
        if self.flight and hello.role == "world":
            self.tick = max(self.tick, hello.tick)

    def counts(self, name: str = "") -> PacketCounts:
        """Return the counts so far.

        Lost are those of the channel named; 0 without a name, as a sensor does not send in every tick.
        """
        lost = self._newest[name] + 1 - self._first.get(name, 0) - self._distinct[name] if name else 0
        refused = self._refused + self._bus.refused
        return PacketCounts(
            accepted=self._count["accepted"],
            late=self._count["late"],
            duplicates=self._count["duplicates"],
            lost=lost,
            rejected=refused.total(),
            refused=dict(sorted(refused.items())),
        )
