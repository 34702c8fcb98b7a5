"""Inboxes: packets from a bus, checked and without duplicates; packets of the world put together tick by tick."""

import heapq
import time
from collections import Counter, deque
from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial
from typing import Final, NamedTuple

from ortilo_drake.flight.stepped_halves import Signals
from ortilo_drake.hil.wire.bus import Bus
from ortilo_drake.hil.wire.packets import Goal, Hello, channel_of
from ortilo_drake.hil.wire.unpack import BadPacket, Flight, Packet, decode

GOAL_AGE: Final = 10.0  # an older request of a goal is refused [s]
REMEMBERED: Final = 4096  # number of ticks of a channel that are remembered, more than a link delays a packet


class Arrival(NamedTuple):
    """A packet, and its time of receipt by time.perf_counter() [s]."""

    received: float
    packet: Packet


@dataclass(frozen=True)
class PacketCounts:
    """The counts of an inbox: packets `accepted`, of these `late` (after a newer packet), and `duplicates` of these.

    `lost` are gaps in the ticks of a channel since its first; `rejected` are all refused packets, `refused` by reason.
    """

    accepted: int
    late: int
    duplicates: int
    lost: int
    rejected: int
    refused: dict[str, int]


class _Channel:
    """The ticks of a channel, of which it knows the REMEMBERED greatest.

    Ticks up to the last forgotten one, or below a floor, are old. A single tick far ahead does not make others old.
    `late` counts the ticks that came after a newer one.
    """

    def __init__(self, floor: int = 0):
        self.late = 0
        self._floor, self._newest = floor, -1
        self._first = self._distinct = 0
        self._heap: list[int] = []
        self._known: set[int] = set()

    def add(self, tick: int) -> bool:
        """Remember a tick; return whether it is new. BadPacket if it is too old to decide that."""
        if tick < self._floor:
            raise BadPacket("old")
        if tick in self._known:
            return False
        self.late += tick < self._newest
        self._first = min(self._first, tick) if self._distinct else tick
        self._newest = max(self._newest, tick)
        self._distinct += 1
        self._known.add(tick)
        heapq.heappush(self._heap, tick)
        if len(self._heap) > REMEMBERED:
            least = heapq.heappop(self._heap)
            self._known.remove(least)
            self._floor = least + 1
        return True

    def lost(self) -> int:
        """Return the number of ticks that are missing between the first and the newest."""
        return self._newest + 1 - self._first - self._distinct


class Inbox:
    """A receiver of the packets of a flight on our channels; it refuses and counts all other packets and never raises.

    One packet is accepted for each tick of a channel; hellos and goals are accepted as often as they come. A packet
    from before this process joined the flight is refused as "old". Packets that fail unpack.py are refused, and so is
    all that the bus refuses (bus.Bus). `names` are the channels to listen on, of packets.KINDS or sensors. Only `poll`
    receives from the bus.

    Packets are checked against `flight`; while it is None, until `begin`, only hellos pass. `tick` is the newest tick
    heard of, -1 before any.
    """

    def __init__(self, bus: Bus, names: Iterable[str], flight: Flight | None = None):
        self.flight, self.tick = flight, -1
        self._bus = bus
        self._raw: deque[tuple[str, float, bytes]] = deque()
        self._channels = {name: _Channel() for name in names}
        self._joined = 0
        self._count: Counter[str] = Counter()
        self._refused: Counter[str] = Counter()
        self._takers = {channel_of(name): partial(self._keep, name) for name in self._channels}
        for channel, take in self._takers.items():
            bus.subscribe(channel, take)

    def leave(self) -> None:
        """Take no more packets from the bus."""
        for channel, take in self._takers.items():
            self._bus.unsubscribe(channel, take)

    def _keep(self, name: str, data: bytes) -> None:
        self._raw.append((name, time.perf_counter(), data))

    def begin(self, flight: Flight, tick: int = 0) -> None:
        """Take the packets of a flight from a tick on, and reset the counts."""
        self.flight, self._joined, self.tick = flight, tick, tick - 1
        self._channels = {name: _Channel(tick) for name in self._channels}
        self._count.clear()
        self._refused.clear()
        self._bus.refused.clear()

    def poll(self, timeout_ms: int = 0) -> list[Arrival]:
        """Return the packets that passed the checks, in order of arrival; wait up to `timeout_ms` [ms] for the first.

        A late packet, whose tick is older than the newest of its channel, is returned as well.
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
        """Note a packet; return whether it is new. BadPacket if it is foreign or too old."""
        if isinstance(hello := packet.value, Hello):
            if self.flight and hello.session != self.flight.session:
                raise BadPacket("foreign")
            if self.flight and hello.role == "world":
                self.tick = max(self.tick, hello.tick)
            return True
        if isinstance(goal := packet.value, Goal):
            age = GOAL_AGE / self.flight.h if self.flight else 0.0
            if goal.tick < max(self._joined, self.tick - age):
                raise BadPacket("old")
            return True  # a repeated request asks for its answer again
        if not self._channels[name].add(packet.tick):
            return False
        self.tick = max(self.tick, packet.tick)
        return True

    def counts(self, name: str = "") -> PacketCounts:
        """Return the counts so far.

        `lost` counts the channel `name`; it is 0 without a name, because a sensor does not send in every tick.
        """
        refused = self._refused + self._bus.refused
        return PacketCounts(
            accepted=self._count["accepted"],
            late=sum(channel.late for channel in self._channels.values()),
            duplicates=self._count["duplicates"],
            lost=self._channels[name].lost() if name else 0,
            rejected=refused.total(),
            refused=dict(sorted(refused.items())),
        )


class TickInbox:
    """A collector that puts the packets of each tick together; they may come in any order.

    `overtaken` counts the messages that were dropped for a newer one on the same port.
    """

    def __init__(self) -> None:
        self._sent: dict[int, tuple[str, ...]] = {}
        self._messages: dict[int, Signals] = {}
        self.overtaken = 0

    def put(self, packet: Packet) -> None:
        """Add a packet of the world."""
        if packet.name == "tick":
            self._sent[packet.tick] = packet.value
        else:
            self._messages.setdefault(packet.tick, {})[packet.name] = packet.value

    def is_complete(self, tick: int) -> bool:
        """Return whether all messages that were sent in a tick are here."""
        return tick in self._sent and self._messages.get(tick, {}).keys() >= set(self._sent[tick])

    def pop(self, tick: int) -> Signals:
        """Return the messages of a tick and remove them."""
        self._sent.pop(tick, None)
        return self._messages.pop(tick, {})

    def pop_until(self, tick: int, keep_from: int) -> Signals:
        """Return the messages of a tick and late ones of earlier ticks; of several on one port the newest.

        The others are dropped, or from the tick `keep_from` on kept for a later tick without a message on their port.
        """
        taken: Signals = {}
        for k in sorted((k for k in self._messages if k <= tick), reverse=True):
            here = self._messages.pop(k)
            rest = {name: value for name, value in here.items() if name in taken}
            taken = here | taken
            if rest and k >= keep_from:
                self._messages[k] = rest
            else:
                self.overtaken += len(rest)
        self._sent = {k: names for k, names in self._sent.items() if k > tick}
        return taken
