"""The handshake, which neither a stranger nor a recording passes."""

import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor

import numpy as np
import pytest
from hil_link import KEY, PlayedWorld, open_bus

from ortilo_drake.hil.wire.bus import Bus
from ortilo_drake.hil.wire.greeter import Greeter, meet_onboard
from ortilo_drake.hil.wire.handshake import MetFlight, draw, find_world, meet_world, say_hello
from ortilo_drake.hil.wire.inbox import Inbox
from ortilo_drake.hil.wire.packet_checks import Flight
from ortilo_drake.hil.wire.packets import FINISHED, FLYING, KINDS, PORTS, Hello, channel_of
from ortilo_drake.hil.wire.seal import seal
from ortilo_drake.hil.wire.wire import Outbox, publish_command, publish_messages
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario, load_scenario

SCENARIO, OTHER = (
    load_scenario("nominal_imu_uwb"),
    load_scenario("nominal_imu_uwb", ("multilateration.method=nearest_three",)),
)
STRANGER = 32 * b"s"


def as_world(bus: str, key: bytes = KEY, scenario: Scenario = SCENARIO, wait: float = 60.0) -> Flight:
    joined = open_bus(bus)
    inbox = Inbox(joined, ("hello", "command", "telemetry"), key)
    return meet_onboard(Greeter(joined, key, scenario, False), inbox, scenario, wait)


def as_onboard(bus: str, key: bytes = KEY, scenario: Scenario = SCENARIO, wait: float = 60.0) -> MetFlight:
    joined = open_bus(bus)
    return meet_world(joined, Inbox(joined, ("hello", "tick", *PORTS), key), scenario, key, wait)


def both(world: Callable[[], Flight], onboard: Callable[[], MetFlight]) -> tuple["Future[Flight]", "Future[MetFlight]"]:
    with ThreadPoolExecutor(2) as pool:
        return pool.submit(world), pool.submit(onboard)


def recorded(bus: Bus) -> list[tuple[str, bytes]]:
    """Record everything on a bus from now on, each packet with its channel."""
    heard: list[tuple[str, bytes]] = []
    for channel in map(channel_of, KINDS):
        bus.subscribe(channel, lambda data, channel=channel: heard.append((channel, data)))
    return heard


def test_the_halves_agree_on_session_and_key(bus: str) -> None:
    world, onboard = both(lambda: as_world(bus), lambda: as_onboard(bus))
    flight, met = world.result(), onboard.result()
    assert (met.flight.session, met.flight.key) == (flight.session, flight.key)
    assert (met.is_chosen, met.tick, met.lockstep) == (True, 0, False)


def test_no_two_flights_have_a_key_in_common(bus: str) -> None:
    keys = {both(lambda: as_world(bus), lambda: as_onboard(bus))[0].result().key for _ in range(3)}
    assert len(keys) == 3


def test_halves_of_two_scenarios_refuse_each_other_by_name(bus: str) -> None:
    world, onboard = both(lambda: as_world(bus), lambda: as_onboard(bus, scenario=OTHER))
    with pytest.raises(InputError, match=r"^onboard half: flies another scenario \("):
        world.result()
    with pytest.raises(InputError, match=r"^world: flies another scenario \("):
        onboard.result()


def test_halves_with_two_keys_do_not_meet_and_say_why(bus: str) -> None:
    world, onboard = both(lambda: as_world(bus, wait=3.0), lambda: as_onboard(bus, STRANGER, wait=3.0))
    with pytest.raises(InputError, match=r"^world: not heard in 3 s; .*; \d+ packets came under another key"):
        onboard.result()
    with pytest.raises(InputError, match=r"^onboard half: not heard in 3 s; start it with: ortilo hil onboard$"):
        world.result()  # nobody answers whom he does not understand


def test_a_recorded_world_is_not_met(bus: str) -> None:
    tape = recorded(listener := open_bus(bus))
    both(lambda: as_world(bus), lambda: as_onboard(bus))
    while listener.handle(50):
        pass
    hellos = [data for channel, data in tape if channel == channel_of("hello")]
    assert len(hellos) >= 3
    over, player = threading.Event(), open_bus(bus)

    def play() -> None:
        while not over.wait(0.01):
            for data in hellos:
                player.publish(channel_of("hello"), data)

    thread = threading.Thread(target=play, daemon=True)
    thread.start()
    try:
        with pytest.raises(InputError, match=r"^world: not heard in 1 s"):
            as_onboard(bus, wait=1.0)
        with pytest.raises(InputError, match=r"^onboard half: not heard in 1 s"):
            as_world(bus, wait=1.0)
        # The living meet beside it.
        world, onboard = both(lambda: as_world(bus), lambda: as_onboard(bus))
        assert onboard.result().flight.key == world.result().key
    finally:
        over.set()
        thread.join(10.0)


def test_a_flight_takes_nothing_of_an_older_one_nor_of_a_stranger(bus: str) -> None:
    tape = recorded(listener := open_bus(bus))
    old, now = PlayedWorld(bus, SCENARIO), PlayedWorld(bus, SCENARIO)
    publish_command(old.outbox, 3, {"control": np.zeros(4)})
    publish_messages(old.outbox, 3, {"imu": np.concatenate(([1.0, 3 * SCENARIO.h], np.zeros(9)))})
    old.turn(3, FINISHED)
    while listener.handle(50):
        pass
    joined = open_bus(bus)
    inbox = Inbox(joined, KINDS, KEY, now.flight)
    for channel, data in tape:
        joined.publish(channel, data)
        name = channel.removeprefix("ORTILO_").lower()
        body = data[:-32]
        if name != "hello":  # with the number of this flight, which everybody hears
            body = body[:8] + now.flight.session.to_bytes(8, "big") + body[16:]
        for key in (STRANGER, KEY, old.flight.key):
            joined.publish(channel, seal(key, name, body))
    assert inbox.poll() == []
    refused = inbox.counts().refused
    assert refused == {"foreign": len(tape), "mac": 3 * len(tape)}
    publish_command(now.outbox, 3, {"control": np.zeros(4)})
    assert len(inbox.poll(1000)) == 1


def test_nobody_without_the_key_ends_refuses_or_commands_a_flight(bus: str) -> None:
    world = PlayedWorld(bus, SCENARIO)
    joined = open_bus(bus)
    onboard = Inbox(joined, ("hello", "goal", "tick", *PORTS), KEY, world.flight)
    session, digest = world.flight.session, 16 * "0"
    for key in (STRANGER, bytes(32)):
        for state in (FINISHED, FLYING):
            say_hello(joined, key, Hello("world", digest, session, state=state, sequence=10**6))
        say_hello(joined, key, Hello("onboard", digest, session, nonce=draw(), sequence=10**6))
        stranger = Outbox(joined, session, key)
        publish_command(stranger, 1, {"control": np.zeros(4)})
        publish_messages(stranger, 1, {})
    for inbox in (onboard, world.inbox):
        assert inbox.poll() == []
    assert onboard.counts().refused == {"mac": 8}
    assert world.inbox.counts().refused == {"mac": 6}


def test_a_packet_that_is_thrown_back_is_not_the_other_half_s(bus: str) -> None:
    world, joined = PlayedWorld(bus, SCENARIO), open_bus(bus)
    inbox = Inbox(joined, KINDS, KEY, world.flight)
    imu = np.concatenate(([1.0, 3 * SCENARIO.h], np.zeros(9)))
    captured: list[bytes] = []
    joined.subscribe(channel_of("imu"), captured.append)
    publish_messages(world.outbox, 3, {"imu": imu})
    assert len(inbox.poll(1000)) == 2
    for name, channel in ((n, channel_of(n)) for n in KINDS):
        if name != "imu":
            joined.publish(channel, captured[0])
    assert inbox.poll() == []
    assert inbox.counts().rejected == len(KINDS) - 1


def test_who_listens_waits_for_a_world_that_looks_for_its_half(bus: str) -> None:
    joined = open_bus(bus)
    with ThreadPoolExecutor(3) as pool:
        world = pool.submit(as_world, bus)
        user = pool.submit(find_world, joined, Inbox(joined, ("hello",), KEY), SCENARIO, KEY, 60.0)
        time.sleep(0.3)
        assert not user.done()
        pool.submit(as_onboard, bus)
        assert user.result().flight.key == world.result().key


def test_a_world_without_its_half_is_told_of(bus: str) -> None:
    joined, over = open_bus(bus), threading.Event()

    def until_over() -> None:
        if over.is_set():
            raise InputError("over")

    def look() -> Flight:
        of_world = open_bus(bus)
        greeter = Greeter(of_world, KEY, SCENARIO, False)
        return meet_onboard(greeter, Inbox(of_world, ("hello",), KEY), SCENARIO, 60.0, until_over)

    with ThreadPoolExecutor(1) as pool:
        world = pool.submit(look)
        with pytest.raises(
            InputError, match=r"^world: found no onboard half in 3 s; start it with: ortilo hil onboard"
        ):
            find_world(joined, Inbox(joined, ("hello",), KEY), SCENARIO, KEY, 3.0)
        over.set()
        with pytest.raises(InputError, match="over"):
            world.result()
