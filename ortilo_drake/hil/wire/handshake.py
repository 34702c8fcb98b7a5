"""The handshake: the two halves agree on protocol, scenario and session before a flight.

The world says hello ten times a second. An onboard half that hears the hello answers with a random number, its nonce.
The world flies with the first half that answers; from then on the world's hellos hold the nonce of that half. In flight
the world continues to say hello, with its tick. So an onboard half may join again, and listeners and users may join.
They take no packet that was sent before that tick.

A half with another version of the protocol or another scenario is refused with the reason; so is a second onboard half.
A process without the key does not get this far (bus.py).
"""

import hashlib
import secrets
import time
from collections.abc import Callable, Iterator
from typing import Final, NamedTuple

from ortilo_drake.hil.wire.bus import Bus
from ortilo_drake.hil.wire.inbox import Inbox
from ortilo_drake.hil.wire.limits import limits_of
from ortilo_drake.hil.wire.packets import FINISHED, FLYING, PROTOCOL, Hello, channel_of, encode_hello
from ortilo_drake.hil.wire.unpack import Flight
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario

PATIENCE: Final = 10.0  # a half that is silent for this time is given up [s]
OTHERS: Final = 1.0  # time to listen whether another onboard half flies [s]
EVERY: Final = 0.1  # period of hellos [s]
REFUSALS: Final = 6  # hellos to a world with another scenario before the onboard half ends; a relay may lose some


def scenario_digest(scenario: Scenario) -> str:
    """Return a digest of the onboard half's belief and room, which both halves must have in common."""
    text = scenario.belief.model_dump_json() + scenario.load_room().model_dump_json()
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def draw() -> int:
    """Return a positive random number of 62 bits for a session or a nonce; in practice no two are the same."""
    return secrets.randbelow(2**62) + 1


def flight_of(scenario: Scenario, session: int) -> Flight:
    """Return the Flight, with the number `session`, against which packets are checked."""
    shape = None
    if scenario.is_rendered:
        camera = scenario.load_room().camera.scaled_to(scenario.camera.width)
        shape = camera.height, camera.width
    return Flight(session, scenario.h, shape, limits_of(scenario))


def say_hello(bus: Bus, hello: Hello) -> None:
    """Publish a hello."""
    bus.publish(channel_of("hello"), encode_hello(hello))


def refusal(hello: Hello, digest: str) -> str:
    """Return the reason why a hello is not from our other half; empty if it is from our other half."""
    if hello.protocol != PROTOCOL:
        return f"speaks protocol {hello.protocol}, this half {PROTOCOL}: install the same version for both"
    if hello.scenario_digest != digest:
        return (
            f"flies another scenario ({hello.scenario_digest}, this half {digest}): "
            "give both the same scenario; only settings that the world alone reads may differ"
        )
    return ""


def unheard(inbox: Inbox, wait: float, command: str) -> str:
    """Return a line about a missing other half: how to start it, and whether connections with other keys came."""
    strangers = inbox.counts().refused.get("key", 0)
    other = f"; {strangers} connections were refused: give both halves the same --key" if strangers else ""
    return f"not heard in {wait:g} s; start it with: {command}{other}"


def _looks(wait: float) -> Iterator[float]:
    """Yield the time of time.monotonic() [s] again and again, for the last time once `wait` [s] are over.

    So a process that stood still for longer than its wait still looks at the packets that came meanwhile.
    """
    until = time.monotonic() + wait
    while True:
        now = time.monotonic()
        yield now
        if now >= until:
            return


class MetFlight(NamedTuple):
    """A flight under way that a process has found, whether it flies in lockstep, and its tick at that moment.

    `is_chosen` says whether the world flies with this process as its onboard half.
    """

    flight: Flight
    lockstep: bool
    tick: int
    is_chosen: bool


def find_world(bus: Bus, inbox: Inbox, scenario: Scenario, wait: float, role: str = "user") -> MetFlight:
    """Find a world and its flight within `wait` [s]; the inbox, which must hear hello, then takes the flight's packets.

    `role` is "user", or "onboard" to fly the flight. The function waits for a world that still searches for its onboard
    half. InputError if the world is not heard, finds no onboard half, or flies another scenario than this process.
    """
    digest, nonce = scenario_digest(scenario), draw()
    last_sent, answer = -1.0, None
    for now in _looks(wait):
        for arrival in inbox.poll(round(1e3 * EVERY)):
            hello = arrival.packet.value
            if hello.role != "world" or hello.state == FINISHED:
                continue
            answer = Hello(role, digest, hello.session, nonce=nonce)
            if why := refusal(hello, digest):
                for _ in range(REFUSALS if role == "onboard" else 0):
                    say_hello(bus, answer)
                    time.sleep(EVERY / 2.0)
                raise InputError(f"world: {why}")
            if hello.state == FLYING:
                flight, tick = flight_of(scenario, hello.session), max(hello.tick, 0)
                inbox.begin(flight, tick)
                return MetFlight(flight, hello.lockstep, tick, hello.nonce == nonce)
        if answer and now > last_sent + EVERY / 2.0:
            say_hello(bus, answer)
            last_sent = now
    if answer:
        raise InputError(f"world: found no onboard half in {wait:g} s; start it with: ortilo hil onboard")
    raise InputError(f"world: {unheard(inbox, wait, 'ortilo hil world')}")


def _is_commanded(bus: Bus, met: MetFlight) -> bool:
    """Return whether any onboard half commands a flight at this moment."""
    commands = Inbox(bus, ("command",))
    commands.begin(met.flight, met.tick)
    try:
        return any(commands.poll(10) for _ in _looks(OTHERS))
    finally:
        commands.leave()


def meet_world(bus: Bus, inbox: Inbox, scenario: Scenario, wait: float, last_session: int = 0) -> MetFlight:
    """Find a world to fly, as in find_world.

    This half joins `last_session`, the session that it flew when it was killed, again at once. Before it joins any
    other flight it listens whether another onboard half flies there; InputError if one does.
    """
    met = find_world(bus, inbox, scenario, wait, "onboard")
    if not met.is_chosen and met.flight.session != last_session and _is_commanded(bus, met):
        raise InputError("world: flies with another onboard half already")
    return met


class Greeter:
    """The hellos of a scenario's world; in lockstep the world waits for every answer."""

    def __init__(self, bus: Bus, scenario: Scenario, lockstep: bool):
        self._bus, self._scenario = bus, scenario
        self._hello = Hello("world", scenario_digest(scenario), draw(), lockstep)

    @property
    def session(self) -> int:
        """The number of the flight."""
        return self._hello.session

    def is_answer(self, hello: Hello) -> bool:
        """Return whether a hello answers this world."""
        return hello.role != "world" and hello.session == self.session

    def meet(self, nonce: int) -> Flight:
        """Choose the onboard half with a nonce, which all later hellos hold; return the flight."""
        self._hello = self._hello._replace(state=FLYING, nonce=nonce)
        return flight_of(self._scenario, self.session)

    def say(self, tick: int = -1, state: str = "") -> None:
        """Say hello at a tick; `state`, if given, replaces the present state."""
        self._hello = self._hello._replace(tick=tick, state=state or self._hello.state)
        say_hello(self._bus, self._hello)


def meet_onboard(
    greeter: Greeter,
    inbox: Inbox,
    scenario: Scenario,
    wait: float,
    check_alive: Callable[[], None] = lambda: None,
) -> Flight:
    """Find the onboard half within `wait` [s] and return the flight; the inbox then takes the flight's packets.

    Meanwhile `check_alive` is called with each hello; it raises if the onboard half will not come. InputError if the
    onboard half is not heard, or flies another scenario.
    """
    digest = scenario_digest(scenario)
    last_sent = -1.0
    for now in _looks(wait):
        if now > last_sent + EVERY:
            check_alive()
            greeter.say()
            last_sent = now
        for arrival in inbox.poll(round(1e3 * EVERY)):
            hello = arrival.packet.value
            if not greeter.is_answer(hello) or hello.role != "onboard":
                continue
            if why := refusal(hello, digest):
                raise InputError(f"onboard half: {why}")
            flight = greeter.meet(hello.nonce)
            inbox.begin(flight)
            greeter.say()
            return flight
    raise InputError(f"onboard half: {unheard(inbox, wait, 'ortilo hil onboard')}")
