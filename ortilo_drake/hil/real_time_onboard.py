"""The onboard half in real time: it ticks with the world while it hears it, and by its own clock where it does not.

Tick k begins when all that the world sent in it is here, or half a tick after it was expected. The world's clock is
known from its packets: the least delay heard lately is taken for the way's own (the usual estimate of a one-way offset,
as in D. L. Mills, RFC 5905, clock filter); so two machines need no common time. What comes later than its tick enters
in the tick after, with its own stamp; filter.delay says what becomes of it.
"""

import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from pydrake.lcm import DrakeLcm

from ortilo_drake.hil.checkpoint import Checkpoint, load_checkpoint, load_path, save_checkpoint, save_path
from ortilo_drake.hil.detector_thread import DetectorThread
from ortilo_drake.hil.flight_record import Record
from ortilo_drake.hil.goals import Goals
from ortilo_drake.hil.halves import OnboardHalf
from ortilo_drake.hil.handshake import PATIENCE, say_hello
from ortilo_drake.hil.packets import CHANNELS, FINISHED, Hello, encode_goal
from ortilo_drake.hil.spare import Spare
from ortilo_drake.hil.tick_inbox import TickInbox
from ortilo_drake.hil.transport import Inbox
from ortilo_drake.hil.wire import publish_command, publish_telemetry
from ortilo_drake.model.signals import STAMP
from ortilo_drake.onboard.late_measurements import history_ticks
from ortilo_drake.scenario import Scenario

CLOCK_WINDOW: Final = 150  # ticks of the world's over which the least delay is taken


class _Clock:
    """When the world's tick 0 was, on this machine's clock, less the least delay of the way."""

    def __init__(self, h: float):
        self._h = h
        self._offsets: deque[float] = deque(maxlen=CLOCK_WINDOW)

    def hear(self, tick: int, received: float) -> None:
        self._offsets.append(received - tick * self._h)

    def expected(self, tick: int) -> float:
        """Return when a tick's packets come, if nothing holds them up; inf before the first."""
        return min(self._offsets) + tick * self._h if self._offsets else np.inf


class Answered(NamedTuple):
    """What an onboard half did in a flight.

    Attributes:
        ticks: how many it answered.
        ages: how many of the messages that it took were how many ticks old.
        overtaken: how many messages it did not take, since a newer one had come.
        silent: where the world fell silent for PATIENCE, without a word that it has finished: the tick; else None.
    """

    ticks: int
    ages: dict[int, int]
    overtaken: int
    silent: int | None


def answer_in_real_time(
    scenario: Scenario,
    onboard: OnboardHalf,
    lcm: DrakeLcm,
    inbox: Inbox,
    session: int,
    detector: DetectorThread | None = None,
    progress: Callable[[int], None] | None = None,
    record: Record | None = None,
    checkpoint: Path | None = None,
    goals: Goals | None = None,
    say: Callable[[str], None] = print,
) -> Answered:
    """Be the onboard half until the world says that it has finished, or is silent for PATIENCE.

    Args:
        scenario: the scenario.
        onboard: its onboard half, at the start.
        lcm: the bus.
        inbox: hears hello, goal, tick and the sensors' messages of this flight.
        session: of this flight.
        detector: looks at the pictures, if there is a rendered camera; onboard then takes detections.
        progress: called at every tick with the number of it.
        record: called with what was taken and made of it in every tick; of the true state it knows nothing.
        checkpoint: a file to write at every tick, and to go on from where the flight has begun already.
        goals: takes the goals of a user; by default they are not heard.
        say: takes a line about a checkpoint that cannot be written; the flight goes on without it.
    """
    clock, waiting = _Clock(scenario.h), TickInbox()
    # What the filter puts into its own tick is of use after a newer message too; for any other it would be a step back.
    horizon = history_ticks(scenario.filter.horizon, scenario.h) if scenario.filter.delay == "replay" else 0
    ages: dict[int, int] = {}
    first = k = 0
    joined, heard = False, time.perf_counter()
    goal: np.ndarray | None = None
    keep, keep_path = Spare(save_checkpoint, say), Spare(save_path, say)
    while True:
        now = time.perf_counter()
        due = clock.expected(k) + scenario.h / 2.0
        for received, packet in inbox.poll(1 if due > now + 1e-3 else 0):
            if packet.name == "goal":
                if goals:
                    goals.hear(packet.value)
                continue
            heard = received
            if packet.name == "hello":
                hello = packet.value
                if hello.role == "world":
                    if hello.state == FINISHED:
                        return Answered(k - first, ages, waiting.overtaken, None)
                    say_hello(lcm, Hello("onboard", hello.scenario_digest, session))
                continue
            if packet.name == "tick":
                clock.hear(packet.tick, received)
                if not joined:
                    joined, first = True, packet.tick
                    k = first
                    if first > 0:
                        join_flight(onboard, checkpoint, session, first, scenario.h)
            if packet.name == "image":
                if detector:
                    detector.look(packet.stamp, packet.value)
                continue
            waiting.put(packet)
        if joined and (waiting.is_complete(k) or time.perf_counter() >= due):
            messages = waiting.take_until(k, keep_from=k + 1 - horizon)
            if detector and (detections := detector.newest()) is not None:
                messages["detections"] = detections
            for message in messages.values():
                age = round(k - message[STAMP] * scenario.control_rate)
                ages[age] = ages.get(age, 0) + 1
            if goal is not None:
                messages["goal"] = goal
            onboard.take(messages)
            publish_command(lcm, session, k, {"control": onboard.answer()})
            outputs = onboard.outputs()
            publish_telemetry(lcm, session, k, outputs)
            onboard.advance()
            if record:
                record(k, None, messages, outputs)
            k += 1
            if goals:  # after the tick's command, which nothing here holds up
                step = goals.step(k * scenario.h, onboard.path)
                goal = step.taken
                for answer in step.answers:
                    lcm.Publish(CHANNELS["goal"], encode_goal(answer))
                if step.path:
                    onboard.fly_path(step.path)
                    if checkpoint:
                        keep_path(checkpoint, session, step.path)
            if checkpoint:
                keep(checkpoint, Checkpoint(session, k, onboard.state()))
            if progress:
                progress(k)
        elif time.perf_counter() > heard + PATIENCE:
            return Answered(k - first, ages, waiting.overtaken, k)


def join_flight(onboard: OnboardHalf, checkpoint: Path | None, session: int, tick: int, h: float) -> None:
    """Go on in a flight that is at a tick already, from the checkpoint and its path if they are there and fit."""
    path = load_path(checkpoint, session) if checkpoint else None
    if path:
        onboard.fly_path(path)
    found = load_checkpoint(checkpoint, session, tick, h, onboard.state().size) if checkpoint else None
    onboard.resume(tick, found.state if found else None, (tick - found.tick) * h if found else np.inf)
