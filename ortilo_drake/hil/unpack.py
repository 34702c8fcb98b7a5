"""Packets from any bytes, strictly: a packet of this flight, or BadPacket with one of packet_checks.py's reasons.

No decoder here raises anything else, and none allocates more than a few times the length of what it was given: lengths
are compared with the bytes that are there, and a picture's size with this flight's, before anything is unpacked.
"""

from typing import Any, Final, NamedTuple

import numpy as np

from ortilo_drake.hil.lcmtypes.ortilo import (
    lcmt_command,
    lcmt_goal,
    lcmt_hello,
    lcmt_picture,
    lcmt_telemetry,
    lcmt_tick,
    lcmt_vector,
)
from ortilo_drake.hil.packet_checks import (
    COUNT_SIZE,
    CRC_SIZE,
    BadPacket,
    Flight,
    check_canonical,
    check_session,
    check_size,
    check_stamp,
    check_texts,
    check_turn,
    check_values,
    open_message,
)
from ortilo_drake.hil.packets import MAX_TEXT, PORTS, STATES, TELEMETRY, Goal, Hello
from ortilo_drake.logs.picture_codec import decode_foreign_png
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

_TURN: Final = 8 + 8 + 8  # fingerprint, session, tick
_PNG_MARGIN: Final = 65_536  # bytes by which a PNG may be longer than its pixels: noise does not compress


class Packet(NamedTuple):
    """A packet that has passed every check.

    Attributes:
        name: of its channel, a key of CHANNELS.
        tick: the tick it belongs to; -1 for one of NO_TICK.
        value: a message vector; a picture (height, width, 4), uint8; for a tick the names of its ports; a command (4);
            telemetry as a dict from the names of TELEMETRY to vectors; a Hello; a Goal.
        stamp: a picture's time [s]; 0 for the others (a message vector carries its own).
    """

    name: str
    tick: int
    value: Any
    stamp: float = 0.0


def _vector_size(name: str, anchors: int) -> int:
    sizes = {"imu": IMU_SIZE, "detections": DETECTIONS_SIZE, "shutter": SHUTTER_SIZE, "velocity": VELOCITY_SIZE}
    return uwb_size(anchors) if name == "uwb" else sizes[name]


def _decode_vector(name: str, data: bytes, flight: Flight | None) -> Packet:
    longest = DETECTIONS_SIZE if flight is None else _vector_size(name, flight.anchors)
    shortest = 0 if flight is None else longest
    check_size(data, _TURN, 8)
    message = open_message(
        lcmt_vector, data, _TURN + COUNT_SIZE + 8 * shortest + CRC_SIZE, _TURN + COUNT_SIZE + 8 * longest + CRC_SIZE
    )
    flight = check_turn(message, flight)
    values = np.array(message.values)
    flags = values[[ARRIVED]]
    if name == "uwb":
        flags = np.concatenate((flags, values[PAYLOAD + flight.anchors :]))
    check_values(values, flags)
    if name == "detections":  # labels become indices, which compiled code does not check
        labels = values[PAYLOAD::DETECTION_SIZE]
        if not ((labels == np.floor(labels)) & (labels >= -1.0) & (labels < flight.classes)).all():
            raise BadPacket("value")
    check_stamp(float(values[STAMP]), message.tick, flight)
    return Packet(name, message.tick, values)


def _decode_picture(name: str, data: bytes, flight: Flight | None) -> Packet:
    pixels = 0 if flight is None or flight.shape is None else flight.shape[0] * flight.shape[1]
    start = _TURN + 8 + COUNT_SIZE
    check_size(data, _TURN + 8, 1)
    message = open_message(lcmt_picture, data, start + CRC_SIZE, start + 8 * pixels + _PNG_MARGIN + CRC_SIZE)
    flight = check_turn(message, flight)
    check_stamp(message.stamp, message.tick, flight)
    image = None if flight.shape is None else decode_foreign_png(message.data, flight.shape)
    if image is None:
        raise BadPacket("picture")
    return Packet(name, message.tick, image, message.stamp)


def _decode_tick(name: str, data: bytes, flight: Flight | None) -> Packet:
    longest = _TURN + COUNT_SIZE + sum(COUNT_SIZE + len(port) + 1 for port in PORTS) + CRC_SIZE
    message = open_message(lcmt_tick, data, _TURN + COUNT_SIZE + CRC_SIZE, longest)
    check_canonical(message, data)
    check_turn(message, flight)
    if len(set(message.sent)) != len(message.sent) or not set(message.sent) <= set(PORTS):
        raise BadPacket("text")
    return Packet(name, message.tick, tuple(message.sent))


def _decode_command(name: str, data: bytes, flight: Flight | None) -> Packet:
    length = _TURN + 8 * N_U + CRC_SIZE
    message = open_message(lcmt_command, data, length, length)
    check_turn(message, flight)
    u = np.array(message.u)
    check_values(u, u[:0])
    return Packet(name, message.tick, u)


def _decode_telemetry(name: str, data: bytes, flight: Flight | None) -> Packet:
    length = _TURN + 8 * sum(TELEMETRY.values()) + CRC_SIZE
    message = open_message(lcmt_telemetry, data, length, length)
    check_turn(message, flight)
    outputs = {key: np.array(getattr(message, key)) for key in TELEMETRY}
    if not all(np.isfinite(values).all() for values in outputs.values()):
        raise BadPacket("value")
    return Packet(name, message.tick, outputs)


def _decode_hello(name: str, data: bytes, flight: Flight | None) -> Packet:
    shortest = 8 + 4 + 4 * (COUNT_SIZE + 1) + 8 + 1 + CRC_SIZE
    message = open_message(lcmt_hello, data, shortest, shortest + 4 * MAX_TEXT)
    check_canonical(message, data)
    check_texts(message.role, ("world", "onboard"), message.scenario_digest, message.reason)
    if message.state not in STATES:
        raise BadPacket("text")
    if message.session < 0:
        raise BadPacket("foreign")
    return Packet(name, -1, Hello(**{field: getattr(message, field) for field in Hello._fields}))


def _decode_goal(name: str, data: bytes, flight: Flight | None) -> Packet:
    shortest = _TURN + 2 * (COUNT_SIZE + 1) + 8 * 2 + CRC_SIZE
    message = open_message(lcmt_goal, data, shortest, shortest + 2 * MAX_TEXT)
    flight = check_session(message, flight)
    x, y = message.p_W
    check_values(np.array([x, y]), np.empty(0))
    if message.number <= 0:
        raise BadPacket("value")
    check_canonical(message, data)
    check_texts(message.role, ("user", "onboard"), message.reason)
    return Packet(name, -1, Goal(flight.session, message.number, message.role, x, y, message.reason))


_OTHERS: Final = {
    "image": _decode_picture,
    "tick": _decode_tick,
    "command": _decode_command,
    "telemetry": _decode_telemetry,
    "hello": _decode_hello,
    "goal": _decode_goal,
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
