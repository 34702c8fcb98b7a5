"""What every packet must pass, whatever its kind: BadPacket with a reason to count, or nothing.

channel      no channel of ours
length       too short, too long, or not as long as its own sizes say
fingerprint  another LCM type, or another version of it
crc          damaged
foreign      another session's
tick         negative
value        not finite, absurdly large, a number out of its range, or a label that is none
stamp        before the flight or after its tick
text         not UTF-8, too long, or not a word that may stand there
picture      not a PNG of this flight's size and kind
"""

import struct
import zlib
from typing import Any, Final, NamedTuple

import numpy as np

from ortilo_drake.hil.packets import MAX_TEXT
from ortilo_drake.model.typed_yaml import LARGEST

TOLERANCE: Final = 1e-6  # [s] by which a stamp may pass its tick: rounding
CRC_SIZE: Final = 8
COUNT_SIZE: Final = 4  # of a size, or of the length of a text


class BadPacket(Exception):
    """Bytes that are no packet of this flight; `reason` is one of the words above."""

    def __init__(self, reason: str):
        super().__init__(reason)
        self.reason = reason


class Flight(NamedTuple):
    """What a receiver knows of a flight before any packet of it.

    Attributes:
        session: the number of the flight, positive.
        h: the ticks' period [s].
        anchors: number of UWB anchors.
        shape: height and width of a picture [px]; None where none is sent.
        classes: how many classes of landmarks a detection may name.
    """

    session: int
    h: float
    anchors: int
    shape: tuple[int, int] | None = None
    classes: int = 0


def open_message(kind: Any, data: bytes, shortest: int, longest: int) -> Any:
    """Return the decoded LCM message after the checks of length, fingerprint and crc."""
    if not shortest <= len(data) <= longest:
        raise BadPacket("length")
    if data[:8] != kind._get_packed_fingerprint():
        raise BadPacket("fingerprint")
    if data[-CRC_SIZE:] != struct.pack(">q", zlib.crc32(data[:-CRC_SIZE])):
        raise BadPacket("crc")
    try:
        message = kind.decode(data)
    except (struct.error, ValueError, IndexError):
        raise BadPacket("length") from None
    return message


def check_size(data: bytes, at: int, unit: int) -> None:
    """Refuse data whose rest is not what the size at an offset says, in units of so many bytes."""
    stated = int.from_bytes(data[at : at + COUNT_SIZE], "big", signed=True)
    if stated < 0 or at + COUNT_SIZE + unit * stated + CRC_SIZE != len(data):
        raise BadPacket("length")


def check_session(message: Any, flight: Flight | None) -> Flight:
    """Refuse a message of another flight, or any while none is known."""
    if flight is None or message.session != flight.session:
        raise BadPacket("foreign")
    return flight


def check_turn(message: Any, flight: Flight | None) -> Flight:
    """Refuse a message of another flight, or of no tick of this one."""
    flight = check_session(message, flight)
    if message.tick < 0:
        raise BadPacket("tick")
    return flight


def check_stamp(stamp: float, tick: int, flight: Flight) -> None:
    """Refuse a stamp [s] from before the flight or after its tick."""
    if not 0.0 <= stamp <= tick * flight.h + TOLERANCE:
        raise BadPacket("stamp")


def check_values(values: np.ndarray, flags: np.ndarray) -> None:
    """Refuse values that are not finite or absurdly large, and flags that are neither 0 nor 1."""
    if not (np.abs(values) <= LARGEST).all() or not ((flags == 0.0) | (flags == 1.0)).all():  # False for NaN
        raise BadPacket("value")


def check_canonical(message: Any, data: bytes) -> None:
    """Refuse texts that are not UTF-8 or lack their end, booleans beyond 1, and bytes left over."""
    if message.encode()[:-CRC_SIZE] != data[:-CRC_SIZE]:
        raise BadPacket("text")


def check_texts(role: str, roles: tuple[str, str], *others: str) -> None:
    """Refuse a role that is none, and texts that are too long."""
    if role not in roles or any(len(text.encode()) > MAX_TEXT for text in others):
        raise BadPacket("text")
