"""The LCM bus over sockets of our own, checked to work when it is opened."""

import contextlib
import time
from collections import Counter, deque
from collections.abc import Callable
from typing import Final, Protocol

from ortilo_drake.hil.wire.multicast import MEND, MEND_NETWORK, RECEIVE_BUFFER, Multicast, address, leaves_machine
from ortilo_drake.hil.wire.udpm import Reassembly, Sender, encode
from ortilo_drake.hil.wire.urls import DEFAULT_URL
from ortilo_drake.model.typed_yaml import InputError

MEMORY_URL: Final = "memq://"  # within one process
_PROBE: Final = "ORTILO_PROBE"


class _Wire(Protocol):
    """A carrier of datagrams."""

    def send(self, datagram: bytes) -> None: ...
    def receive(self) -> list[tuple[Sender, bytes]]: ...
    def wait(self, milliseconds: int) -> bool: ...
    def close(self) -> None: ...


class _Memory:
    """Datagrams in a queue of this process."""

    def __init__(self) -> None:
        self._queue: deque[tuple[Sender, bytes]] = deque()

    def send(self, datagram: bytes) -> None:
        self._queue.append((("memory", 0), datagram))

    def receive(self) -> list[tuple[Sender, bytes]]:
        came = list(self._queue)
        self._queue.clear()
        return came

    def wait(self, milliseconds: int) -> bool:
        time.sleep(1e-3 * milliseconds)
        return bool(self._queue)

    def close(self) -> None:
        self._queue.clear()


class Bus:
    """LCM's messages on their channels; only handle receives.

    Args:
        wire: what carries the datagrams.
        url: its name.
    """

    def __init__(self, wire: _Wire, url: str):
        self.url = url
        self._wire, self._reassembly, self._sequence = wire, Reassembly(), 0
        self._takers: dict[str, list[Callable[[bytes], None]]] = {}
        self._unsent = 0

    @property
    def refused(self) -> Counter[str]:
        """How many datagrams were dropped, by reason, see udpm.Reassembly."""
        return self._reassembly.refused

    def publish(self, channel: str, data: bytes) -> None:
        """Send a message; it is lost if the network is down."""
        for datagram in encode(channel, self._sequence, data):
            try:
                self._wire.send(datagram)
            except OSError:
                self._unsent += 1
        self._sequence = (self._sequence + 1) % 2**32

    def subscribe(self, channel: str, take: Callable[[bytes], None]) -> None:
        """Have a function called with each message on a channel."""
        self._reassembly.channels.add(channel)
        self._takers.setdefault(channel, []).append(take)

    def handle(self, timeout_ms: int = 0) -> int:
        """Hand on the messages that have come on subscribed channels; wait for the first at most as long as given.

        Returns:
            How many messages were handed on.
        """
        until = time.perf_counter() + 1e-3 * timeout_ms
        handed, left = 0, timeout_ms
        while True:
            for sender, datagram in self._wire.receive():
                message = self._reassembly.take(sender, datagram, time.perf_counter())
                if message:
                    for take in self._takers[message.channel]:
                        take(message.data)
                    handed += 1
            if handed or left <= 0 or not self._wire.wait(left):
                return handed
            left = int(1e3 * (until - time.perf_counter()))  # a message for others may have ended the wait

    def probe(self) -> None:
        """Send a message that nobody needs; OSError where it cannot be sent."""
        self._wire.send(encode(_PROBE, 0, b"")[0])

    def close(self) -> None:
        """Leave the bus."""
        self._wire.close()

    def __enter__(self) -> "Bus":
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


def _join(url: str) -> Bus:
    group, port, options = address(url)
    return Bus(Multicast(group, port, options.get("ttl", 0), options.get("recv_buf_size", RECEIVE_BUFFER)), url)


def open_bus(url: str = DEFAULT_URL) -> Bus:
    """Return an LCM bus, once a packet has crossed it.

    Args:
        url: udpm://GROUP:PORT?ttl=N, or memq:// within one process.

    Raises:
        InputError: if the URL is of another form, or nothing can be sent there: where multicast has no route, with the
            command that makes one.
    """
    if url == MEMORY_URL:
        return Bus(_Memory(), url)
    heard: list[bytes] = []
    with contextlib.ExitStack() as failed:
        try:
            bus = failed.enter_context(_join(url))
            with _join(url) as speaker:
                bus.subscribe(_PROBE, heard.append)
                for _ in range(20):
                    speaker.probe()
                    if bus.handle(50):
                        break
        except OSError as error:
            reason, mend = (error.strerror or str(error)).lower(), MEND_NETWORK if leaves_machine(url) else MEND
            raise InputError(f"url: {url!r}: no multicast ({reason}); as root: {mend}") from None
        if not heard:
            raise InputError(f"url: {url!r}: nothing sent there is heard; a firewall?")
        failed.pop_all()
    return bus
