"""Checks that every packet must pass, whatever its kind: a packet that fails raises BadPacket with a reason.

channel      no channel of ours
length       too short, too long, or not as long as its own sizes say
fingerprint  another LCM type, or another version of it
foreign      another session's
tick         negative, or beyond the longest flight
value        beyond what this flight's sensors, rotors and room can give, or an unknown label
stamp        before the flight, after its tick, or older than its link holds back
text         not UTF-8, too long, or not a word that may stand there
picture      not a PNG of this flight's size and kind
"""

import struct
from types import SimpleNamespace
from typing import Final, NamedTuple

import numpy as np

from ortilo_drake.hil.wire.lcm_type import LcmType
from ortilo_drake.hil.wire.limits import Limits
from ortilo_drake.hil.wire.packets import MAX_TEXT
from ortilo_drake.model.signals import ARRIVED, STAMP, samples_in

TOLERANCE: Final = 1e-6  # [s] by which a stamp may pass its tick: rounding
LONGEST: Final = 1e6  # flight [s]
COUNT_SIZE: Final = 4  # bytes of a size, or of the length of a text


class BadPacket(Exception):
    """Bytes that are no packet of this flight; `reason` is one of the words above."""

    def __init__(self, reason: str):
        super().__init__(reason)
        self.reason = reason


class Flight(NamedTuple):
    """A flight as its packets are checked against it.

    It has a number, the session, above 0, and ticks of h [s]. Pictures have a shape, height and width [px], None where
    none is sent, every signal has limits, see limits.py.
    """

    session: int
    h: float
    shape: tuple[int, int] | None
    limits: dict[str, Limits]


def open_message(kind: LcmType, data: bytes, sizes: tuple[int, int], session: int | None) -> SimpleNamespace:
    """Return the decoded message after the checks of length, least and greatest, fingerprint and session.

    The session is None for a type in which it is not the first field.
    """
    if not sizes[0] <= len(data) <= sizes[1]:
        raise BadPacket("length")
    if data[:8] != kind.fingerprint:
        raise BadPacket("fingerprint")
    if session is not None and data[8:16] != session.to_bytes(8, "big"):
        raise BadPacket("foreign")
    try:
        return kind.decode(data)
    except struct.error:
        raise BadPacket("length") from None


def check_size(data: bytes, at: int, unit: int) -> None:
    """Refuse data whose length differs from the size given at an offset, in units of that many bytes."""
    stated = int.from_bytes(data[at : at + COUNT_SIZE], "big", signed=True)
    if stated < 0 or at + COUNT_SIZE + unit * stated != len(data):
        raise BadPacket("length")


def check_tick(tick: int, flight: Flight) -> None:
    """Refuse a tick that is negative, or beyond the longest flight."""
    if not 0 <= tick <= LONGEST / flight.h:
        raise BadPacket("tick")


def check_stamp(stamp: float, tick: int, limits: Limits, flight: Flight) -> None:
    """Refuse a stamp [s] from before the flight, after its tick, or older than the signal's link can delay it."""
    if not max(0.0, (tick - limits.oldest) * flight.h - TOLERANCE) <= stamp <= tick * flight.h + TOLERANCE:
        raise BadPacket("stamp")


def check_samples(values: np.ndarray, tick: int, limits: Limits, flight: Flight) -> None:
    """Refuse samples whose stamps do not ascend to the message's own, or that are older than a tick before it."""
    there = samples_in(values, limits.samples)
    stamps = there[there[:, ARRIVED] > 0.0, STAMP]
    if len(stamps) == 0:
        return
    check_stamp(float(stamps[0]), tick, limits._replace(oldest=limits.oldest + 1), flight)
    if (np.diff(stamps) <= 0.0).any() or stamps[-1] != values[STAMP]:
        raise BadPacket("stamp")


def check_values(values: np.ndarray, limits: Limits) -> None:
    """Refuse values out of their limits, and fractions where there must be whole numbers."""
    whole = values[limits.whole]
    within = ((limits.low <= values) & (values <= limits.high)).all()  # False for NaN
    if not within or (whole != np.floor(whole)).any():
        raise BadPacket("value")


def check_canonical(kind: LcmType, message: SimpleNamespace, data: bytes) -> None:
    """Refuse texts that are not UTF-8 or lack their end, booleans beyond 1, and bytes left over."""
    if kind.encode(**vars(message)) != data:
        raise BadPacket("text")


def check_texts(role: str, roles: tuple[str, ...], *others: str) -> None:
    """Refuse an unknown role, and texts that are too long."""
    if role not in roles or any(len(text.encode()) > MAX_TEXT for text in others):
        raise BadPacket("text")
