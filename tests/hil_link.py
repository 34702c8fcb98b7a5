"""Buses that no other test on this machine has, and an onboard half that answers on one."""

import secrets
import socket
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager

from waiting import HANGS, wait_for

from ortilo_drake.hil import bus as library
from ortilo_drake.hil.bus import Bus
from ortilo_drake.hil.halves import OnboardHalf
from ortilo_drake.hil.handshake import meet_world
from ortilo_drake.hil.inbox import Inbox
from ortilo_drake.hil.lockstep_link import answer_over_link
from ortilo_drake.hil.packets import PORTS, Hello
from ortilo_drake.scenario import Scenario

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


def hear_hello(inbox: Inbox) -> Hello:
    """Return the first hello."""

    def hellos() -> list[Hello]:
        values = [arrival.packet.value for arrival in inbox.poll()]
        return [value for value in values if isinstance(value, Hello)]

    return wait_for(hellos, "a hello")[0]


@contextmanager
def answering(scenario: Scenario, bus: str) -> Iterator["Future[int]"]:
    """Be the onboard half of one flight in lockstep, beside the caller; yield how many ticks it will have answered."""
    joined = open_bus(bus)
    inbox, onboard = Inbox(joined, ("hello", "goal", "tick", *PORTS)), OnboardHalf(scenario)

    def answer() -> int:
        hear_hello(inbox)
        return answer_over_link(onboard, joined, inbox, meet_world(joined, inbox, scenario, HANGS).session)

    with ThreadPoolExecutor(1) as pool:
        answered = pool.submit(answer)
        yield answered
        answered.result(HANGS)
