"""A bus of its own for a test, and an onboard half that answers on it."""

import time
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager

import pytest
from pydrake.lcm import DrakeLcm

from ortilo_drake.hil.halves import OnboardHalf
from ortilo_drake.hil.handshake import meet_world
from ortilo_drake.hil.lockstep_link import answer_over_link
from ortilo_drake.hil.packets import PORTS, Hello
from ortilo_drake.hil.transport import Inbox, open_lcm
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario


def bus_url(port: int) -> str:
    return f"udpm://239.255.76.67:{port}?ttl=0"


def open_bus(port: int) -> DrakeLcm:
    try:
        return open_lcm(bus_url(port))
    except InputError as error:
        pytest.skip(f"no multicast here: {error}")


def hear_hello(inbox: Inbox, wait: float = 60.0) -> Hello:
    """Return the first hello. pydrake waits with Python's lock held: whoever builds a half beside it would stand."""
    until = time.monotonic() + wait
    while time.monotonic() < until:
        for arrival in inbox.poll():
            if isinstance(arrival.packet.value, Hello):
                return arrival.packet.value
        time.sleep(0.005)
    raise TimeoutError(f"no hello in {wait:g} s")


@contextmanager
def answering(scenario: Scenario, port: int) -> Iterator["Future[int]"]:
    """Be the onboard half of one flight in lockstep, beside the caller; yield how many ticks it will have answered."""
    lcm = open_bus(port)
    inbox, onboard = Inbox(lcm, ("hello", "goal", "tick", *PORTS)), OnboardHalf(scenario)

    def answer() -> int:
        hear_hello(inbox)
        return answer_over_link(onboard, lcm, inbox, meet_world(lcm, inbox, scenario, 20.0).session)

    with ThreadPoolExecutor(1) as pool:
        answered = pool.submit(answer)
        yield answered
        answered.result(20.0)
