"""The address of a bus: tcp://HOST:PORT."""

import ipaddress
import socket
from typing import NamedTuple
from urllib.parse import urlsplit

from ortilo_drake.model.typed_yaml import InputError

IPAddress = ipaddress.IPv4Address | ipaddress.IPv6Address


class Address(NamedTuple):
    """The IP address of a host, and a TCP port."""

    host: IPAddress
    port: int

    def endpoint(self, serves: bool) -> str:
        """Return the ZeroMQ endpoint; a process joins a server on all interfaces (0.0.0.0) through loopback."""
        host = self.host
        if host.is_unspecified and not serves:
            host = ipaddress.ip_address("127.0.0.1" if host.version == 4 else "::1")
        return f"tcp://[{host}]:{self.port}" if host.version == 6 else f"tcp://{host}:{self.port}"


def address(url: str) -> Address:
    """Return the address that a URL names; for a host name the first IPv4 address, or the first of any kind.

    InputError if the URL is not of the form tcp://HOST:PORT, or its host is unknown.
    """
    allowed = f"url: {url!r} is not of the form tcp://HOST:PORT, with PORT from 1 to 65535"
    try:
        parts = urlsplit(url)
        host, port = parts.hostname, parts.port
    except ValueError:
        raise InputError(allowed) from None
    # getaddrinfo would take the host * for all interfaces.
    if url != f"tcp://{parts.netloc}" or not host or not port or "@" in parts.netloc or host == "*":
        raise InputError(allowed)
    if "%" in host:
        raise InputError(f"url: {url!r}: host {host!r} names an interface (%); give the host's name or another address")
    try:
        found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
    except (OSError, UnicodeError):
        raise InputError(f"url: {url!r}: no host {host!r} is known") from None
    first = min(found, key=lambda each: each[0] != socket.AF_INET)  # a server on 0.0.0.0 does not serve IPv6
    return Address(ipaddress.ip_address(first[4][0]), port)


def leaves_machine(url: str) -> bool:
    """Return whether other machines can take part in the bus at a URL."""
    return not address(url).host.is_loopback
