"""Decoding of packets from untrusted bytes: a packet of this flight, or BadPacket with a reason.

No decoder here raises anything else, and none allocates more than a few times the length of what it was given: lengths
are compared with the bytes that are there, and a picture's size with this flight's, before anything is unpacked.

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

import re
import struct
from types import SimpleNamespace
from typing import Any, Final, NamedTuple

import numpy as np

from ortilo_drake.hil.wire.lcm_type import LcmType
from ortilo_drake.hil.wire.limits import Limits
from ortilo_drake.hil.wire.packets import (
    COMMAND,
    GOAL,
    HELLO,
    MAX_TEXT,
    MEASUREMENT,
    PICTURE,
    ROLES,
    STATES,
    TELEMETRY,
    TELEMETRY_TYPE,
    TICK,
    VECTOR,
    Goal,
    Hello,
    ports,
)
from ortilo_drake.hil.wire.plain_text import plain
from ortilo_drake.interop.ros.picture_codec import decode_foreign_png
from ortilo_drake.model.signals import ARRIVED, N_U, STAMP, samples_in

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


_TURN: Final = 8 + 8 + 8  # fingerprint, session, tick
_GOAL_SIZES: Final = (_TURN + 8 + 2 * (COUNT_SIZE + 1) + 8 * 2, _TURN + 8 + 2 * (COUNT_SIZE + 1) + 8 * 2 + 2 * MAX_TEXT)
_HELLO_LEAST: Final = 8 + 4 + 3 * (COUNT_SIZE + 1) + 8 + 1 + 2 * 8
_HELLO_SIZES: Final = (_HELLO_LEAST, _HELLO_LEAST + 3 * MAX_TEXT)
_DIGEST: Final = re.compile(r"[0-9a-f]{16}")
_PICTURE_HEAD: Final = _TURN + 8 + COUNT_SIZE
_TELEMETRY_HEAD: Final = _TURN + 8 * sum(TELEMETRY.values())
_PNG_MARGIN: Final = 65_536  # bytes by which a PNG may be longer than its pixels: noise does not compress


class Packet(NamedTuple):
    """A packet that has passed every check, by the name of its channel, of packets.KINDS or a sensor.

    Its tick is -1 for one of NO_TICK, its stamp 0 unless it is a picture's [s]. Its value is a message vector; a
    picture (height, width, 4), uint8; for a tick the names of its ports; a command (4); telemetry as a dict from the
    names of MEASUREMENT and TELEMETRY to vectors; a Hello; a Goal.
    """

    name: str
    tick: int
    value: Any
    stamp: float = 0.0


def _longest_picture(flight: Flight) -> int:
    pixels = 0 if flight.shape is None else flight.shape[0] * flight.shape[1]
    return _PICTURE_HEAD + 8 * pixels + _PNG_MARGIN


def _telemetry_length(flight: Flight) -> int:
    return _TELEMETRY_HEAD + COUNT_SIZE + 8 * sum(flight.limits[key].low.size for key in MEASUREMENT)


def largest_to_world(flight: Flight) -> int:
    """Return the most bytes that a packet of a flight has of those that come to the world: a picture, or telemetry."""
    return max(_longest_picture(flight), _telemetry_length(flight))


def _of_a_tick(kind: LcmType, data: bytes, sizes: tuple[int, int], flight: Flight) -> SimpleNamespace:
    """Return a message of this flight, as open_message, whose tick is not negative or beyond the longest flight."""
    message = open_message(kind, data, sizes, flight.session)
    if not 0 <= message.tick <= LONGEST / flight.h:
        raise BadPacket("tick")
    return message


def _decode_vector(name: str, data: bytes, flight: Flight) -> Packet:
    limits = flight.limits[name]
    check_size(data, _TURN, 8)
    length = _TURN + COUNT_SIZE + 8 * limits.low.size
    message = _of_a_tick(VECTOR, data, (length, length), flight)
    values = np.array(message.values)
    check_values(values, limits)
    check_stamp(float(values[STAMP]), message.tick, limits, flight)
    if limits.samples:
        check_samples(values, message.tick, limits, flight)
    return Packet(name, message.tick, values)


def _decode_picture(name: str, data: bytes, flight: Flight) -> Packet:
    check_size(data, _PICTURE_HEAD - COUNT_SIZE, 1)
    message = _of_a_tick(PICTURE, data, (_PICTURE_HEAD, _longest_picture(flight)), flight)
    check_stamp(message.stamp, message.tick, flight.limits[name], flight)
    image = None if flight.shape is None else decode_foreign_png(message.data, flight.shape)
    if image is None:
        raise BadPacket("picture")
    return Packet(name, message.tick, image, message.stamp)


def _decode_tick(name: str, data: bytes, flight: Flight) -> Packet:
    longest = _TURN + COUNT_SIZE + sum(COUNT_SIZE + len(port) + 1 for port in ports())
    message = _of_a_tick(TICK, data, (_TURN + COUNT_SIZE, longest), flight)
    check_canonical(TICK, message, data)
    if len(set(message.sent)) != len(message.sent) or not set(message.sent) <= set(ports()):
        raise BadPacket("text")
    return Packet(name, message.tick, tuple(message.sent))


def _decode_command(name: str, data: bytes, flight: Flight) -> Packet:
    length = _TURN + 8 * N_U
    message = _of_a_tick(COMMAND, data, (length, length), flight)
    u = np.array(message.u)
    check_values(u, flight.limits[name])
    return Packet(name, message.tick, u)


def _decode_telemetry(name: str, data: bytes, flight: Flight) -> Packet:
    sizes = [flight.limits[key].low.size for key in MEASUREMENT]
    check_size(data, _TELEMETRY_HEAD, 8)
    length = _telemetry_length(flight)
    message = _of_a_tick(TELEMETRY_TYPE, data, (length, length), flight)
    outputs = {key: np.array(getattr(message, key)) for key in TELEMETRY}
    parts = np.split(np.array(message.measurement), np.cumsum(sizes)[:-1])
    outputs |= dict(zip(MEASUREMENT, parts, strict=True))
    for key, values in outputs.items():
        no_fix = (key == "y") & np.isnan(values)  # an estimator that makes no fixes says NaN of them
        check_values(np.where(no_fix, 0.0, values), flight.limits[key])
    return Packet(name, message.tick, outputs)


def _decode_goal(name: str, data: bytes, flight: Flight) -> Packet:
    message = _of_a_tick(GOAL, data, _GOAL_SIZES, flight)
    x, y = message.p_W
    check_values(np.array([x, y]), flight.limits[name])
    if message.number <= 0:
        raise BadPacket("value")
    check_canonical(GOAL, message, data)
    check_texts(message.role, ("user", "onboard"), message.reason)
    goal = Goal(flight.session, message.tick, message.number, message.role, x, y, plain(message.reason))
    return Packet(name, -1, goal)


def _decode_hello(data: bytes) -> Packet:
    message = open_message(HELLO, data, _HELLO_SIZES, None)
    check_canonical(HELLO, message, data)
    check_texts(message.role, ROLES)
    if message.state not in STATES or not _DIGEST.fullmatch(message.scenario_digest):
        raise BadPacket("text")
    if message.session <= 0:
        raise BadPacket("foreign")
    if message.tick < -1:
        raise BadPacket("value")
    return Packet("hello", -1, Hello(**{field: getattr(message, field) for field in Hello._fields}))


_OTHERS: Final = {
    "image": _decode_picture,
    "tick": _decode_tick,
    "command": _decode_command,
    "telemetry": _decode_telemetry,
    "goal": _decode_goal,
}


def decode(name: str, data: bytes, flight: Flight | None) -> Packet:
    """Return the packet that bytes on the channel of a name are, of packets.KINDS or a sensor.

    Without a flight only a hello can pass. BadPacket if they are no packet of this flight.
    """
    if name == "hello":
        return _decode_hello(data)
    if name not in _OTHERS and name not in ports():
        raise BadPacket("channel")
    if flight is None:
        raise BadPacket("foreign")
    if name in ports() and name not in flight.limits:
        raise BadPacket("channel")
    return _OTHERS.get(name, _decode_vector)(name, data, flight)
