"""Lockstep over a link that may lose packets: a half that hears nothing for a while repeats its last packets.

The other half drops packets that it already has. So loss, duplication and delay cost time but do not change a bit of
the flight.
"""

import time
from collections.abc import Callable
from typing import Final, Protocol

from ortilo_drake.flight.lockstep import Ask
from ortilo_drake.flight.signals import Record
from ortilo_drake.flight.stepped_halves import Signals
from ortilo_drake.hil.goals.goal_link import LOCKSTEP_REFUSAL, answer_to
from ortilo_drake.hil.wire.handshake import PATIENCE, Greeter
from ortilo_drake.hil.wire.inbox import Inbox, TickInbox
from ortilo_drake.hil.wire.packets import (
    ANSWER,
    FINISHED,
    Goal,
    Outbox,
    publish_command,
    publish_goal,
    publish_messages,
    publish_telemetry,
)
from ortilo_drake.model.typed_yaml import InputError

SILENCE_MS: Final = 50  # silence before the last packets are repeated; a tick over loopback takes 2 ms, a picture 30 ms
POLL_MS: Final = 10


class StepsTicks(Protocol):
    """An onboard half that is stepped tick by tick, such as flight.stepped_halves.OnboardHalf."""

    def receive(self, messages: Signals) -> None:
        """Take this tick's messages."""

    def outputs(self) -> Signals:
        """Return every signal of this tick."""

    def advance(self) -> None:
        """Go on to the next tick."""


def ask_over_link(outbox: Outbox, inbox: Inbox, greeter: Greeter) -> Ask:
    """Return a function that asks the onboard half at the other end of a link, for lockstep.fly_lockstep.

    The function raises InputError if the onboard half is silent for PATIENCE.
    """

    def ask(tick: int, messages: Signals) -> Signals:
        publish_messages(outbox, tick, messages)
        outputs: Signals = {}
        last_heard = last_sent = time.monotonic()
        while not outputs.keys() >= ANSWER:
            arrivals = inbox.poll(POLL_MS)
            for packet in (arrival.packet for arrival in arrivals):
                if packet.name == "hello" and greeter.is_answer(packet.value):
                    greeter.say(tick)
                elif packet.tick == tick:
                    outputs |= {"control": packet.value} if packet.name == "command" else packet.value
            now = time.monotonic()
            if any(arrival.packet.name != "hello" for arrival in arrivals):
                last_heard = last_sent = now
            elif now > last_heard + PATIENCE:
                raise InputError(f"onboard half: silent for {PATIENCE:g} s at tick {tick}")
            elif now > last_sent + 1e-3 * SILENCE_MS:  # a duplicate may end a poll early
                publish_messages(outbox, tick, messages)
                last_sent = now
        return outputs

    return ask


def answer_over_link(
    onboard: StepsTicks,
    outbox: Outbox,
    inbox: Inbox,
    progress: Callable[[int], None] | None = None,
    record: Record | None = None,
) -> int:
    """Answer the world as its onboard half until the world has finished; return the number of ticks answered.

    InputError if the world is silent for PATIENCE.
    """
    ticks = TickInbox()
    k = 0
    last: Signals | None = None
    last_heard = last_sent = time.monotonic()
    while True:
        packets = [arrival.packet for arrival in inbox.poll(POLL_MS)]
        for packet in packets:
            if packet.name == "goal":
                _refuse(outbox, packet.value)
            elif packet.name != "hello":
                ticks.put(packet)
            elif packet.value.role == "world" and packet.value.state == FINISHED:
                return k
        if ticks.is_complete(k):
            messages = ticks.pop(k)
            onboard.receive(messages)
            last = onboard.outputs()
            _answer(outbox, k, last)
            onboard.advance()
            if record:
                record(k, None, messages, last)
            k += 1
            if progress:
                progress(k)
        now = time.monotonic()
        if any(packet.name != "goal" for packet in packets):
            last_heard = last_sent = now
        elif now > last_heard + PATIENCE:
            raise InputError(f"world: silent for {PATIENCE:g} s at tick {k}")
        elif last is not None and now > last_sent + 1e-3 * SILENCE_MS:
            _answer(outbox, k - 1, last)
            last_sent = now


def _refuse(outbox: Outbox, goal: Goal) -> None:
    if goal.role == "user":  # a goal of another role is our own refusal
        publish_goal(outbox, answer_to(goal, LOCKSTEP_REFUSAL))


def _answer(outbox: Outbox, tick: int, outputs: Signals) -> None:
    publish_command(outbox, tick, outputs)
    publish_telemetry(outbox, tick, outputs)
