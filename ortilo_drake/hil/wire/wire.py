"""The sending side of a flight: packets are put on the bus; tick_inbox.py receives them tick by tick."""

from ortilo_drake.flight.stepped_halves import Signals
from ortilo_drake.hil.wire.bus import Bus
from ortilo_drake.hil.wire.packets import (
    Goal,
    channel_of,
    encode_command,
    encode_goal,
    encode_picture,
    encode_telemetry,
    encode_tick,
    encode_vector,
)
from ortilo_drake.model.signals import STAMP


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
