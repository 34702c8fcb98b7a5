"""A tick's messages on the wire, and back together on the other side."""

from pydrake.lcm import DrakeLcm

from ortilo_drake.hil.halves import Signals
from ortilo_drake.hil.packets import encode_command, encode_picture, encode_telemetry, encode_tick, lane
from ortilo_drake.hil.packets import encode_vector as encode
from ortilo_drake.hil.unpack import Packet
from ortilo_drake.model.signals import STAMP


def publish_messages(lcm: DrakeLcm, session: int, tick: int, messages: Signals) -> None:
    """Send a tick's messages, and last the list of what was sent."""
    for name, value in messages.items():
        if name == "image":
            lcm.Publish(lane(name, tick), encode_picture(session, tick, messages["shutter"][STAMP], value))
        else:
            lcm.Publish(lane(name, tick), encode(session, tick, value))
    lcm.Publish(lane("tick", tick), encode_tick(session, tick, tuple(messages)))


def publish_command(lcm: DrakeLcm, session: int, tick: int, outputs: Signals) -> None:
    """Send the command of a tick."""
    lcm.Publish(lane("command", tick), encode_command(session, tick, outputs["control"]))


def publish_telemetry(lcm: DrakeLcm, session: int, tick: int, outputs: Signals) -> None:
    """Send what the onboard half knew in a tick."""
    lcm.Publish(lane("telemetry", tick), encode_telemetry(session, tick, outputs))


class TickInbox:
    """Puts the packets of each tick together; they may come in any order."""

    def __init__(self) -> None:
        self._sent: dict[int, tuple[str, ...]] = {}
        self._messages: dict[int, Signals] = {}

    def put(self, packet: Packet) -> None:
        """Take a packet of the world."""
        if packet.name == "tick":
            self._sent[packet.tick] = packet.value
        else:
            self._messages.setdefault(packet.tick, {})[packet.name] = packet.value

    def is_complete(self, tick: int) -> bool:
        """Return whether everything that was sent in a tick is here."""
        return tick in self._sent and self._messages.get(tick, {}).keys() >= set(self._sent[tick])

    def take(self, tick: int) -> Signals:
        """Return a tick's messages and forget them."""
        self._sent.pop(tick, None)
        return self._messages.pop(tick, {})
