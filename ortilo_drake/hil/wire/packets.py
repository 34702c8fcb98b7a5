"""Packets between the halves as bytes, LCM types (lcmtypes/*.lcm), and how they are put on the bus.

unpack.py turns packets back, strictly, and inbox.py takes them. A packet of one tick belongs to a session, a number
that the world draws for each flight; so packets of another flight on the same wire are recognised.
"""

from typing import Final, NamedTuple

import numpy as np

from ortilo_drake.flight.stepped_halves import Signals
from ortilo_drake.hil.wire.bus import Bus
from ortilo_drake.hil.wire.lcm_type import LcmType
from ortilo_drake.interop.ros.picture_codec import encode_png
from ortilo_drake.model.parts import known_sensors
from ortilo_drake.model.signals import N_XBAR, REFERENCE_SIZE, SENSORS, STAMP
from ortilo_drake.sensors.described import port_of

PROTOCOL: Final = 4
# Of the world; ports() adds those of registered sensors.
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

VECTOR, PICTURE, TICK, COMMAND, TELEMETRY_TYPE, HELLO, GOAL = (
    LcmType(name) for name in ("vector", "picture", "tick", "command", "telemetry", "hello", "goal")
)


def ports() -> tuple[str, ...]:
    """Return the names of all ports that a world may send on: PORTS and the registered sensors."""
    return (*PORTS, *(name for name in known_sensors() if name not in SENSORS))


def channel_of(name: str) -> str:
    """Return the channel of a port or of another kind of packet."""
    return f"ORTILO_{name.upper()}"


class Hello(NamedTuple):
    """Handshake and heartbeat of one of ROLES; a "user" listens, or asks for a goal.

    The digest, 16 hexadecimal digits, is of the scenario that the sender flies, the session is the flight's number,
    which the world draws. In lockstep the world waits for every answer. The state is one of STATES, the tick the
    world's now, -1 before the first. The nonce is a number that an onboard half drew; in the world's hellos that of the
    half it met, 0 before.
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
    """A request of a "user" to fly to (x, y) in W [m], or the answer of "onboard" to it.

    It has the flight's session, and the world's tick when it was sent: an old request is refused. Request and answer
    have the same random number, above 0. The reason says in an answer why the goal is refused; it is empty otherwise.
    """

    session: int
    tick: int
    number: int
    role: str
    x: float
    y: float
    reason: str = ""


def encode_vector(session: int, tick: int, values: np.ndarray) -> bytes:
    """Return the bytes of a message vector."""
    return VECTOR.encode(session=session, tick=tick, values=values.tolist())


def encode_picture(session: int, tick: int, stamp: float, image: np.ndarray) -> bytes:
    """Return the bytes of a picture (height, width, 4), uint8, true at a stamp [s]."""
    return PICTURE.encode(session=session, tick=tick, stamp=stamp, data=encode_png(image))


def encode_tick(session: int, tick: int, sent: tuple[str, ...]) -> bytes:
    """Return the bytes of the list of ports, names of PORTS, that have a message in a tick."""
    return TICK.encode(session=session, tick=tick, sent=sent)


def encode_command(session: int, tick: int, u: np.ndarray) -> bytes:
    """Return the bytes of a command u (4): thrust [N] and torques [N m]."""
    return COMMAND.encode(session=session, tick=tick, u=u.tolist())


def encode_telemetry(session: int, tick: int, outputs: dict[str, np.ndarray]) -> bytes:
    """Return the bytes of an onboard half's outputs, of which those of MEASUREMENT and TELEMETRY are sent."""
    measurement = [number for name in MEASUREMENT for number in outputs[name].tolist()]
    known = {name: outputs[name].tolist() for name in TELEMETRY}
    return TELEMETRY_TYPE.encode(session=session, tick=tick, measurement=measurement, **known)


def encode_hello(hello: Hello) -> bytes:
    """Return the bytes of a handshake or heartbeat."""
    return HELLO.encode(**hello._asdict())


def encode_goal(goal: Goal) -> bytes:
    """Return the bytes of a request or an answer; a reason is cut to MAX_TEXT bytes."""
    reason = goal.reason.encode()[:MAX_TEXT].decode(errors="ignore")
    asked = {"session": goal.session, "tick": goal.tick, "number": goal.number, "role": goal.role}
    return GOAL.encode(**asked, p_W=(goal.x, goal.y), reason=reason)


class Outbox:
    """Sends the packets of one flight, a session, on a bus."""

    def __init__(self, bus: Bus, session: int):
        self.session = session
        self._bus = bus

    def send(self, name: str, body: bytes) -> None:
        """Send a body on a channel, a key of packets.ports or packets.KINDS."""
        self._bus.publish(channel_of(name), body)


def publish_messages(outbox: Outbox, tick: int, messages: Signals) -> None:
    """Send a tick's messages, and at last the list of them."""
    session = outbox.session
    for name, value in messages.items():
        if name == "image":
            outbox.send(name, encode_picture(session, tick, messages["shutter"][STAMP], value))
        else:
            outbox.send(name, encode_vector(session, tick, value))
    outbox.send("tick", encode_tick(session, tick, tuple(messages)))


def publish_command(outbox: Outbox, tick: int, outputs: Signals) -> None:
    """Send the command of a tick."""
    outbox.send("command", encode_command(outbox.session, tick, outputs["control"]))


def publish_telemetry(outbox: Outbox, tick: int, outputs: Signals) -> None:
    """Send the onboard half's telemetry of a tick."""
    outbox.send("telemetry", encode_telemetry(outbox.session, tick, outputs))


def publish_goal(outbox: Outbox, goal: Goal) -> None:
    """Send a request or an answer."""
    outbox.send("goal", encode_goal(goal))
