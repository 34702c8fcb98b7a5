"""The world's side of the handshake (handshake.py): it says hello, and flies with the first half to answer."""

import time
from collections.abc import Callable

from ortilo_drake.hil.wire.bus import Bus
from ortilo_drake.hil.wire.handshake import EVERY, draw, flight_of, refusal, say_hello, scenario_digest, unheard
from ortilo_drake.hil.wire.inbox import Inbox
from ortilo_drake.hil.wire.packet_checks import Flight
from ortilo_drake.hil.wire.packets import FLYING, Hello
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario


class Greeter:
    """The world's hellos.

    Args:
        bus: the bus.
        scenario: the world's scenario.
        lockstep: whether the world waits for every answer.
    """

    def __init__(self, bus: Bus, scenario: Scenario, lockstep: bool):
        self._bus, self._scenario = bus, scenario
        self._hello = Hello("world", scenario_digest(scenario), draw(), lockstep)

    @property
    def session(self) -> int:
        """The flight's number."""
        return self._hello.session

    def is_answer(self, hello: Hello) -> bool:
        """Return whether a hello answers this world."""
        return hello.role != "world" and hello.session == self.session

    def meet(self, nonce: int) -> Flight:
        """Fly with the onboard half of a nonce; return the flight, which every hello names from now on."""
        self._hello = self._hello._replace(state=FLYING, nonce=nonce)
        return flight_of(self._scenario, self.session)

    def say(self, tick: int = -1, state: str = "") -> None:
        """Say hello at a tick; a state, if given, replaces the present one."""
        self._hello = self._hello._replace(tick=tick, state=state or self._hello.state)
        say_hello(self._bus, self._hello)


def meet_onboard(
    greeter: Greeter,
    inbox: Inbox,
    scenario: Scenario,
    wait: float,
    check_alive: Callable[[], None] = lambda: None,
) -> Flight:
    """Find the onboard half, agree with it on a flight and return that.

    Args:
        greeter: says hello for the world.
        inbox: hears hello; from now on it takes this flight's packets.
        scenario: the scenario of this half.
        wait: how long to look for it [s].
        check_alive: called again and again meanwhile; raises if the onboard half will not come.

    Raises:
        InputError: if the onboard half is not there, or flies another scenario.
    """
    digest = scenario_digest(scenario)
    until, last_sent = time.monotonic() + wait, -1.0
    while (now := time.monotonic()) < until:
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
