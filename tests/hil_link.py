"""Buses that no other test on this machine has, and an onboard half that answers on one."""

import secrets
import socket
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

from waiting import HANGS

from ortilo_drake.flight.stepped_halves import OnboardHalf
from ortilo_drake.hil.lockstep_link import answer_over_link
from ortilo_drake.hil.wire import bus as library
from ortilo_drake.hil.wire.bus import Bus
from ortilo_drake.hil.wire.greeter import Greeter
from ortilo_drake.hil.wire.handshake import draw, flight_of, meet_world
from ortilo_drake.hil.wire.inbox import Inbox
from ortilo_drake.hil.wire.packet_checks import Flight
from ortilo_drake.hil.wire.packets import Goal, Hello, ports
from ortilo_drake.hil.wire.wire import Outbox
from ortilo_drake.scenario import Scenario, load_scenario

KEY, FLIGHT_KEY = 32 * b"k", 32 * b"f"  # that the halves share, and of a flight
_OPEN: list[Bus] = []
PORTS_TO_TRY = range(20_000, 32_000)  # below those that the kernel hands out by itself


@contextmanager
def own_bus() -> Iterator[str]:
    """Yield the URL of a bus whose port is this test's until it ends, whatever else runs on this machine.

    A datagram's port can be shared, and no process sees who else listens there. A TCP port of the same number cannot:
    the one who holds it has the bus.
    """
    while True:
        port = PORTS_TO_TRY[secrets.randbelow(len(PORTS_TO_TRY))]  # anew each time: late packets reach no later test
        with socket.socket() as held, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
            try:
                held.bind(("127.0.0.1", port))
                listener.bind(("", port))
            except OSError:
                continue
            listener.close()
            try:
                yield f"udpm://239.255.76.67:{port}?ttl=0"
            finally:
                while _OPEN:
                    _OPEN.pop().close()
            return


def open_bus(url: str) -> Bus:
    """Open a bus, which is closed with the test's own."""
    _OPEN.append(library.open_bus(url))
    return _OPEN[-1]


def key_file(folder: Path) -> Path:
    """Write KEY to a file in a folder and return it."""
    file = folder / "key"
    file.touch(0o600)
    file.write_text(KEY.hex())
    return file


def flight_for_packets(session: int = 77, shape: tuple[int, int] | None = None) -> Flight:
    """Return a flight of nominal_imu_uwb_yolo, 30 Hz, under FLIGHT_KEY, whose pictures have a shape."""
    scenario = load_scenario("nominal_imu_uwb_yolo", ("camera.kind=projected",))
    return flight_of(scenario, session, FLIGHT_KEY)._replace(shape=shape)


class PlayedWorld:
    """A world under way, as far as those see it who join it or listen; it hears hello and goals."""

    def __init__(self, url: str, scenario: Scenario):
        joined = open_bus(url)
        self.inbox, self._greeter = Inbox(joined, ("hello", "goal"), KEY), Greeter(joined, KEY, scenario, False)
        self.flight = self._greeter.meet(draw())
        self.inbox.begin(self.flight)
        self.outbox = Outbox(joined, self.flight.session, self.flight.key)

    def turn(self, tick: int, state: str = "") -> list[Goal]:
        """Say hello at a tick; return the goals that users asked for since the last turn."""
        heard = [arrival.packet.value for arrival in self.inbox.poll()]
        for hello in heard:
            if isinstance(hello, Hello):
                self._greeter.hear(hello)
        self._greeter.say(tick, state)
        return [goal for goal in heard if isinstance(goal, Goal) and goal.role == "user"]


@contextmanager
def answering(scenario: Scenario, bus: str) -> Iterator["Future[int]"]:
    """Be the onboard half of one flight in lockstep, beside the caller; yield how many ticks it will have answered."""
    joined = open_bus(bus)
    inbox, onboard = Inbox(joined, ("hello", "goal", "tick", *ports()), KEY), OnboardHalf(scenario)

    def answer() -> int:
        flight = meet_world(joined, inbox, scenario, KEY, HANGS).flight
        return answer_over_link(onboard, Outbox(joined, flight.session, flight.key), inbox)

    with ThreadPoolExecutor(1) as pool:
        answered = pool.submit(answer)
        yield answered
        answered.result(HANGS)
