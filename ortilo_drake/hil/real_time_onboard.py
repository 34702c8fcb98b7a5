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
from typing import Final

import numpy as np
from pydrake.lcm import DrakeLcm

from ortilo_drake.hil.checkpoint import Checkpoint, load_checkpoint, load_path, save_checkpoint, save_path
from ortilo_drake.hil.detector_thread import DetectorThread
from ortilo_drake.hil.goals import Goals
from ortilo_drake.hil.halves import OnboardHalf, Signals
from ortilo_drake.hil.handshake import FINISHED, say_hello
from ortilo_drake.hil.lockstep import Record
from ortilo_drake.hil.lockstep_link import PATIENCE
from ortilo_drake.hil.packets import CHANNELS, Hello, encode_goal
from ortilo_drake.hil.transport import Inbox
from ortilo_drake.hil.unpack import Packet
from ortilo_drake.hil.wire import publish_command, publish_telemetry
from ortilo_drake.model.signals import STAMP
from ortilo_drake.model.typed_yaml import InputError
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


class _Waiting:
    """Packets not yet taken."""

    def __init__(self) -> None:
        self._lists: dict[int, tuple[str, ...]] = {}
        self._packets: list[Packet] = []

    def put(self, packet: Packet) -> None:
        if packet.name == "tick":
            self._lists[packet.tick] = packet.value
        else:
            self._packets.append(packet)

    def is_complete(self, tick: int) -> bool:
        here = {packet.name for packet in self._packets if packet.tick == tick}
        return tick in self._lists and here >= set(self._lists[tick])

    def newest_tick(self) -> int:
        return max(self._lists, default=-1)

    def take(self, tick: int) -> Signals:
        """Return the messages of this tick and the late ones of those before; of two on a port the newer stamp."""
        due = sorted((p for p in self._packets if p.tick <= tick), key=lambda p: p.tick)
        self._packets = [p for p in self._packets if p.tick > tick]
        self._lists = {k: names for k, names in self._lists.items() if k > tick}
        return {packet.name: packet.value for packet in due}


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
) -> tuple[int, dict[int, int]]:
    """Be the onboard half until the world says that it has finished.

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

    Returns:
        How many ticks were answered, and how many messages came late by how many ticks.

    Raises:
        InputError: if the world is silent for PATIENCE.
    """
    clock, waiting = _Clock(scenario.h), _Waiting()
    late: dict[int, int] = {}
    first = k = 0
    joined, heard = False, time.perf_counter()
    goal: np.ndarray | None = None
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
                if hello.role == "world" and hello.session == session:
                    if hello.reason == FINISHED:
                        return k - first, late
                    say_hello(lcm, Hello("onboard", hello.scenario_digest, session, False))
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
            messages = waiting.take(k)
            if detector and (detections := detector.newest()) is not None:
                messages["detections"] = detections
            for message in messages.values():
                age = round(k - message[STAMP] * scenario.control_rate)
                late[age] = late.get(age, 0) + 1
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
                goal = _fly_goals(goals, onboard, lcm, k * scenario.h, session, checkpoint)
            if checkpoint:
                save_checkpoint(checkpoint, Checkpoint(session, k, onboard.state()))
            if progress:
                progress(k)
        elif time.perf_counter() > heard + PATIENCE:
            raise InputError(f"world: silent for {PATIENCE:g} s at tick {k}")


def _fly_goals(
    goals: Goals, onboard: OnboardHalf, lcm: DrakeLcm, t: float, session: int, checkpoint: Path | None
) -> np.ndarray | None:
    """Do what the goals ask for from the tick at t on; return x, y (2) of one that is taken."""
    step = goals.step(t, onboard.path)
    if step.path:
        onboard.fly_path(step.path)
        if checkpoint:
            save_path(checkpoint, session, step.path)
    for answer in step.answers:
        lcm.Publish(CHANNELS["goal"], encode_goal(answer))
    return step.taken


def join_flight(onboard: OnboardHalf, checkpoint: Path | None, session: int, tick: int, h: float) -> None:
    """Go on in a flight that is at a tick already, from the checkpoint and its path if they are there and fit."""
    path = load_path(checkpoint, session) if checkpoint else None
    if path:
        onboard.fly_path(path)
    found = load_checkpoint(checkpoint, session, tick, h, onboard.state().size) if checkpoint else None
    onboard.resume(tick, found.state if found else None, (tick - found.tick) * h if found else np.inf)
