"""A flight that is under way, met by another onboard half and by its own."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest
from hil_link import PlayedWorld, open_bus
from waiting import HANGS

from ortilo_drake.hil.wire.handshake import MetFlight, meet_world
from ortilo_drake.hil.wire.inbox import Inbox
from ortilo_drake.hil.wire.packets import PORTS, publish_command
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import load_scenario

SCENARIO = load_scenario("nominal_imu_uwb")


@contextmanager
def a_flight(bus: str, is_commanded: bool) -> Iterator[int]:
    """A world's heartbeat on the bus, and the commands of an onboard half; yield the session."""
    world, over = PlayedWorld(bus, SCENARIO), threading.Event()

    def fly() -> None:
        tick = 100
        while not over.wait(0.02):
            world.turn(tick)
            if is_commanded:
                publish_command(world.outbox, tick, {"control": np.zeros(4)})
            tick += 1

    thread = threading.Thread(target=fly, daemon=True)
    thread.start()
    try:
        yield world.flight.session
    finally:
        over.set()
        thread.join(HANGS)


def join(bus: str, flew: int) -> MetFlight:
    joined = open_bus(bus)
    return meet_world(joined, Inbox(joined, ("hello", "tick", *PORTS)), SCENARIO, HANGS, flew)


def test_another_onboard_half_is_refused(bus: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ortilo_drake.hil.wire.handshake.OTHERS", HANGS)
    with a_flight(bus, is_commanded=True), pytest.raises(InputError, match="flies with another onboard half already"):
        join(bus, 0)


def test_a_flight_that_nobody_commands_is_joined(bus: str) -> None:
    with a_flight(bus, is_commanded=False) as session:
        met = join(bus, 0)
    assert (met.flight.session, met.is_chosen) == (session, False)
    assert met.tick >= 100


def test_its_own_flight_is_joined_at_once(bus: str) -> None:
    with a_flight(bus, is_commanded=True) as session:  # what is still on the wire of the half that was killed
        assert join(bus, session).flight.session == session
