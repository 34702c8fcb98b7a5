"""Packets between the halves: their bytes as LCM types (lcmtypes/*.lcm), and their publishing on the bus.

unpack.py decodes packets strictly, and inbox.py receives them. A packet belongs to a session, a number that the world
draws for each flight, so that packets of another flight on the same bus are recognised.
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
# The ports of the world; ports() adds the ports of registered sensors.
PORTS: Final = (*map(port_of, SENSORS), "shutter", "velocity", "acted", "image")
KINDS: Final = (*PORTS, "tick", "command", "telemetry", "hello", "goal")  # kinds of packets
MEASUREMENT: Final = ("y", "delta", "V2")  # signals that telemetry holds one after the other
TELEMETRY: Final = {
    "estimate": N_XBAR,
    "covariance": N_XBAR * N_XBAR,
    "reference": REFERENCE_SIZE,
}
ANSWER: Final = {"control", *MEASUREMENT, *TELEMETRY}  # signals of a complete answer of the onboard half
NO_TICK: Final = ("hello", "goal")  # channels whose packets belong to no tick
LOOKING, FLYING, FINISHED = STATES = ("looking", "flying", "finished")
ROLES: Final = ("world", "onboard", "user")
MAX_TEXT: Final = 500  # longest text [bytes]

VECTOR, PICTURE, TICK, COMMAND, TELEMETRY_TYPE, HELLO, GOAL = (
    LcmType(name) for name in ("vector", "picture", "tick", "command", "telemetry", "hello", "goal")
)


def ports() -> tuple[str, ...]:
    """Return the names of all ports that a world may send on: PORTS and the registered sensors."""
    return (*PORTS, *(name for name in known_sensors() if name not in SENSORS))


def channel_of(name: str) -> str:
    """Return the name of the channel of a port or of another kind of packet."""
    return f"ORTILO_{name.upper()}"


class Hello(NamedTuple):
    """A hello, the handshake and heartbeat of one of ROLES; a "user" listens, or requests a goal.

    `scenario_digest` (16 hexadecimal digits) is that of the sender's scenario. `session` is the number of the flight,
    which the world draws. In lockstep the world waits for every answer. `state` is one of STATES. `nonce` is a number
    that an onboard half drew; the world's hellos hold the nonce of the half that it chose, 0 before. `tick` is the
    world's present tick, -1 before the first.
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
    """A request of a "user" to fly to (x, y) in W [m], or the answer of "onboard" to a request.

    `session` is the number of the flight, `tick` the world's tick at the time of sending: an old request is refused.
    Request and answer have the same random `number` above 0. `reason` says why the answer refuses the goal, else ''.
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
    """Return the bytes of a picture (height, width, 4), uint8, taken at a stamp [s]."""
    return PICTURE.encode(session=session, tick=tick, stamp=stamp, data=encode_png(image))


def encode_tick(session: int, tick: int, sent: tuple[str, ...]) -> bytes:
    """Return the bytes of the list of ports that have a message in a tick."""
    return TICK.encode(session=session, tick=tick, sent=sent)


def encode_command(session: int, tick: int, u: np.ndarray) -> bytes:
    """Return the bytes of a command u (4): thrust [N] and torques [N m]."""
    return COMMAND.encode(session=session, tick=tick, u=u.tolist())


def encode_telemetry(session: int, tick: int, outputs: dict[str, np.ndarray]) -> bytes:
    """Return the bytes of telemetry: the signals of MEASUREMENT and TELEMETRY among an onboard half's outputs."""
    measurement = [number for name in MEASUREMENT for number in outputs[name].tolist()]
    known = {name: outputs[name].tolist() for name in TELEMETRY}
    return TELEMETRY_TYPE.encode(session=session, tick=tick, measurement=measurement, **known)


def encode_hello(hello: Hello) -> bytes:
    """Return the bytes of a hello."""
    return HELLO.encode(**hello._asdict())


def encode_goal(goal: Goal) -> bytes:
    """Return the bytes of a request or an answer; the reason is cut to MAX_TEXT bytes."""
    reason = goal.reason.encode()[:MAX_TEXT].decode(errors="ignore")
    asked = {"session": goal.session, "tick": goal.tick, "number": goal.number, "role": goal.role}
    return GOAL.encode(**asked, p_W=(goal.x, goal.y), reason=reason)


class Outbox:
    """A sender of the packets of one flight, a session, on a bus."""

    def __init__(self, bus: Bus, session: int):
        self.session = session
        self._bus = bus

    def send(self, name: str, body: bytes) -> None:
        """Send the bytes of a packet on the channel `name`, one of packets.ports() or packets.KINDS."""
        self._bus.publish(channel_of(name), body)


def publish_messages(outbox: Outbox, tick: int, messages: Signals) -> None:
    """Send the messages of a tick, and last the list of their ports."""
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
    """Send a request of a goal or an answer."""
    outbox.send("goal", encode_goal(goal))
