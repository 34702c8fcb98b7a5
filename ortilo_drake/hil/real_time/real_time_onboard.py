"""The onboard half in real time: it ticks with the world while packets arrive, and by its own clock otherwise.

Tick k begins when all packets that the world sent in it are here, or half a tick after they were expected. The offset
of the world's clock is estimated from its packets, by the least recent delay (as in D. L. Mills, RFC 5905, clock
filter), so two machines need no common time. A message that comes after its tick enters in a later tick, with its own
stamp; the estimator's setting `delay` says how the filter uses it.
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

CLOCK_WINDOW: Final = 150  # number of the world's ticks over which the least delay is taken


class OnboardTicks:
    """The ticks of an onboard half; all times are by one clock [s].

    `first` is the tick at which the half joined the flight, None before; `next` is the coming tick. `ages` counts the
    messages taken at each age [ticks].
    """

    def __init__(self, scenario: Scenario):
        self._h, estimator = scenario.h, scenario.estimator
        # A filter that replays puts a late message into its own tick; other filters must not take an older message.
        self._horizon = history_ticks(estimator.horizon, scenario.h) if estimator.delay == "replay" else 0
        self._inbox = TickInbox()
        self._offsets: deque[float] = deque(maxlen=CLOCK_WINDOW)  # times of the world's tick 0, each plus a delay
        self.first: int | None = None
        self.next = 0
        self.ages: Counter[int] = Counter()

    @property
    def overtaken(self) -> int:
        """The number of messages dropped because a newer one had come."""
        return self._inbox.overtaken

    def receive(self, packet: Packet, received: float) -> None:
        """Take a packet of the world; the first packet `tick` sets the first tick of this half."""
        if packet.name == "tick":
            self._offsets.append(received - packet.tick * self._h)
            if self.first is None:
                self.first = self.next = packet.tick
        self._inbox.put(packet)

    def due(self) -> float:
        """Return the time at which the next tick begins at the latest, complete or not; inf before the half joined."""
        return min(self._offsets) + (self.next + 0.5) * self._h if self._offsets else np.inf

    def begins(self, now: float) -> bool:
        """Return whether the next tick begins at the time `now`."""
        return self.first is not None and (self._inbox.is_complete(self.next) or now >= self.due())

    def next_messages(self) -> Signals:
        """Return the messages of the next tick, and go on by one tick."""
        k = self.next
        messages = self._inbox.pop_until(k, keep_from=k + 1 - self._horizon)
        for message in messages.values():
            self.count_age(k, message)
        self.next += 1
        return messages

    def count_age(self, k: int, message: np.ndarray) -> None:
        """Count the age of a message taken in tick k."""
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
        onboard: the onboard half of the scenario, at its start.
        outbox: sends to the world.
        inbox: receives hello, goal, tick and the sensors' messages of this flight.
        detector: takes the pictures of a rendered camera, if there is one; `onboard` then takes detections.
        progress: called with the number of every tick.
        record: called in every tick with None for the true state, the messages taken, and the outputs.
        checkpoint: a file to write at every tick; from it this half goes on if the flight has already begun.
        goals: takes the goals of a user; by default goals are ignored.
        say: takes a line about a checkpoint that cannot be written; the flight goes on without it.

    Returns:
        The number of ticks answered, and the figures.
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
            if goals:  # only after the tick's command is sent, so that goals never delay the command
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
    """Join a flight under way at a tick of h [s], with the checkpoint and its path if they exist and fit the flight."""
    path = load_path(checkpoint, session) if checkpoint else None
    if path:
        onboard.fly_path(path)
    found = load_checkpoint(checkpoint, session, tick, h, onboard.state().size) if checkpoint else None
    onboard.resume(tick, found.state if found else None, (tick - found.tick) * h if found else np.inf)
