"""The onboard half in real time: it ticks with the world while packets arrive, and by its own clock otherwise.

onboard_ticks.py decides when it ticks and which messages it takes.
"""

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ortilo_drake.flight.signals import Record
from ortilo_drake.flight.stepped_halves import OnboardHalf
from ortilo_drake.hil.goals.goals import Goals
from ortilo_drake.hil.real_time.detector_thread import DetectorThread
from ortilo_drake.hil.real_time.onboard_ticks import OnboardTicks
from ortilo_drake.hil.reports import OnboardFigures
from ortilo_drake.hil.restart.checkpoint import Checkpoint, load_checkpoint, load_path, save_checkpoint, save_path
from ortilo_drake.hil.restart.until_it_fails import UntilItFails
from ortilo_drake.hil.wire.handshake import PATIENCE
from ortilo_drake.hil.wire.inbox import Inbox
from ortilo_drake.hil.wire.packets import FINISHED, Outbox, publish_command, publish_goal, publish_telemetry
from ortilo_drake.scenario import Scenario


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
