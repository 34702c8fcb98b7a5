"""Decoding of packets from untrusted bytes: a packet of this flight, or BadPacket with a reason.

No decoder here raises any other exception, and none allocates more than a few times the length of its input: lengths
are compared with the bytes that are there, and the size of a picture with that of this flight, before unpacking.

channel      not one of our channels
length       too short, too long, or not as long as the sizes in the packet say
fingerprint  another LCM type, or another version of the type
foreign      of another session
tick         negative, or beyond the longest flight
value        beyond the limits of this flight's sensors, rotors and room, or an unknown label
stamp        before the flight, after its tick, or older than the link's longest delay
text         not UTF-8, too long, or not an allowed word
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
from ortilo_drake.interop.ros.picture_codec import decode_foreign_png
from ortilo_drake.model.signals import ARRIVED, N_U, STAMP, samples_in

TOLERANCE: Final = 1e-6  # time by which a stamp may exceed its tick, for rounding [s]
LONGEST: Final = 1e6  # longest flight [s]
COUNT_SIZE: Final = 4  # length of an array's size or a text's length [bytes]


class BadPacket(Exception):
    """The error for bytes that are no packet of this flight; `reason` is one of the words above."""

    def __init__(self, reason: str):
        super().__init__(reason)
        self.reason = reason


class Flight(NamedTuple):
    """The properties of a flight against which its packets are checked.

    `session` is the number of the flight, above 0; `h` is the length of a tick [s]; `shape` is height and width of
    pictures [px], None if there are none; `limits` are the limits of every signal, see limits.py.
    """

    session: int
    h: float
    shape: tuple[int, int] | None
    limits: dict[str, Limits]


def open_message(kind: LcmType, data: bytes, sizes: tuple[int, int], session: int | None) -> SimpleNamespace:
    """Return the decoded message after checks of its length (least, greatest), fingerprint and session.

    `session` is None for a type whose first field is not the session.
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
    """Refuse data whose length differs from the size stated at the offset `at`, in units of `unit` bytes."""
    stated = int.from_bytes(data[at : at + COUNT_SIZE], "big", signed=True)
    if stated < 0 or at + COUNT_SIZE + unit * stated != len(data):
        raise BadPacket("length")


def check_stamp(stamp: float, tick: int, limits: Limits, flight: Flight) -> None:
    """Refuse a stamp [s] before the flight, after its tick, or older than the longest delay of the signal's link."""
    if not max(0.0, (tick - limits.oldest) * flight.h - TOLERANCE) <= stamp <= tick * flight.h + TOLERANCE:
        raise BadPacket("stamp")


def check_samples(values: np.ndarray, tick: int, limits: Limits, flight: Flight) -> None:
    """Refuse samples whose stamps do not ascend to the message's stamp, or are more than a tick older than allowed."""
    there = samples_in(values, limits.samples)
    stamps = there[there[:, ARRIVED] > 0.0, STAMP]
    if len(stamps) == 0:
        return
    check_stamp(float(stamps[0]), tick, limits._replace(oldest=limits.oldest + 1), flight)
    if (np.diff(stamps) <= 0.0).any() or stamps[-1] != values[STAMP]:
        raise BadPacket("stamp")


def check_values(values: np.ndarray, limits: Limits) -> None:
    """Refuse values beyond their limits, and fractions in place of whole numbers."""
    whole = values[limits.whole]
    within = ((limits.low <= values) & (values <= limits.high)).all()  # False for NaN
    if not within or (whole != np.floor(whole)).any():
        raise BadPacket("value")


def check_canonical(kind: LcmType, message: SimpleNamespace, data: bytes) -> None:
    """Refuse texts that are not UTF-8 or lack their final 0, booleans above 1, and surplus bytes."""
    if kind.encode(**vars(message)) != data:
        raise BadPacket("text")


def check_texts(role: str, roles: tuple[str, ...], *others: str) -> None:
    """Refuse an unknown role, and texts longer than MAX_TEXT."""
    if role not in roles or any(len(text.encode()) > MAX_TEXT for text in others):
        raise BadPacket("text")


def plain(text: str) -> str:
    """Return a text with U+FFFD in place of each character that str.isprintable refuses.

    These are the control characters of C0 and C1 (with ESC), characters that change the direction of writing or are
    invisible, line and paragraph separators, surrogates, and characters that Unicode has not assigned.
    """
    return "".join(character if character.isprintable() else "\ufffd" for character in text)


_TURN: Final = 8 + 8 + 8  # fingerprint, session, tick
_GOAL_SIZES: Final = (_TURN + 8 + 2 * (COUNT_SIZE + 1) + 8 * 2, _TURN + 8 + 2 * (COUNT_SIZE + 1) + 8 * 2 + 2 * MAX_TEXT)
_HELLO_LEAST: Final = 8 + 4 + 3 * (COUNT_SIZE + 1) + 8 + 1 + 2 * 8
_HELLO_SIZES: Final = (_HELLO_LEAST, _HELLO_LEAST + 3 * MAX_TEXT)
_DIGEST: Final = re.compile(r"[0-9a-f]{16}")
_PICTURE_HEAD: Final = _TURN + 8 + COUNT_SIZE
_TELEMETRY_HEAD: Final = _TURN + 8 * sum(TELEMETRY.values())
_PNG_MARGIN: Final = 65_536  # a PNG may be longer than its pixels by this, for noise does not compress [bytes]


class Packet(NamedTuple):
    """A packet that has passed every check; `name` is its channel's, one of packets.KINDS or a sensor.

    `tick` is -1 for the kinds NO_TICK, `stamp` the stamp of a picture [s], else 0. `value` is, by kind: a message
    vector; a picture (height, width, 4), uint8; the names of a tick's ports; a command u (4); telemetry as a dict from
    the names of MEASUREMENT and TELEMETRY to vectors; a Hello; a Goal.
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
    """Return the size of the largest packet that the world receives in a flight: a picture or telemetry [bytes]."""
    return max(_longest_picture(flight), _telemetry_length(flight))


def _of_a_tick(kind: LcmType, data: bytes, sizes: tuple[int, int], flight: Flight) -> SimpleNamespace:
    """Return a message of this flight, as open_message; refuse a tick that is negative or beyond the longest flight."""
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
        no_fix = (key == "y") & np.isnan(values)  # an estimator that makes no fixes gives NaN for them
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
    """Return the packet in bytes from the channel `name`, one of packets.KINDS or a sensor.

    Without a flight only a hello can pass. BadPacket if the bytes are no packet of this flight.
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
