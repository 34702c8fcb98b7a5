"""Who meets whom: the two halves agree on protocol, scenario and session before a flight.

The world says hello ten times a second until the onboard half says it back with the world's session number; in real
time it goes on saying it in flight, for an onboard half that has to join it again. A half that speaks another version
of the protocol, or flies another scenario, is refused by name; so is a second onboard half.
"""

import hashlib
import secrets
import time
from collections.abc import Callable
from typing import Final

from ortilo_drake.hil.bus import Bus, open_bus
from ortilo_drake.hil.inbox import Inbox
from ortilo_drake.hil.packet_checks import Flight
from ortilo_drake.hil.packets import CHANNELS, FINISHED, FLYING, PROTOCOL, Hello, encode_hello
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario

PATIENCE: Final = 10.0  # silence after which the other half is given up [s]
REFUSALS: Final = 6  # how often the onboard half says no before it ends: one may meet the world's own hello
OTHERS: Final = 1.0  # how long to listen whether another onboard half flies [s]
_EVERY_MS: Final = 100


def scenario_digest(scenario: Scenario) -> str:
    """Return what both halves must have in common: a digest of the scenario with its seed, and of its room."""
    text = scenario.model_dump_json() + scenario.load_room().model_dump_json()
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def flight_of(scenario: Scenario, session: int) -> Flight:
    """Return what packets of a flight are checked against."""
    room = scenario.load_room()
    shape = None
    if scenario.is_rendered:
        camera = room.camera.scaled_to(scenario.rendered_camera.width)
        shape = camera.height, camera.width
    return Flight(session, scenario.h, len(room.anchors), shape, len(room.classes))


def say_hello(bus: Bus, hello: Hello) -> None:
    """Publish a hello."""
    bus.publish(CHANNELS["hello"], encode_hello(hello))


def refusal(hello: Hello, digest: str) -> str:
    """Return why a hello is not from our other half; empty if it is."""
    if hello.protocol != PROTOCOL:
        return f"speaks protocol {hello.protocol}, this half {PROTOCOL}"
    if hello.scenario_digest != digest:
        return (
            f"flies another scenario ({hello.scenario_digest}, this half {digest}): give both the same, seed included"
        )
    return ""


def meet_onboard(
    bus: Bus,
    inbox: Inbox,
    scenario: Scenario,
    lockstep: bool,
    wait: float,
    still_there: Callable[[], None] = lambda: None,
) -> int:
    """Find the onboard half; return the session that the world chose.

    Args:
        bus: the bus.
        inbox: hears hello; from now on it takes this flight's packets.
        scenario: the scenario of this half.
        lockstep: how the world wants to fly.
        wait: how long to look for it [s].
        still_there: called again and again meanwhile; raises if it will not come.

    Raises:
        InputError: if the onboard half is not there, or is another's.
    """
    session, digest = secrets.randbelow(2**62) + 1, scenario_digest(scenario)
    inbox.begin(flight_of(scenario, session))
    until, said = time.monotonic() + wait, -1.0
    while (now := time.monotonic()) < until:
        if now > said + 1e-3 * _EVERY_MS:  # not whenever something is heard: it hears itself
            still_there()
            say_hello(bus, Hello("world", digest, session, lockstep))
            said = now
        for arrival in inbox.poll(_EVERY_MS):
            hello = arrival.packet.value
            if not isinstance(hello, Hello) or hello.role != "onboard" or hello.session != session:
                continue
            if why := hello.reason or refusal(hello, digest):
                raise InputError(f"onboard half: {why}")
            return session
    raise InputError(f"onboard half: not heard in {wait:g} s; start it with: ortilo hil onboard")


def _hear_world(inbox: Inbox, wait: float) -> Hello:
    """Return the first hello of a world whose flight is not over; InputError if none comes."""
    inbox.poll()  # what came while nobody listened may be of a world that has gone
    until = time.monotonic() + wait
    while time.monotonic() < until:
        for arrival in inbox.poll(_EVERY_MS):
            hello = arrival.packet.value
            if isinstance(hello, Hello) and hello.role == "world" and hello.state != FINISHED:
                return hello
    raise InputError(f"world: not heard in {wait:g} s; start it with: ortilo hil world")


def _is_commanded(bus: Bus, flight: Flight) -> bool:
    """Return whether somebody commands a flight at the moment."""
    with open_bus(bus.url) as another:
        inbox = Inbox(another, ("command",), flight)
        until = time.monotonic() + OTHERS
        while time.monotonic() < until:
            if inbox.poll(10):
                return True
    return False


def meet_world(bus: Bus, inbox: Inbox, scenario: Scenario, wait: float, flew: int = 0) -> Hello:
    """Wait for the world's hello and say it back; return the world's.

    Arguments and errors as meet_onboard. flew is a session that this half was flying when it was killed: it joins that
    again at once; for any other that is under way it listens first whether somebody flies it.
    """
    digest = scenario_digest(scenario)
    hello = _hear_world(inbox, wait)
    if why := refusal(hello, digest):
        for _ in range(REFUSALS):
            say_hello(bus, Hello("onboard", digest, hello.session, hello.lockstep, reason=why))
            time.sleep(5e-4 * _EVERY_MS)
        raise InputError(f"world: {why}")
    if hello.state == FLYING and hello.session != flew and _is_commanded(bus, flight_of(scenario, hello.session)):
        raise InputError("world: flies with another onboard half already")
    inbox.begin(flight_of(scenario, hello.session))
    say_hello(bus, Hello("onboard", digest, hello.session, hello.lockstep))
    return hello


def find_world(inbox: Inbox, scenario: Scenario, wait: float) -> Hello:
    """Wait for the world's hello without a word, as who is neither half; return it.

    In real time the world repeats it in flight, in lockstep it is said only before.

    Raises:
        InputError: if the world is not heard or flies another scenario.
    """
    hello = _hear_world(inbox, wait)
    if why := refusal(hello, scenario_digest(scenario)):
        raise InputError(f"world: {why}")
    return hello
