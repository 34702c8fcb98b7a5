"""The seal of a packet: an HMAC-SHA-256 (RFC 2104) of its channel and all bytes before it, at its end.

The key of hellos is made from the file's key k (key_file.py). The key of all other packets is made from k, the number
of the session, which the world draws, and the nonce of the onboard half that it met:

    k_hello  = HMAC(k, "ortilo hello")
    k_flight = HMAC(k, "ortilo flight" 0 session nonce digest)

So packets of another flight are refused. The tag covers the channel, which says which half speaks; hellos and goals
state their role: so one half's packet cannot pass for the other's. inbox.py refuses repeated packets.
"""

import hmac
import struct
from typing import Final

KEY_SIZE: Final = 32
MAC_SIZE: Final = 32


def mac(key: bytes, name: str, body: bytes) -> bytes:
    """Return the tag (MAC_SIZE) of a body on a channel."""
    return hmac.digest(key, name.encode() + b"\0" + body, "sha256")


def seal(key: bytes, name: str, body: bytes) -> bytes:
    """Return the packet of a body on a channel, a key of packets.ports or packets.KINDS."""
    return body + mac(key, name, body)


def is_sealed(key: bytes, name: str, data: bytes) -> bool:
    """Return whether a packet was sealed with a key for a channel."""
    return hmac.compare_digest(data[-MAC_SIZE:], mac(key, name, data[:-MAC_SIZE]))


def hello_key(key: bytes) -> bytes:
    """Return the key of hellos from the file's."""
    return hmac.digest(key, b"ortilo hello", "sha256")


def flight_key(key: bytes, session: int, nonce: int, digest: str) -> bytes:
    """Return the key of a flight.

    Args:
        key: the file's.
        session: the flight's number, which the world drew.
        nonce: the nonce that the onboard half drew.
        digest: the digest of the scenario.
    """
    return hmac.digest(key, b"ortilo flight\0" + struct.pack(">qq", session, nonce) + digest.encode(), "sha256")
