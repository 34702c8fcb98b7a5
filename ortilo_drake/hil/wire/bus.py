"""The bus between the processes of a flight: messages on channels, by ZeroMQ over TCP, encrypted by CURVE.

One process serves a bus: the world, or the relay on the onboard half's side. All other processes join the bus. The
server receives each message that is published, and passes it on to all other processes.

All processes know the key of key_file.py. From the key come two pairs of CURVE keys, one for the server and one for all
processes that join. The secret keys are

    s_server = HMAC-SHA-256(key, "ortilo server"),  s_joins = HMAC-SHA-256(key, "ortilo joins")

The server admits only processes with these keys, and a process that joins talks to no other server. CURVE refuses
messages that were recorded, repeated or changed on the way.
"""

import errno
import hmac
import os
import time
from collections import Counter
from collections.abc import Callable
from typing import Final, NamedTuple

import zmq
from zmq.auth.thread import ThreadAuthenticator
from zmq.utils import z85
from zmq.utils.monitor import parse_monitor_message

from ortilo_drake.hil.wire.address import address
from ortilo_drake.model.typed_yaml import InputError

LARGEST: Final = 2**24  # largest message that a process which joined takes, a picture of the widest camera [bytes]
QUEUE: Final = 1000  # most messages that wait for one process; more are dropped
AT_ONCE: Final = 256  # most messages that one call of handle takes
_FLUSH: Final = 1000  # longest time for a closed bus to send published messages [ms]
_RETRY: Final = 50  # time between two attempts to join [ms]
_HANDSHAKE: Final = 2_000  # a connection that has not shown its key within this time is closed [ms]
_CURVE: Final = 33  # number of bytes that encryption adds to a message
_ALIVE: Final = 1000, 5000  # period of signs of life, and longest wait for one [ms]
_HERE: Final = b""  # a message that asks the server to send us the messages of the others
_DOMAIN: Final = "ortilo"  # domain of the gate
_REFUSED: Final = (
    zmq.Event.HANDSHAKE_FAILED_NO_DETAIL | zmq.Event.HANDSHAKE_FAILED_PROTOCOL | zmq.Event.HANDSHAKE_FAILED_AUTH
)


def curve_keys(key: bytes, whose: str) -> tuple[bytes, bytes]:
    """Return the public and the secret CURVE key, in Z85, of the "server" or of a process that "joins"."""
    secret = z85.encode(hmac.digest(key, f"ortilo {whose}".encode(), "sha256"))
    return zmq.curve_public(secret), secret


def _has_some(socket: "zmq.Socket[bytes]") -> bool:
    return bool(int(socket.get(zmq.EVENTS)) & zmq.POLLIN)


class _Admits(NamedTuple):
    """A check that admits only connections with a given public key."""

    public: bytes

    def callback(self, domain: str, key: bytes) -> bool:
        return hmac.compare_digest(key, self.public)


class Bus:
    """One process's end of a bus at tcp://HOST:PORT. It is not thread-safe; only `handle` receives.

    All processes share a key (32 bytes); one serves the bus. With `hears` False a process that joins receives nothing.
    A message of more than `largest` bytes ends its connection, because any process that connects can occupy as much
    memory before it shows its key. `refused` counts connections with another key or of another kind ("key"), and
    messages that are not channel and data ("frames"). InputError if the URL is invalid, or cannot be served.
    """

    def __init__(self, url: str, key: bytes, serves: bool = False, hears: bool = True, largest: int = LARGEST):
        self.url, self.refused = url, Counter[str]()
        self._serves, self._hears = serves, hears
        self._others: dict[bytes, None] = {}  # on the server, the processes that joined
        self._takers: dict[str, list[Callable[[bytes], None]]] = {}
        self._context = zmq.Context()
        self._context.setsockopt(zmq.RCVHWM, 0)  # a full monitor would block ZeroMQ's thread
        self._socket = self._context.socket(zmq.ROUTER if serves else zmq.DEALER)
        self._gate = ThreadAuthenticator(self._context)
        for option, value in (
            *((zmq.SNDHWM, QUEUE), (zmq.RCVHWM, QUEUE), (zmq.MAXMSGSIZE, largest + _CURVE), (zmq.LINGER, _FLUSH)),
            *((zmq.HEARTBEAT_IVL, _ALIVE[0]), (zmq.HEARTBEAT_TIMEOUT, _ALIVE[1]), (zmq.HANDSHAKE_IVL, _HANDSHAKE)),
        ):
            self._socket.setsockopt(option, value)
        self._monitor = self._socket.get_monitor_socket(_REFUSED | zmq.Event.HANDSHAKE_SUCCEEDED)
        try:
            at = address(url)
            self._socket.setsockopt(zmq.IPV6, int(at.host.version == 6))
            if serves:
                self._serve(key, at.endpoint(serves=True))
            else:
                self._join(key, at.endpoint(serves=False))
        except InputError:
            self.close()
            raise

    def _serve(self, key: bytes, endpoint: str) -> None:
        self._gate.start()
        self._gate.configure_curve_callback(_DOMAIN, _Admits(curve_keys(key, "joins")[0]))
        self._socket.curve_publickey, self._socket.curve_secretkey = curve_keys(key, "server")
        self._socket.curve_server = True
        self._socket.zap_domain, self._socket.zap_enforce_domain = _DOMAIN.encode(), True  # without a gate admit nobody
        self._socket.setsockopt(zmq.ROUTER_MANDATORY, 1)  # so that send raises for a process that has left
        try:
            self._socket.bind(endpoint)
        except zmq.ZMQError as error:
            elsewhere = "must be an address of this machine, or tcp://0.0.0.0:PORT"
            in_use = "another process serves it; end that one, or give this flight another --url"
            known = {errno.EADDRINUSE: in_use, errno.EADDRNOTAVAIL: elsewhere, errno.ENODEV: elsewhere}
            why = known.get(error.errno or 0, os.strerror(error.errno or 0).lower())
            raise InputError(f"url: {self.url!r}: {why}") from None

    def _join(self, key: bytes, endpoint: str) -> None:
        self._socket.curve_serverkey = curve_keys(key, "server")[0]
        self._socket.curve_publickey, self._socket.curve_secretkey = curve_keys(key, "joins")
        self._socket.setsockopt(zmq.RECONNECT_IVL, _RETRY)
        self._socket.connect(endpoint)

    def publish(self, channel: str, data: bytes) -> None:
        """Send a message. A process that has not joined, or has QUEUE messages waiting, does not receive it.

        A process that joins may publish before the server is there: the message is sent once the server is.
        """
        self._send([channel.encode(), data])

    def _send(self, message: list[bytes], but: bytes = b"") -> None:
        for other in [other for other in self._others if other != but] if self._serves else [b""]:
            try:
                self._socket.send_multipart([other, *message] if self._serves else message, zmq.NOBLOCK)
            except zmq.Again:
                continue  # this process has QUEUE messages waiting
            except zmq.ZMQError as error:
                if error.errno != errno.EHOSTUNREACH:
                    raise
                del self._others[other]

    def subscribe(self, channel: str, take: Callable[[bytes], None]) -> None:
        """Call `take` with each message on a channel from now on."""
        self._takers.setdefault(channel, []).append(take)

    def unsubscribe(self, channel: str, take: Callable[[bytes], None]) -> None:
        """Call `take` no more for messages on a channel."""
        self._takers[channel].remove(take)

    def handle(self, timeout_ms: int = 0) -> int:
        """Pass on the messages on subscribed channels; return how many. Wait up to `timeout_ms` [ms] for the first."""
        until = time.perf_counter() + 1e-3 * timeout_ms
        handed, left = 0, timeout_ms
        while True:
            for _ in range(AT_ONCE):
                if not _has_some(self._socket):
                    break
                handed += self._take(self._socket.recv_multipart())
            if handed:
                return handed
            self._watch()
            if left <= 0 or not self._socket.poll(left):
                return 0
            left = int(1e3 * (until - time.perf_counter()))  # a message for others may have ended the wait

    def _take(self, frames: list[bytes]) -> bool:
        """Take a message, and as the server pass it on; return whether this process subscribed to its channel."""
        sender = frames.pop(0) if self._serves else b""
        if self._serves and frames == [_HERE]:
            self._others[sender] = None
            return False
        if len(frames) != 2:
            self.refused["frames"] += 1
            return False
        if self._serves:
            self._send(frames, but=sender)
        takers = self._takers.get(frames[0].decode("ascii", "replace"), ())
        for take in takers:
            take(frames[1])
        return bool(takers)

    def _watch(self) -> None:
        """Count refused connections; at each connection to the server, ask it to send us messages."""
        for _ in range(AT_ONCE):
            if not _has_some(self._monitor):
                break
            event = parse_monitor_message(self._monitor.recv_multipart())["event"]
            if event & _REFUSED:
                self.refused["key"] += 1
            elif self._hears and not self._serves:
                self._send([_HERE])

    def close(self) -> None:
        """Leave the bus, once all published messages are sent."""
        self._socket.disable_monitor()
        self._monitor.close(0)
        self._socket.close()
        self._gate.stop()
        self._context.term()

    def __enter__(self) -> "Bus":
        return self

    def __exit__(self, *error: object) -> None:
        self.close()
