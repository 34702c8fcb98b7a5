"""A tick's messages and answers, put on the wire; tick_inbox.py puts them together again."""

from pydrake.lcm import DrakeLcm

from ortilo_drake.hil.halves import Signals
from ortilo_drake.hil.packets import encode_command, encode_picture, encode_telemetry, encode_tick, lane
from ortilo_drake.hil.packets import encode_vector as encode
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
