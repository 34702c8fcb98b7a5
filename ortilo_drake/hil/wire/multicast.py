"""Datagrams to and from a UDP multicast group: with ttl 0 on the loopback interface alone.

With ttl 0 nothing needs a route, and nothing from another machine is heard: the group is joined on the loopback
interface only, and what does not come from this machine is dropped. With a ttl the group is where the route to it is.
"""

import select
import socket
import sys
from functools import lru_cache
from typing import Final
from urllib.parse import parse_qs, urlsplit

from ortilo_drake.hil.wire.udpm import Sender
from ortilo_drake.model.inputs.numbers import whole
from ortilo_drake.model.typed_yaml import InputError

MEND: Final = "ip link set lo up"
MEND_NETWORK: Final = "ip route add 224.0.0.0/4 dev INTERFACE, the one to the other machine"
RECEIVE_BUFFER: Final = 2**21  # [bytes], several pictures
AT_ONCE: Final = 256  # datagrams that one call of receive takes at most
_LOOPBACK: Final = "127.0.0.1"
_IP_MULTICAST_ALL: Final = 49  # linux/in.h; Python's socket does not name it
_LARGEST: Final = 65_536


def address(url: str) -> tuple[str, int, dict[str, int]]:
    """Return group, port and options of a udpm URL; InputError if LCM would not understand it."""
    allowed = "is not of the form udpm://GROUP:PORT?ttl=N, with GROUP in 224.0.0.0 to 239.255.255.255"
    try:
        parts = urlsplit(url)
        group, port = parts.hostname or "", parts.port or 0
        is_group = 224 <= socket.inet_pton(socket.AF_INET, group)[0] <= 239
        options = {
            key: whole(values[-1]) for key, values in parse_qs(parts.query, strict_parsing=bool(parts.query)).items()
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


def leaves_machine(url: str) -> bool:
    """Return whether packets on a bus may go to other machines, and come from them."""
    return url.startswith("udpm:") and address(url)[2].get("ttl", 0) > 0


@lru_cache(maxsize=64)
def is_local(host: str) -> bool:
    """Return whether an IPv4 address is one of this machine's: whether a socket can be bound to it."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind((host, 0))
        except OSError:
            return False
    return True


class Multicast:
    """Two sockets: one that sends to a group, and one that hears it.

    Args:
        group: IPv4 address of the group.
        port: UDP port.
        ttl: 0 for this machine alone, 1 for its network as well, more beyond.
        buffer: how much the system is asked to keep until it is received [bytes].

    Raises:
        OSError: if the group cannot be joined.
    """

    def __init__(self, group: str, port: int, ttl: int = 0, buffer: int = RECEIVE_BUFFER):
        self._to, self._anyone = (group, port), ttl > 0
        self._in, self._out = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
        interface = socket.inet_aton("0.0.0.0" if self._anyone else _LOOPBACK)  # 0.0.0.0: by the route
        try:
            self._in.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            if sys.platform == "linux":  # else it hears the group wherever another process joined it
                self._in.setsockopt(socket.IPPROTO_IP, _IP_MULTICAST_ALL, 0)
            else:
                self._in.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
            self._in.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, buffer)
            self._in.bind(self._to)  # not every address: what is sent to this machine by its own name is not heard
            self._in.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, socket.inet_aton(group) + interface)
            self._in.setblocking(False)
            self._out.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, ttl)
            self._out.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_LOOP, 1)
            if not self._anyone:
                self._out.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, interface)
        except OSError:
            self.close()
            raise
        self._poll = select.poll()
        self._poll.register(self._in, select.POLLIN)
        self.foreign = 0

    def send(self, datagram: bytes) -> None:
        """Send a datagram; OSError where it cannot be."""
        self._out.sendto(datagram, self._to)

    def receive(self) -> list[tuple[Sender, bytes]]:
        """Return the datagrams that have come, at most AT_ONCE, with their senders; do not wait."""
        came: list[tuple[Sender, bytes]] = []
        for _ in range(AT_ONCE):
            try:
                datagram, sender = self._in.recvfrom(_LARGEST)
            except OSError:  # none is left
                break
            if self._anyone or sender[0] == _LOOPBACK or is_local(sender[0]):
                came.append((sender, datagram))
            else:
                self.foreign += 1
        return came

    def wait(self, milliseconds: int) -> bool:
        """Wait for a datagram; return whether there is one."""
        return bool(self._poll.poll(milliseconds))

    def close(self) -> None:
        """Close the sockets."""
        self._in.close()
        self._out.close()
