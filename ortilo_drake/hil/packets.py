"""What crosses between the halves, as bytes: LCM types (lcmtypes/*.bus), each with a checksum at its end.

unpack.py turns the bytes back, strictly. A packet of one tick belongs to a session, a number that the world chooses for
each flight, so that packets of another flight on the same wire are known as foreign.
"""

import struct
import zlib
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
from ortilo_drake.logs.picture_codec import encode_png
from ortilo_drake.model.signals import MEASUREMENT_SIZE, N_XBAR, REFERENCE_SIZE

PROTOCOL: Final = 1
PORTS: Final = ("imu", "uwb", "detections", "shutter", "velocity", "image")  # what the world may send in a tick
CHANNELS: Final = {name: f"ORTILO_{name.upper()}" for name in (*PORTS, "tick", "command", "telemetry", "hello", "goal")}
TELEMETRY: Final = {
    "measurement": MEASUREMENT_SIZE,
    "estimate": N_XBAR,
    "covariance": N_XBAR * N_XBAR,
    "reference": REFERENCE_SIZE,
}
NO_TICK: Final = ("hello", "goal")  # channels whose packets belong to no tick
LOOKING, FLYING, FINISHED = STATES = ("looking", "flying", "finished")
MAX_TEXT: Final = 500  # bytes of a text


class Hello(NamedTuple):
    """Handshake and heartbeat.

    Attributes:
        role: "world" or "onboard".
        scenario_digest: hash of the scenario that the sender flies.
        session: the flight's number; 0 for none yet.
        lockstep: whether the sender waits for every answer.
        state: of STATES: looking for the other half, flying with one, or finished.
        reason: why the other half is refused; empty otherwise.
        protocol: version of the types and of the order in which they are sent.
    """

    role: str
    scenario_digest: str
    session: int = 0
    lockstep: bool = False
    state: str = LOOKING
    reason: str = ""
    protocol: int = PROTOCOL


class Goal(NamedTuple):
    """A wish of where to fly, or the answer to it.

    Attributes:
        session: the flight's number.
        number: of the wish, positive, chosen at random by who asks; an answer has the wish's.
        role: "user" asks, "onboard" answers.
        x: east [m], in W.
        y: north [m], in W.
        reason: in an answer why the goal is refused; empty otherwise.
    """

    session: int
    number: int
    role: str
    x: float
    y: float
    reason: str = ""


def _seal(message: Any) -> bytes:
    body = message.encode()[:-8]
    return body + struct.pack(">q", zlib.crc32(body))


def _cut(text: str) -> str:
    return text.encode()[:MAX_TEXT].decode(errors="ignore")


def encode_vector(session: int, tick: int, values: np.ndarray) -> bytes:
    """Return the bytes of a message vector."""
    message = lcmt_vector()
    message.session, message.tick = session, tick
    message.size, message.values = len(values), values.tolist()
    return _seal(message)


def encode_picture(session: int, tick: int, stamp: float, image: np.ndarray) -> bytes:
    """Return the bytes of a picture (height, width, 4), uint8, true at a stamp [s]."""
    message = lcmt_picture()
    message.session, message.tick, message.stamp = session, tick, stamp
    message.data = encode_png(image)
    message.size = len(message.data)
    return _seal(message)


def encode_tick(session: int, tick: int, sent: tuple[str, ...]) -> bytes:
    """Return the bytes that tell which ports, names of PORTS, have a message in a tick."""
    message = lcmt_tick()
    message.session, message.tick, message.n, message.sent = session, tick, len(sent), list(sent)
    return _seal(message)


def encode_command(session: int, tick: int, u: np.ndarray) -> bytes:
    """Return the bytes of a command u (4): thrust [N] and torques [N m]."""
    message = lcmt_command()
    message.session, message.tick, message.u = session, tick, u.tolist()
    return _seal(message)


def encode_telemetry(session: int, tick: int, outputs: dict[str, np.ndarray]) -> bytes:
    """Return the bytes of an onboard half's outputs, of which those that TELEMETRY names are sent."""
    message = lcmt_telemetry()
    message.session, message.tick = session, tick
    for name in TELEMETRY:
        setattr(message, name, outputs[name].tolist())
    return _seal(message)


def encode_hello(hello: Hello) -> bytes:
    """Return the bytes of a handshake or heartbeat; a reason is cut to MAX_TEXT bytes."""
    message = lcmt_hello()
    for name, value in hello._asdict().items():
        setattr(message, name, value)
    message.reason = _cut(hello.reason)
    return _seal(message)


def encode_goal(goal: Goal) -> bytes:
    """Return the bytes of a wish or an answer; a reason is cut to MAX_TEXT bytes."""
    message = lcmt_goal()
    message.session, message.number, message.role = goal.session, goal.number, goal.role
    message.p_W, message.reason = [goal.x, goal.y], _cut(goal.reason)
    return _seal(message)
