"""The bus between the processes of a flight: messages on channels, by ZeroMQ over TCP, encrypted by CURVE.

One process serves a bus, which is the world, or the relay on the onboard half's side. All others join it. What one of
them publishes comes to the server, which hands it on to the rest.

Both ends know the key of key_file.py. From it come two pairs of CURVE keys, one of the server and one of all who
join: the secret keys are

    s_server = HMAC-SHA-256(key, "ortilo server"),  s_joins = HMAC-SHA-256(key, "ortilo joins")

The server admits nobody with other keys than these, and who joins talks to no other server. CURVE refuses what was
recorded, repeated or changed on the way.
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

LARGEST: Final = 2**24  # bytes of a message that whoever joins takes: a picture of the widest camera
QUEUE: Final = 1000  # messages that wait for one process; more are dropped
AT_ONCE: Final = 256  # messages that one call of handle takes at most
_FLUSH: Final = 1000  # how long a closed bus may take to send what was published [ms]
_RETRY: Final = 50  # between two attempts to join [ms]
_HANDSHAKE: Final = 2_000  # after which a connection that has not shown its key is closed [ms]
_CURVE: Final = 33  # bytes by which encryption lengthens a message
_ALIVE: Final = 1000, 5000  # between two signs of life, and how long to wait for one [ms]
_HERE: Final = b""  # a message that tells the server to send us the others'
_DOMAIN: Final = "ortilo"  # of the gate
_REFUSED: Final = (
    zmq.Event.HANDSHAKE_FAILED_NO_DETAIL | zmq.Event.HANDSHAKE_FAILED_PROTOCOL | zmq.Event.HANDSHAKE_FAILED_AUTH
)


def curve_keys(key: bytes, whose: str) -> tuple[bytes, bytes]:
    """Return the public and the secret CURVE key of the "server", or of whoever "joins", in Z85."""
    secret = z85.encode(hmac.digest(key, f"ortilo {whose}".encode(), "sha256"))
    return zmq.curve_public(secret), secret


def _has_some(socket: "zmq.Socket[bytes]") -> bool:
    return bool(int(socket.get(zmq.EVENTS)) & zmq.POLLIN)


class _Admits(NamedTuple):
    """Admits those who have a public key."""

    public: bytes

    def callback(self, domain: str, key: bytes) -> bool:
        return hmac.compare_digest(key, self.public)


class Bus:
    """One process's end of a bus at tcp://HOST:PORT. Not safe for use from several threads; only handle receives.

    All its processes share a key (32 bytes); one serves it, and who joins may not care to hear the others. A message of
    more than the largest number of bytes ends its connection: whoever connects can have as much memory taken up, before
    it has shown its key. Refused counts, under "key", connections with another key or of another kind and, under
    "frames", messages that are no channel and data. InputError if the URL is none, or it cannot be served.
    """

    def __init__(self, url: str, key: bytes, serves: bool = False, hears: bool = True, largest: int = LARGEST):
        self.url, self.refused = url, Counter[str]()
        self._serves, self._hears = serves, hears
        self._others: dict[bytes, None] = {}  # who joined, for the server
        self._takers: dict[str, list[Callable[[bytes], None]]] = {}
        self._context = zmq.Context()
        self._context.setsockopt(zmq.RCVHWM, 0)  # a full monitor would hold up ZeroMQ's thread
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
        self._socket.zap_domain, self._socket.zap_enforce_domain = _DOMAIN.encode(), True  # no gate, no way in
        self._socket.setsockopt(zmq.ROUTER_MANDATORY, 1)  # so that send says who has gone
        try:
            self._socket.bind(endpoint)
        except zmq.ZMQError as error:
            elsewhere = "no address of this machine; the world serves one of its own, or tcp://0.0.0.0:PORT"
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
        """Send a message. It is lost to whoever has not joined, or has QUEUE messages waiting.

        Who joins may publish before the server is there: the message is sent once it is.
        """
        self._send([channel.encode(), data])

    def _send(self, message: list[bytes], but: bytes = b"") -> None:
        for other in [other for other in self._others if other != but] if self._serves else [b""]:
            try:
                self._socket.send_multipart([other, *message] if self._serves else message, zmq.NOBLOCK)
            except zmq.Again:
                continue  # it has QUEUE messages waiting
            except zmq.ZMQError as error:
                if error.errno != errno.EHOSTUNREACH:
                    raise
                del self._others[other]

    def subscribe(self, channel: str, take: Callable[[bytes], None]) -> None:
        """Have a function called with each message on a channel."""
        self._takers.setdefault(channel, []).append(take)

    def unsubscribe(self, channel: str, take: Callable[[bytes], None]) -> None:
        """Have a function called no more."""
        self._takers[channel].remove(take)

    def handle(self, timeout_ms: int = 0) -> int:
        """Hand on the messages that have come on subscribed channels; return how many. Wait for the first so long."""
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
        """Take a message, and hand it on to the others; return whether somebody here listens to its channel."""
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
        """Count connections that were refused; tell the server, at each connection to it, that we are here."""
        for _ in range(AT_ONCE):
            if not _has_some(self._monitor):
                break
            event = parse_monitor_message(self._monitor.recv_multipart())["event"]
            if event & _REFUSED:
                self.refused["key"] += 1
            elif self._hears and not self._serves:
                self._send([_HERE])

    def close(self) -> None:
        """Leave the bus, once what was published is sent."""
        self._socket.disable_monitor()
        self._monitor.close(0)
        self._socket.close()
        self._gate.stop()
        self._context.term()

    def __enter__(self) -> "Bus":
        return self

    def __exit__(self, *error: object) -> None:
        self.close()
