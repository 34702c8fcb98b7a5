"""The onboard half in real time: it ticks with the world while packets arrive, and by its own clock otherwise.

Tick k begins when all that the world sent in it is here, or half a tick after it was expected. The offset of the
world's clock is estimated from its packets, by the least delay seen lately (as in D. L. Mills, RFC 5905, clock filter);
so two machines need no common time. A message that is later than its tick enters in a tick after it, with its own
stamp; filter.delay says what becomes of it.
"""

import time
from collections import Counter, deque
from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np

from ortilo_drake.flight.signals import Record
from ortilo_drake.flight.stepped_halves import OnboardHalf, Signals
from ortilo_drake.hil.goals.goals import Goals
from ortilo_drake.hil.real_time.camera_process import DetectorThread
from ortilo_drake.hil.reports import OnboardFigures
from ortilo_drake.hil.restart.checkpoint import Checkpoint, load_checkpoint, load_path, save_checkpoint, save_path
from ortilo_drake.hil.restart.until_it_fails import UntilItFails
from ortilo_drake.hil.wire.handshake import PATIENCE
from ortilo_drake.hil.wire.inbox import Inbox, TickInbox
from ortilo_drake.hil.wire.packets import FINISHED, Outbox, publish_command, publish_goal, publish_telemetry
from ortilo_drake.hil.wire.unpack import Packet
from ortilo_drake.model.clock import history_ticks
from ortilo_drake.model.signals import STAMP
from ortilo_drake.scenario import Scenario

CLOCK_WINDOW: Final = 150  # ticks of the world over which the least delay is taken


class OnboardTicks:
    """The ticks of an onboard half; all times are one clock's [s].

    It joined the flight at the first tick, None before; the next one comes. Ages counts the messages that were taken at
    each age in ticks.
    """

    def __init__(self, scenario: Scenario):
        self._h, estimator = scenario.h, scenario.estimator
        # A filter that replays puts a late message into its own tick; for any other, an older message is a step back.
        self._horizon = history_ticks(estimator.horizon, scenario.h) if estimator.delay == "replay" else 0
        self._inbox = TickInbox()
        self._offsets: deque[float] = deque(maxlen=CLOCK_WINDOW)  # time of the world's tick 0, plus a delay
        self.first: int | None = None
        self.next = 0
        self.ages: Counter[int] = Counter()

    @property
    def overtaken(self) -> int:
        """The number of messages dropped for a newer one."""
        return self._inbox.overtaken

    def receive(self, packet: Packet, received: float) -> None:
        """Take a packet of the world; the first tick that it lists is the first of this half."""
        if packet.name == "tick":
            self._offsets.append(received - packet.tick * self._h)
            if self.first is None:
                self.first = self.next = packet.tick
        self._inbox.put(packet)

    def due(self) -> float:
        """Return the latest time at which the next tick begins, complete or not; inf before the flight is joined."""
        return min(self._offsets) + (self.next + 0.5) * self._h if self._offsets else np.inf

    def begins(self, now: float) -> bool:
        """Return whether the next tick begins now."""
        return self.first is not None and (self._inbox.is_complete(self.next) or now >= self.due())

    def next_messages(self) -> Signals:
        """Return the messages of the next tick, and go on to the one after."""
        k = self.next
        messages = self._inbox.pop_until(k, keep_from=k + 1 - self._horizon)
        for message in messages.values():
            self.count_age(k, message)
        self.next += 1
        return messages

    def count_age(self, k: int, message: np.ndarray) -> None:
        """Count the age of a message that is taken in tick k."""
        self.ages[round(k - message[STAMP] / self._h)] += 1


def answer_in_real_time(
    scenario: Scenario,
    onboard: OnboardHalf,
    outbox: Outbox,
    inbox: Inbox,
    detector: DetectorThread | None = None,
    progress: Callable[[int], None] | None = None,
    record: Record | None = None,
    checkpoint: Path | None = None,
    goals: Goals | None = None,
    say: Callable[[str], None] = print,
) -> tuple[int, OnboardFigures]:
    """Answer the world as its onboard half until it says that it has finished, or is silent for PATIENCE.

    Args:
        scenario: the scenario.
        onboard: its onboard half, at the start.
        outbox: to the world.
        inbox: hears hello, goal, tick and the sensors' messages of this flight.
        detector: looks at the pictures, if there is a rendered camera; onboard then takes detections.
        progress: called with the number of every tick.
        record: called in every tick with the messages taken and the outputs, but None for the true state.
        checkpoint: a file to write at every tick; from it this half goes on if the flight has begun already.
        goals: takes the goals of a user; by default they are not heard.
        say: takes a line about a checkpoint that cannot be written; the flight goes on without it.

    Returns:
        How many ticks it answered, and its figures.
    """
    ticks, session = OnboardTicks(scenario), outbox.session
    heard = time.perf_counter()
    goal: np.ndarray | None = None
    keep, keep_path = UntilItFails(save_checkpoint, say), UntilItFails(save_path, say)
    while True:
        idle = ticks.due() > time.perf_counter() + 1e-3
        for received, packet in inbox.poll(1 if idle else 0):
            if packet.name == "goal":
                if goals:
                    goals.receive(packet.value)
                continue
            heard = received
            if packet.name == "hello":
                if packet.value.role == "world" and packet.value.state == FINISHED:
                    return _report(ticks, None)
            elif packet.name != "image":
                joins = ticks.first is None
                ticks.receive(packet, received)
                if joins and ticks.first:
                    join_flight(onboard, checkpoint, session, ticks.first, scenario.h)
            elif detector:
                detector.look(packet.stamp, packet.value)
        if ticks.begins(time.perf_counter()):
            k = ticks.next
            messages = ticks.next_messages()
            if detector and (detections := detector.newest()) is not None:
                messages["detections"] = detections
                ticks.count_age(k, detections)
            if goal is not None:
                messages["goal"] = goal
            onboard.receive(messages)
            publish_command(outbox, k, {"control": onboard.answer()})
            outputs = onboard.outputs()
            publish_telemetry(outbox, k, outputs)
            onboard.advance()
            if record:
                record(k, None, messages, outputs)
            if goals:  # after the tick's command is sent, so that goals never delay it
                step = goals.step(ticks.next * scenario.h, onboard.path)
                goal = step.taken
                for answer in step.answers:
                    publish_goal(outbox, answer)
                if step.path:
                    onboard.fly_path(step.path)
                    if checkpoint:
                        keep_path(checkpoint, session, step.path)
            if checkpoint:
                keep(checkpoint, Checkpoint(session, ticks.next, onboard.state()))
            if progress:
                progress(ticks.next)
        elif time.perf_counter() > heard + PATIENCE:
            return _report(ticks, ticks.next)


def _report(ticks: OnboardTicks, silent: int | None) -> tuple[int, OnboardFigures]:
    ages = {str(age): count for age, count in sorted(ticks.ages.items())}
    return ticks.next - (ticks.first or 0), OnboardFigures(silent, ages, ticks.overtaken)


def join_flight(onboard: OnboardHalf, checkpoint: Path | None, session: int, tick: int, h: float) -> None:
    """Join a flight that is under way at a tick, from the checkpoint and its path if they are there and fit."""
    path = load_path(checkpoint, session) if checkpoint else None
    if path:
        onboard.fly_path(path)
    found = load_checkpoint(checkpoint, session, tick, h, onboard.state().size) if checkpoint else None
    onboard.resume(tick, found.state if found else None, (tick - found.tick) * h if found else np.inf)
