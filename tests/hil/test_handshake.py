"""The handshake: the halves agree, or refuse each other by name."""

import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor

import numpy as np
import pytest
from hil_link import KEY, PlayedWorld, open_bus, settle, wait_for_message
from waiting import HANGS, wait_for

from ortilo_drake.hil.wire.bus import Bus
from ortilo_drake.hil.wire.handshake import Greeter, MetFlight, find_world, meet_onboard, meet_world
from ortilo_drake.hil.wire.inbox import Inbox
from ortilo_drake.hil.wire.packets import KINDS, PORTS, Outbox, publish_command
from ortilo_drake.hil.wire.unpack import Flight
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario, load_scenario

SCENARIO, OTHER = (
    load_scenario("nominal_imu_uwb"),
    load_scenario("nominal_imu_uwb", ("multilateration.method=nearest_three",)),
)
STRANGER = 32 * b"s"


def as_world(bus: str) -> Flight:
    with Bus(bus, KEY, serves=True) as joined:
        inbox = Inbox(joined, ("hello", "command", "telemetry"))
        return meet_onboard(Greeter(joined, SCENARIO, False), inbox, SCENARIO, HANGS)


def as_onboard(bus: str, scenario: Scenario = SCENARIO) -> MetFlight:
    with Bus(bus, KEY) as joined:
        return meet_world(joined, Inbox(joined, ("hello", "tick", *PORTS)), scenario, HANGS)


def both(world: Callable[[], Flight], onboard: Callable[[], MetFlight]) -> tuple["Future[Flight]", "Future[MetFlight]"]:
    with ThreadPoolExecutor(2) as pool:
        return pool.submit(world), pool.submit(onboard)


def test_the_halves_agree_on_a_session(bus: str) -> None:
    world, onboard = both(lambda: as_world(bus), lambda: as_onboard(bus))
    flight, met = world.result(), onboard.result()
    assert met.flight.session == flight.session
    assert (met.is_chosen, met.tick, met.lockstep) == (True, 0, False)


def test_no_two_flights_have_a_session_in_common(bus: str) -> None:
    sessions = {both(lambda: as_world(bus), lambda: as_onboard(bus))[0].result().session for _ in range(3)}
    assert len(sessions) == 3


def test_halves_of_two_scenarios_refuse_each_other_by_name(bus: str) -> None:
    world, onboard = both(lambda: as_world(bus), lambda: as_onboard(bus, scenario=OTHER))
    with pytest.raises(InputError, match=r"^onboard half: flies another scenario \("):
        world.result()
    with pytest.raises(InputError, match=r"^world: flies another scenario \("):
        onboard.result()


def test_halves_with_two_keys_do_not_meet_and_say_why(bus: str) -> None:
    served, stranger = open_bus(bus, serves=True), open_bus(bus, key=STRANGER)
    at_world, at_onboard = Inbox(served, ("hello",)), Inbox(stranger, ("hello",))

    def both_refused() -> bool:
        assert at_world.poll(5) == at_onboard.poll(5) == []
        return bool(served.refused["key"] and stranger.refused["key"])

    wait_for(both_refused, "connections are refused")
    said = r": not heard in 0.2 s; .*; \d+ connections were refused: give both"
    with pytest.raises(InputError, match=f"^onboard half{said}"):
        meet_onboard(Greeter(served, SCENARIO, False), at_world, SCENARIO, 0.2)
    with pytest.raises(InputError, match=f"^world{said}"):
        meet_world(stranger, at_onboard, SCENARIO, 0.2)


def test_who_stood_still_for_all_of_its_wait_hears_what_came_meanwhile(bus: str) -> None:
    world, joined = PlayedWorld(bus, SCENARIO), open_bus(bus)
    inbox = Inbox(joined, ("hello",))
    settle(world.bus, joined)
    world.turn(5)
    wait_for_message(joined)
    assert find_world(joined, inbox, SCENARIO, 0.0).tick == 5


def test_a_flight_takes_nothing_of_an_older_one(bus: str) -> None:
    world, joined = PlayedWorld(bus, SCENARIO), open_bus(bus)
    inbox = Inbox(joined, KINDS, world.flight)
    settle(world.bus, joined)
    old = Outbox(world.bus, world.flight.session ^ 1)
    for outbox in (old, world.outbox):
        publish_command(outbox, 3, {"control": np.zeros(4)})
    came = inbox.poll(1000)
    while len(came) + inbox.counts().rejected < 2:
        came += inbox.poll(10)
    assert [arrival.packet.name for arrival in came] == ["command"]
    assert inbox.counts().refused == {"foreign": 1}


def test_who_listens_waits_for_a_world_that_looks_for_its_half(bus: str) -> None:
    joined = open_bus(bus)
    with ThreadPoolExecutor(3) as pool:
        world = pool.submit(as_world, bus)
        user = pool.submit(find_world, joined, Inbox(joined, ("hello",)), SCENARIO, HANGS)
        time.sleep(0.3)
        assert not user.done()
        pool.submit(as_onboard, bus)
        assert user.result().flight.session == world.result().session


def test_a_world_without_its_half_is_told_of(bus: str) -> None:
    joined, over = open_bus(bus), threading.Event()
    inbox = Inbox(joined, ("hello",))

    def until_over() -> None:
        if over.is_set():
            raise InputError("over")

    def look() -> Flight:
        with Bus(bus, KEY, serves=True) as of_world:
            greeter = Greeter(of_world, SCENARIO, False)
            return meet_onboard(greeter, Inbox(of_world, ("hello",)), SCENARIO, HANGS, until_over)

    with ThreadPoolExecutor(1) as pool:
        world = pool.submit(look)
        try:
            wait_for(lambda: inbox.poll(10), "the world")
            wait_for_message(joined)  # however long the world's thread stands still now
            said = r"^world: found no onboard half in 0.2 s; start it with: ortilo hil onboard"
            with pytest.raises(InputError, match=said):
                find_world(joined, inbox, SCENARIO, 0.2)
        finally:
            over.set()
        with pytest.raises(InputError, match="over"):
            world.result()
