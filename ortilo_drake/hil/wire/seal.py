"""The seal of a packet: an HMAC-SHA-256 (RFC 2104) of its channel and all bytes before it, at its end.

The key of a hello is made from the file's key (key_file.py), that of all else from it, the session's number, which the
world draws, and the nonce of the onboard half that it met:

    k_hello  = HMAC(k, "ortilo hello")
    k_flight = HMAC(k, "ortilo flight" 0 session nonce digest)

So packets of another flight are of no use. The channel is in the tag and says which half speaks on it, hellos and goals
state their role: so one half's packet is none of the other's. What was there already is inbox.py's affair.
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
        nonce: which the onboard half drew.
        digest: of the scenario.
    """
    return hmac.digest(key, b"ortilo flight\0" + struct.pack(">qq", session, nonce) + digest.encode(), "sha256")
