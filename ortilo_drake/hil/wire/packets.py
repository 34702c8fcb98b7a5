"""Packets between the halves as bytes: LCM types (lcmtypes/*.lcm).

unpack.py turns packets back, strictly. A packet of one tick belongs to a session, a number that the world draws for
each flight; so packets of another flight on the same wire are recognised.
"""

from typing import Any, Final, NamedTuple

import numpy as np

from ortilo_drake.hil.wire.lcmtypes.ortilo import (
    lcmt_command,
    lcmt_goal,
    lcmt_hello,
    lcmt_picture,
    lcmt_telemetry,
    lcmt_tick,
    lcmt_vector,
)
from ortilo_drake.interop.ros.picture_codec import encode_png
from ortilo_drake.model.parts import known_sensors
from ortilo_drake.model.signals import N_XBAR, REFERENCE_SIZE, SENSORS
from ortilo_drake.sensors.described import port_of

PROTOCOL: Final = 4
# Of the world; registered sensors come to them.
PORTS: Final = (*map(port_of, SENSORS), "shutter", "velocity", "acted", "image")
KINDS: Final = (*PORTS, "tick", "command", "telemetry", "hello", "goal")  # of packets
MEASUREMENT: Final = ("y", "delta", "V2")  # one after the other in telemetry
TELEMETRY: Final = {
    "estimate": N_XBAR,
    "covariance": N_XBAR * N_XBAR,
    "reference": REFERENCE_SIZE,
}
ANSWER: Final = {"control", *MEASUREMENT, *TELEMETRY}  # what a whole answer of the onboard half holds
NO_TICK: Final = ("hello", "goal")  # channels whose packets belong to no tick
LOOKING, FLYING, FINISHED = STATES = ("looking", "flying", "finished")
ROLES: Final = ("world", "onboard", "user")
MAX_TEXT: Final = 500  # bytes of a text


def ports() -> tuple[str, ...]:
    """Return the names of all ports that a world may send on: PORTS and the registered sensors."""
    return (*PORTS, *(name for name in known_sensors() if name not in SENSORS))


def channel_of(name: str) -> str:
    """Return the channel of a port or of another kind of packet."""
    return f"ORTILO_{name.upper()}"


class Hello(NamedTuple):
    """Handshake and heartbeat.

    Attributes:
        role: one of ROLES; "user" listens, or asks for a goal.
        scenario_digest: hash of the scenario that the sender flies, 16 hexadecimal digits.
        session: the flight's number, which the world draws.
        lockstep: whether the world waits for every answer.
        state: one of STATES: looking for the other half, flying with one, or finished.
        nonce: a number that an onboard half drew; in the world's hellos that of the half it met, 0 before.
        tick: the world's tick now; -1 before the first.
        protocol: version of the types and of the order in which they are sent.
    """

    role: str
    scenario_digest: str
    session: int
    lockstep: bool = False
    state: str = LOOKING
    nonce: int = 0
    tick: int = -1
    protocol: int = PROTOCOL


class Goal(NamedTuple):
    """A request to fly somewhere, or the answer to it.

    Attributes:
        session: the flight's number.
        tick: the world's tick when it was sent; an old request is refused.
        number: the request's, positive and random; its answer has the same.
        role: "user" asks, "onboard" answers.
        x: east [m], in W.
        y: north [m], in W.
        reason: in an answer why the goal is refused; empty otherwise.
    """

    session: int
    tick: int
    number: int
    role: str
    x: float
    y: float
    reason: str = ""


def _body(message: Any) -> bytes:
    return bytes(message.encode())


def _cut(text: str) -> str:
    return text.encode()[:MAX_TEXT].decode(errors="ignore")


def encode_vector(session: int, tick: int, values: np.ndarray) -> bytes:
    """Return the bytes of a message vector."""
    message = lcmt_vector()
    message.session, message.tick = session, tick
    message.size, message.values = len(values), values.tolist()
    return _body(message)


def encode_picture(session: int, tick: int, stamp: float, image: np.ndarray) -> bytes:
    """Return the bytes of a picture (height, width, 4), uint8, true at a stamp [s]."""
    message = lcmt_picture()
    message.session, message.tick, message.stamp = session, tick, stamp
    message.data = encode_png(image)
    message.size = len(message.data)
    return _body(message)


def encode_tick(session: int, tick: int, sent: tuple[str, ...]) -> bytes:
    """Return the bytes of the list of ports, names of PORTS, that have a message in a tick."""
    message = lcmt_tick()
    message.session, message.tick, message.n, message.sent = session, tick, len(sent), list(sent)
    return _body(message)


def encode_command(session: int, tick: int, u: np.ndarray) -> bytes:
    """Return the bytes of a command u (4): thrust [N] and torques [N m]."""
    message = lcmt_command()
    message.session, message.tick, message.u = session, tick, u.tolist()
    return _body(message)


def encode_telemetry(session: int, tick: int, outputs: dict[str, np.ndarray]) -> bytes:
    """Return the bytes of an onboard half's outputs, of which those of MEASUREMENT and TELEMETRY are sent."""
    message = lcmt_telemetry()
    message.session, message.tick = session, tick
    for name in TELEMETRY:
        setattr(message, name, outputs[name].tolist())
    message.measurement = [number for name in MEASUREMENT for number in outputs[name].tolist()]
    message.size = len(message.measurement)
    return _body(message)


def encode_hello(hello: Hello) -> bytes:
    """Return the bytes of a handshake or heartbeat."""
    message = lcmt_hello()
    for name, value in hello._asdict().items():
        setattr(message, name, value)
    return _body(message)


def encode_goal(goal: Goal) -> bytes:
    """Return the bytes of a request or an answer; a reason is cut to MAX_TEXT bytes."""
    message = lcmt_goal()
    message.session, message.tick, message.number, message.role = goal[:4]
    message.p_W, message.reason = [goal.x, goal.y], _cut(goal.reason)
    return _body(message)
