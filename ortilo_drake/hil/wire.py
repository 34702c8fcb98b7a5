"""A tick's messages and answers, put on the wire; tick_inbox.py puts them together again."""

from ortilo_drake.hil.bus import Bus
from ortilo_drake.hil.halves import Signals
from ortilo_drake.hil.packets import CHANNELS, encode_command, encode_picture, encode_telemetry, encode_tick
from ortilo_drake.hil.packets import encode_vector as encode
from ortilo_drake.model.signals import STAMP


def publish_messages(bus: Bus, session: int, tick: int, messages: Signals) -> None:
    """Send a tick's messages, and last the list of what was sent."""
    for name, value in messages.items():
        if name == "image":
            bus.publish(CHANNELS[name], encode_picture(session, tick, messages["shutter"][STAMP], value))
        else:
            bus.publish(CHANNELS[name], encode(session, tick, value))
    bus.publish(CHANNELS["tick"], encode_tick(session, tick, tuple(messages)))


def publish_command(bus: Bus, session: int, tick: int, outputs: Signals) -> None:
    """Send the command of a tick."""
    bus.publish(CHANNELS["command"], encode_command(session, tick, outputs["control"]))


def publish_telemetry(bus: Bus, session: int, tick: int, outputs: Signals) -> None:
    """Send what the onboard half knew in a tick."""
    bus.publish(CHANNELS["telemetry"], encode_telemetry(session, tick, outputs))
