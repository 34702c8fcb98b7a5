"""The handshake: the two halves agree on protocol, scenario, session and key before a flight.

The world says hello ten times a second. A process that hears it answers with a nonce that it drew. The world's hellos
list the nonces that it heard; once its own is among them, the process knows that the world speaks now and is no
recording. The world flies with the first onboard half that it hears. From then on its hellos hold that half's nonce;
nonce and session make the flight's key (seal.py). In flight the world goes on saying hello, with its tick: an onboard
half may join again, and listeners and users may join. They take nothing that was sent before that tick.

Hellos are sealed too. A half that speaks another version of the protocol, or flies another scenario, is refused by
name; so is a second onboard half.
"""

import hashlib
import secrets
import time
from typing import Final, NamedTuple

from ortilo_drake.hil.wire.bus import Bus, open_bus
from ortilo_drake.hil.wire.inbox import Inbox
from ortilo_drake.hil.wire.limits import limits_of
from ortilo_drake.hil.wire.packet_checks import Flight
from ortilo_drake.hil.wire.packets import FINISHED, LOOKING, PROTOCOL, Hello, channel_of, encode_hello
from ortilo_drake.hil.wire.seal import flight_key, hello_key, seal
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario

PATIENCE: Final = 10.0  # after which a silent half is given up [s]
OTHERS: Final = 1.0  # how long to listen whether another onboard half flies [s]
EVERY: Final = 0.1  # between two hellos [s]


def scenario_digest(scenario: Scenario) -> str:
    """Return a digest of what the onboard half believes, its room included, which both halves must have in common."""
    text = scenario.belief.model_dump_json() + scenario.load_room().model_dump_json()
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def draw() -> int:
    """Return a positive random number of 62 bits, for a session or a nonce: no two are the same in practice."""
    return secrets.randbelow(2**62) + 1


def flight_of(scenario: Scenario, session: int, key: bytes) -> Flight:
    """Return the description of a flight that its packets are checked against.

    Args:
        scenario: the scenario.
        session: the flight's number.
        key: of the flight, see seal.flight_key.
    """
    room = scenario.load_room()
    shape = None
    if scenario.is_rendered:
        camera = room.camera.scaled_to(scenario.camera.width)
        shape = camera.height, camera.width
    return Flight(session, key, scenario.h, len(room.anchors), shape, limits_of(scenario))


def say_hello(bus: Bus, key: bytes, hello: Hello) -> None:
    """Publish a hello.

    Args:
        bus: the bus.
        key: that the halves share.
        hello: what to say.
    """
    bus.publish(channel_of("hello"), seal(hello_key(key), "hello", encode_hello(hello)))


def refusal(hello: Hello, digest: str) -> str:
    """Return why a hello is not from our other half; empty if it is."""
    if hello.protocol != PROTOCOL:
        return f"speaks protocol {hello.protocol}, this half {PROTOCOL}"
    if hello.scenario_digest != digest:
        return (
            f"flies another scenario ({hello.scenario_digest}, this half {digest}): "
            "give both the same but for what only the world knows"
        )
    return ""


def unheard(inbox: Inbox, wait: float, command: str) -> str:
    """Return a line that nobody was heard, how to start the other half, and whether one with another key was heard."""
    strangers = inbox.counts().refused.get("mac", 0)
    other = f"; {strangers} packets came under another key: give both halves the same --key" if strangers else ""
    return f"not heard in {wait:g} s; start it with: {command}{other}"


class MetFlight(NamedTuple):
    """A flight under way that a process has met.

    Attributes:
        flight: the flight.
        lockstep: whether the world waits for every answer.
        tick: the world's tick at that moment.
        is_chosen: whether the world flies with this process as its onboard half.
    """

    flight: Flight
    lockstep: bool
    tick: int
    is_chosen: bool


def find_world(bus: Bus, inbox: Inbox, scenario: Scenario, key: bytes, wait: float, role: str = "user") -> MetFlight:
    """Find a world and the flight it flies; from now on the inbox takes that flight's packets.

    A world that is still looking for its onboard half is waited for.

    Args:
        bus: the bus.
        inbox: hears hello.
        scenario: the scenario of this process.
        key: that the halves share.
        wait: how long to look for it [s].
        role: "user", or "onboard" to fly it.

    Raises:
        InputError: if the world is not heard, has no onboard half, or flies another scenario.
    """
    digest, nonce, sequence = scenario_digest(scenario), draw(), 0
    inbox.poll()  # dropped: packets that came earlier may be of a world that has gone
    until, last_sent, world_hello, is_there = time.monotonic() + wait, -1.0, None, False
    while (now := time.monotonic()) < until:
        for arrival in inbox.poll(round(1e3 * EVERY)):
            hello = arrival.packet.value
            if hello.role != "world" or hello.state == FINISHED:
                continue
            world_hello = hello
            if nonce not in hello.heard:
                continue
            if why := refusal(hello, digest):
                raise InputError(f"world: {why}")
            is_there = True
            if hello.state != LOOKING:
                flight = flight_of(scenario, hello.session, flight_key(key, hello.session, hello.nonce, digest))
                tick = max(hello.tick, 0)
                inbox.begin(flight, tick)
                return MetFlight(flight, hello.lockstep, tick, hello.nonce == nonce)
        if world_hello and now > last_sent + EVERY / 2.0:
            sequence += 1
            say_hello(bus, key, Hello(role, digest, world_hello.session, nonce=nonce, sequence=sequence))
            last_sent = now
    if is_there:
        raise InputError(f"world: found no onboard half in {wait:g} s; start it with: ortilo hil onboard")
    raise InputError(f"world: {unheard(inbox, wait, 'ortilo hil world')}")


def _is_commanded(bus: Bus, key: bytes, met: MetFlight) -> bool:
    """Return whether somebody commands a flight at the moment."""
    with open_bus(bus.url) as another:
        inbox = Inbox(another, ("command",), key)
        inbox.begin(met.flight, met.tick)
        until = time.monotonic() + OTHERS
        while time.monotonic() < until:
            if inbox.poll(10):
                return True
    return False


def meet_world(bus: Bus, inbox: Inbox, scenario: Scenario, key: bytes, wait: float, last_session: int = 0) -> MetFlight:
    """Find a world to fly, as find_world, and fly it.

    Args:
        bus: the bus.
        inbox: hears hello; from now on it takes this flight's packets.
        scenario: the scenario of this half.
        key: that the halves share.
        wait: how long to look for it [s].
        last_session: the session that this half flew when it was killed, which it joins again at once. Before it joins
            any other flight it listens whether another onboard half flies that.

    Raises:
        InputError: as find_world, and if another does.
    """
    met = find_world(bus, inbox, scenario, key, wait, "onboard")
    if not met.is_chosen and met.flight.session != last_session and _is_commanded(bus, key, met):
        raise InputError("world: flies with another onboard half already")
    return met
