"""The wire: an LCM bus that is really there, and an inbox that takes whatever comes on it."""

import socket
import time
from collections import Counter, deque
from collections.abc import Iterable
from typing import Any, Final, NamedTuple
from urllib.parse import parse_qs, urlsplit

from pydrake.lcm import DrakeLcm

from ortilo_drake.hil.packet_checks import BadPacket, Flight
from ortilo_drake.hil.packets import lanes
from ortilo_drake.hil.unpack import Packet, decode
from ortilo_drake.hil.urls import DEFAULT_URL
from ortilo_drake.model.typed_yaml import InputError

MEMORY_URL: Final = "memq://"  # one process with itself
MEND: Final = "ip link set lo up; ip route add 224.0.0.0/4 dev lo"
MEND_NETWORK: Final = "ip route add 224.0.0.0/4 dev INTERFACE, the one to the other machine"
_RECEIVE_BUFFER: Final = 2**21  # [bytes], several pictures
REMEMBERED: Final = 4096  # ticks of a channel by which a duplicate is known: more than a link holds a packet back
_PROBE: Final = "ORTILO_PROBE"


def address(url: str) -> tuple[str, int, dict[str, int]]:
    """Return group, port and options of a udpm URL; InputError if LCM would not understand it."""
    allowed = "is not of the form udpm://GROUP:PORT?ttl=N, with GROUP in 224.0.0.0 to 239.255.255.255"
    try:
        parts = urlsplit(url)
        group, port = parts.hostname or "", parts.port or 0
        is_group = 224 <= socket.inet_pton(socket.AF_INET, group)[0] <= 239
        options = {
            key: int(values[-1]) for key, values in parse_qs(parts.query, strict_parsing=bool(parts.query)).items()
        }
    except (ValueError, OSError):
        raise InputError(f"url: {url!r} {allowed}") from None
    if parts.scheme != "udpm" or not is_group or not port or parts.path or parts.fragment:
        raise InputError(f"url: {url!r} {allowed}")
    if not options.keys() <= {"ttl", "recv_buf_size"} or not 0 <= options.get("ttl", 0) <= 255:
        raise InputError(f"url: {url!r}: the options are ttl (0 to 255) and recv_buf_size (bytes)")
    if not 0 < options.get("recv_buf_size", 1) < 2**31:
        raise InputError(f"url: {url!r}: recv_buf_size must be a positive number of bytes")
    return group, port, options


def _check_route(url: str, group: str, port: int, ttl: int) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((group, port))  # sends nothing, but asks for the route
        except OSError as error:
            reason, mend = (error.strerror or str(error)).lower(), MEND_NETWORK if ttl else MEND
            raise InputError(f"url: {url!r}: no multicast route ({reason}); as root: {mend}") from None


def _check_heard(url: str) -> None:
    """Publish from one instance until another hears it.

    LCM that cannot open its socket falls back on a queue in memory, with no more than a line on stderr.
    """
    listener, speaker = DrakeLcm(url), DrakeLcm(url)
    heard: list[bytes] = []
    listener.Subscribe(_PROBE, heard.append)
    for _ in range(20):
        speaker.Publish(_PROBE, b"")
        listener.HandleSubscriptions(50)
        if heard:
            return
    raise InputError(f"url: {url!r}: nothing sent there is heard; a firewall, or a port that another program holds")


def open_lcm(url: str = DEFAULT_URL) -> DrakeLcm:
    """Return an LCM bus, once a packet has crossed it.

    Args:
        url: udpm://GROUP:PORT?ttl=N, or memq:// for one process with itself.

    Raises:
        InputError: if the URL is of another form, or nothing can be sent there: where multicast has no route, with the
            command that makes one.
    """
    if url == MEMORY_URL:
        return DrakeLcm(url)
    group, port, options = address(url)
    _check_route(url, group, port, options.get("ttl", 0))
    options = {"ttl": 0, "recv_buf_size": _RECEIVE_BUFFER} | options
    full = f"udpm://{group}:{port}?" + "&".join(f"{key}={value}" for key, value in options.items())
    try:
        _check_heard(full)
        return DrakeLcm(full)
    except RuntimeError as error:  # Drake's, where DRAKE_ALLOW_NETWORK leaves LCM out
        raise InputError(f"url: {url!r}: {' '.join(str(error).split())}") from None


class Arrival(NamedTuple):
    """A packet, and when it came: time.perf_counter() [s]."""

    received: float
    packet: Packet


class Inbox:
    """Takes what comes on our channels, refuses and counts what is not of this flight, and never raises on any of it.

    Args:
        lcm: the bus; only poll handles its subscriptions.
        names: the channels to listen on, keys of CHANNELS.
        flight: what packets are checked against; None lets only a hello pass, until begin.
    """

    def __init__(self, lcm: DrakeLcm, names: Iterable[str], flight: Flight | None = None):
        self.flight = flight
        self._lcm = lcm
        self._raw: deque[tuple[str, float, bytes]] = deque()
        self._newest = dict.fromkeys(names, -1)
        self._seen: dict[str, dict[int, None]] = {name: {} for name in self._newest}  # a set that keeps its order
        self._distinct: Counter[str] = Counter()
        self._first: dict[str, int] = {}
        self._count: Counter[str] = Counter()
        self._refused: Counter[str] = Counter()
        for name in self._newest:
            for channel in lanes(name):
                lcm.Subscribe(channel, lambda data, name=name: self._raw.append((name, time.perf_counter(), data)))

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
        self._lcm.HandleSubscriptions(timeout_ms)
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
