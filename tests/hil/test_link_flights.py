"""Lockstep over a link that loses, delays, doubles and reorders packets is still the flight of a single process."""

import threading
from concurrent.futures import ThreadPoolExecutor

import pytest
import xarray as xr
from hil_link import KEY, answering
from waiting import HANGS

from ortilo_drake.flight.flight import fly
from ortilo_drake.hil import sessions
from ortilo_drake.hil.relay.relay import Faults, run_relay
from ortilo_drake.scenario import load_scenario

BAD = Faults(loss=0.2, delay=0.004, spread=0.003, duplicate=0.2, held=0.1, hold=0.02)
FAREWELLS = 20  # each may be lost: all of them with a probability of 1e-14


@pytest.mark.family
@pytest.mark.parametrize("name", ["nominal_imu_uwb", "nominal_imu_uwb_yolo", "flow"])
def test_a_bad_link_costs_time_but_not_a_bit(
    name: str, bus: str, other_bus: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sessions, "FAREWELLS", FAREWELLS)
    short = ("settle=0", "planner={kind: hover, duration: 0.5}")
    scenario = load_scenario(name, (*short, "camera.kind=projected") if name == "nominal_imu_uwb_yolo" else short)
    alone = fly(scenario)
    del alone.attrs["real_time_factor"]
    stop, relays = threading.Event(), threading.Event()
    with answering(scenario, other_bus) as answered, ThreadPoolExecutor(1) as pool:
        relay = pool.submit(run_relay, KEY, bus, other_bus, BAD, BAD, 3, HANGS, stop, relays)
        try:
            assert relays.wait(HANGS)
            flight, report = sessions.run_world(scenario, bus, KEY, True, HANGS)
            assert answered.result(HANGS) == flight.sizes["tick"]
        finally:
            stop.set()
        counted = relay.result(HANGS)
    assert xr.Dataset.identical(flight, alone)
    # The faults were there: a packet was lost about once in five, and the world had answers twice.
    for direction in counted.values():
        assert direction["lost"] > 0.1 * direction["taken"]
        assert direction["duplicated"] > 0
    assert report.packets.duplicates > 0
