"""Decoding of packets from untrusted bytes: a packet of this flight, or BadPacket with a reason of packet_checks.py.

No decoder here raises anything else, and none allocates more than a few times the length of what it was given: lengths
are compared with the bytes that are there, and a picture's size with this flight's, before anything is unpacked.
"""

import re
from types import SimpleNamespace
from typing import Any, Final, NamedTuple

import numpy as np

from ortilo_drake.hil.wire.lcm_type import LcmType
from ortilo_drake.hil.wire.packet_checks import (
    COUNT_SIZE,
    BadPacket,
    Flight,
    check_canonical,
    check_samples,
    check_size,
    check_stamp,
    check_texts,
    check_tick,
    check_values,
    open_message,
)
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
from ortilo_drake.model.signals import N_U, STAMP

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
    message = open_message(kind, data, sizes, flight.session)
    check_tick(message.tick, flight)
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
