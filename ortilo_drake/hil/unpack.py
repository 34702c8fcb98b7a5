"""Packets from any bytes, strictly: a packet of this flight, or BadPacket with a reason to count.

No decoder here raises anything else, and none allocates more than a few times the length of what it was given: lengths
are compared with the bytes that are there, and a picture's size with this flight's, before anything is unpacked.

    channel      no channel of ours
    length       too short, too long, or not as long as its own sizes say
    fingerprint  another LCM type, or another version of it
    crc          damaged
    foreign      another session's
    tick         negative
    value        not finite, absurdly large, a flag other than 0 or 1, or a label that is none
    stamp        before the flight or after its tick
    text         not UTF-8, too long, or not a word that may stand there
    picture      not a PNG of this flight's size and kind
"""

import struct
import zlib
from typing import Any, Final, NamedTuple

import numpy as np

from ortilo_drake.hil.lcmtypes.ortilo import (
    lcmt_command,
    lcmt_hello,
    lcmt_picture,
    lcmt_telemetry,
    lcmt_tick,
    lcmt_vector,
)
from ortilo_drake.hil.packets import MAX_TEXT, PORTS, TELEMETRY, Hello
from ortilo_drake.hil.picture_codec import decode_png
from ortilo_drake.model.signals import (
    ARRIVED,
    DETECTION_SIZE,
    DETECTIONS_SIZE,
    IMU_SIZE,
    N_U,
    PAYLOAD,
    SHUTTER_SIZE,
    STAMP,
    VELOCITY_SIZE,
    uwb_size,
)
from ortilo_drake.model.typed_yaml import LARGEST

TOLERANCE: Final = 1e-6  # [s] by which a stamp may pass its tick: rounding
MAX_LABEL: Final = 10_000
MAX_SESSION: Final = 2**63 - 1
_TURN: Final = 8 + 8 + 8  # fingerprint, session, tick
_CRC: Final = 8
_SIZE: Final = 4  # a size, or the length of a text
_PNG_MARGIN: Final = 65_536  # bytes by which a PNG may be longer than its pixels: noise does not compress


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
    """

    session: int
    h: float
    anchors: int
    shape: tuple[int, int] | None = None


class Packet(NamedTuple):
    """A packet that has passed every check.

    Attributes:
        name: of its channel, a key of CHANNELS.
        tick: the tick it belongs to; -1 for hello.
        value: a message vector; a picture (height, width, 4), uint8; for a tick the names of its ports; a command (4);
            telemetry as a dict from the names of TELEMETRY to vectors; a Hello.
        stamp: a picture's time [s]; 0 for the others (a message vector carries its own).
    """

    name: str
    tick: int
    value: Any
    stamp: float = 0.0


def _open(kind: Any, data: bytes, shortest: int, longest: int) -> Any:
    """Return the decoded LCM message after the checks of length, fingerprint and crc."""
    if not shortest <= len(data) <= longest:
        raise BadPacket("length")
    if data[:8] != kind._get_packed_fingerprint():
        raise BadPacket("fingerprint")
    if data[-_CRC:] != struct.pack(">q", zlib.crc32(data[:-_CRC])):
        raise BadPacket("crc")
    try:
        message = kind.decode(data)
    except (struct.error, ValueError, IndexError):
        raise BadPacket("length") from None
    return message


def _check_size(data: bytes, at: int, unit: int) -> None:
    """Refuse data whose rest is not what the size at an offset says, in units of so many bytes."""
    stated = int.from_bytes(data[at : at + _SIZE], "big", signed=True)
    if stated < 0 or at + _SIZE + unit * stated + _CRC != len(data):
        raise BadPacket("length")


def _check_turn(message: Any, flight: Flight | None) -> Flight:
    if flight is None or message.session != flight.session:
        raise BadPacket("foreign")
    if message.tick < 0:
        raise BadPacket("tick")
    return flight


def _check_stamp(stamp: float, tick: int, flight: Flight) -> None:
    if not 0.0 <= stamp <= tick * flight.h + TOLERANCE:
        raise BadPacket("stamp")


def _check_values(values: np.ndarray, flags: np.ndarray) -> None:
    if not (np.abs(values) <= LARGEST).all() or not ((flags == 0.0) | (flags == 1.0)).all():  # False for NaN
        raise BadPacket("value")


def _vector_size(name: str, anchors: int) -> int:
    sizes = {"imu": IMU_SIZE, "detections": DETECTIONS_SIZE, "shutter": SHUTTER_SIZE, "velocity": VELOCITY_SIZE}
    return uwb_size(anchors) if name == "uwb" else sizes[name]


def _decode_vector(name: str, data: bytes, flight: Flight | None) -> Packet:
    longest = DETECTIONS_SIZE if flight is None else _vector_size(name, flight.anchors)
    shortest = 0 if flight is None else longest
    _check_size(data, _TURN, 8)
    message = _open(lcmt_vector, data, _TURN + _SIZE + 8 * shortest + _CRC, _TURN + _SIZE + 8 * longest + _CRC)
    flight = _check_turn(message, flight)
    values = np.array(message.values)
    flags = values[[ARRIVED]]
    if name == "uwb":
        flags = np.concatenate((flags, values[PAYLOAD + flight.anchors :]))
    _check_values(values, flags)
    if name == "detections":  # labels become indices, which compiled code does not check
        labels = values[PAYLOAD::DETECTION_SIZE]
        if not ((labels == np.floor(labels)) & (labels >= -1.0) & (labels <= MAX_LABEL)).all():
            raise BadPacket("value")
    _check_stamp(float(values[STAMP]), message.tick, flight)
    return Packet(name, message.tick, values)


def _decode_picture(name: str, data: bytes, flight: Flight | None) -> Packet:
    pixels = 0 if flight is None or flight.shape is None else flight.shape[0] * flight.shape[1]
    start = _TURN + 8 + _SIZE
    _check_size(data, _TURN + 8, 1)
    message = _open(lcmt_picture, data, start + _CRC, start + 8 * pixels + _PNG_MARGIN + _CRC)
    flight = _check_turn(message, flight)
    _check_stamp(message.stamp, message.tick, flight)
    image = None if flight.shape is None else decode_png(message.data, flight.shape)
    if image is None:
        raise BadPacket("picture")
    return Packet(name, message.tick, image, message.stamp)


def _check_canonical(message: Any, data: bytes) -> None:
    """Refuse texts that are not UTF-8 or lack their end, booleans beyond 1, and bytes left over."""
    if message.encode()[:-_CRC] != data[:-_CRC]:
        raise BadPacket("text")


def _decode_tick(name: str, data: bytes, flight: Flight | None) -> Packet:
    longest = _TURN + _SIZE + sum(_SIZE + len(port) + 1 for port in PORTS) + _CRC
    message = _open(lcmt_tick, data, _TURN + _SIZE + _CRC, longest)
    _check_canonical(message, data)
    _check_turn(message, flight)
    if len(set(message.sent)) != len(message.sent) or not set(message.sent) <= set(PORTS):
        raise BadPacket("text")
    return Packet(name, message.tick, tuple(message.sent))


def _decode_command(name: str, data: bytes, flight: Flight | None) -> Packet:
    length = _TURN + 8 * N_U + _CRC
    message = _open(lcmt_command, data, length, length)
    _check_turn(message, flight)
    u = np.array(message.u)
    _check_values(u, u[:0])
    return Packet(name, message.tick, u)


def _decode_telemetry(name: str, data: bytes, flight: Flight | None) -> Packet:
    length = _TURN + 8 * sum(TELEMETRY.values()) + _CRC
    message = _open(lcmt_telemetry, data, length, length)
    _check_turn(message, flight)
    outputs = {key: np.array(getattr(message, key)) for key in TELEMETRY}
    if not all(np.isfinite(values).all() for values in outputs.values()):
        raise BadPacket("value")
    return Packet(name, message.tick, outputs)


def _decode_hello(name: str, data: bytes, flight: Flight | None) -> Packet:
    shortest = 8 + 4 + 3 * (_SIZE + 1) + 8 + 1 + _CRC
    message = _open(lcmt_hello, data, shortest, shortest + 3 * MAX_TEXT)
    _check_canonical(message, data)
    texts = (message.role, message.scenario_digest, message.reason)
    if message.role not in ("world", "onboard") or max(len(text.encode()) for text in texts) > MAX_TEXT:
        raise BadPacket("text")
    if message.session < 0:
        raise BadPacket("foreign")
    return Packet(name, -1, Hello(**{field: getattr(message, field) for field in Hello._fields}))


_OTHERS: Final = {
    "image": _decode_picture,
    "tick": _decode_tick,
    "command": _decode_command,
    "telemetry": _decode_telemetry,
    "hello": _decode_hello,
}


def decode(name: str, data: bytes, flight: Flight | None) -> Packet:
    """Return the packet that bytes on a channel are.

    Args:
        name: of the channel, a key of CHANNELS.
        data: any bytes.
        flight: what is known of the flight; without it only a hello can pass.

    Raises:
        BadPacket: if they are no packet of this flight.
    """
    if name in _OTHERS:
        return _OTHERS[name](name, data, flight)
    if name in PORTS:
        return _decode_vector(name, data, flight)
    raise BadPacket("channel")
