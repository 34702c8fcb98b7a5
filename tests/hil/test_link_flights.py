"""Lockstep over a link that loses, delays, doubles and reorders packets is still the flight of a single process."""

import threading
from concurrent.futures import ThreadPoolExecutor

import pytest
import xarray as xr

from ortilo_drake.experiments.flight import fly
from ortilo_drake.hil.faults import Faults
from ortilo_drake.hil.halves import OnboardHalf
from ortilo_drake.hil.handshake import FINISHED, meet_onboard, meet_world, say_hello, scenario_digest
from ortilo_drake.hil.lockstep import fly_lockstep
from ortilo_drake.hil.lockstep_link import answer_over_link, ask_over_link
from ortilo_drake.hil.packets import PORTS, Hello
from ortilo_drake.hil.relay import run_relay
from ortilo_drake.hil.transport import Inbox, open_lcm
from ortilo_drake.scenario import Scenario, load_scenario

BUS = "udpm://239.255.76.67:{port}?ttl=0"
BAD = Faults(loss=0.2, delay=0.004, spread=0.003, duplicate=0.2, held=0.1, hold=0.02)
FAREWELLS = 40  # each may be lost: all of them with a probability of 1e-28


def answer(scenario: Scenario, url: str, listening: threading.Event) -> int:
    """Be the onboard half; return how many ticks were answered."""
    lcm = open_lcm(url)
    inbox = Inbox(lcm, ("hello", "tick", *PORTS))
    onboard = OnboardHalf(scenario)
    listening.set()
    session = meet_world(lcm, inbox, scenario, 20.0).session
    return answer_over_link(onboard, lcm, inbox, session)


def ask(scenario: Scenario, url: str) -> tuple[xr.Dataset, int]:
    """Be the world; return the flight and the number of packets that came twice."""
    lcm = open_lcm(url)
    inbox = Inbox(lcm, ("hello", "command", "telemetry"))
    session = meet_onboard(lcm, inbox, scenario, True, 20.0)
    flight = fly_lockstep(scenario, ask_over_link(lcm, inbox, session))
    for _ in range(FAREWELLS):
        say_hello(lcm, Hello("world", scenario_digest(scenario), session, True, FINISHED))
    return flight, inbox.counts()["duplicates"]


@pytest.mark.parametrize(("name", "port"), [("imu_uwb", 7761), ("imu_uwb_yolo", 7763)])
def test_a_bad_link_costs_time_but_not_a_bit(name: str, port: int) -> None:
    short = ("settle=0", "planner={kind: hover, duration: 0.5}")
    scenario = load_scenario(name, (*short, "camera=projected") if name == "imu_uwb_yolo" else short)
    alone = fly(scenario)
    del alone.attrs["real_time_factor"]
    urls = BUS.format(port=port), BUS.format(port=port + 1)
    stop, relays, listens = threading.Event(), threading.Event(), threading.Event()
    with ThreadPoolExecutor(2) as pool:
        relay = pool.submit(run_relay, *urls, BAD, BAD, 3, 60.0, stop, relays)
        try:
            assert relays.wait(20.0)
            onboard = pool.submit(answer, scenario, urls[1], listens)
            assert listens.wait(20.0)
            flight, twice = ask(scenario, urls[0])
            answered = onboard.result(20.0)
        finally:
            stop.set()
        counted = relay.result(20.0)
    assert xr.Dataset.identical(flight, alone)
    assert answered == flight.sizes["tick"]
    # The faults were there: a packet was lost about once in five, and the world had answers twice.
    for direction in counted.values():
        assert direction["lost"] > 0.1 * direction["taken"]
        assert direction["duplicated"] > 0
    assert twice > 0
