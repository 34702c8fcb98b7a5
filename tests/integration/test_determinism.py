"""Same seed, same bits: in one process, in another, and beside other sensors."""

import os
import subprocess
import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from flight_tracks import digest
from pydrake.systems.framework import Diagram

from ortilo_drake.diagrams.world import make_world
from ortilo_drake.flight.flight import FlightSimulator, fly
from ortilo_drake.scenario import load_scenario

SHORT = "planner={kind: waypoints, points: [[0, 0, 1.5], [1.2, 0.6, 1.5]]}"
PROJECTED = "camera.kind=projected"  # as fast as the rest; rendered flights have tests of their own
SCENARIOS = ["nominal_imu_uwb_yolo", "bursty_link", "rotors", "realistic", "realistic_flow", "robust_imu_uwb_yolo"]
SCENARIOS += ["tight_imu_uwb"]


@cache
def flown(name: str) -> xr.Dataset:
    """Return the flight of seed 7, flown when it is first asked for."""
    return fly(load_scenario(name, (SHORT, PROJECTED), 7))


@pytest.mark.family
@pytest.mark.parametrize("name", SCENARIOS)
def test_the_same_seed_flies_the_same_bits_twice(name: str) -> None:
    one, two = flown(name), fly(load_scenario(name, (SHORT, PROJECTED), 7))
    for variable in one.data_vars:
        assert np.array_equal(one[variable].values, two[variable].values, equal_nan=True), variable
    assert digest(one) == digest(two)
    same = {key: value for key, value in one.attrs.items() if key != "real_time_factor"}
    assert same == {key: value for key, value in two.attrs.items() if key != "real_time_factor"}


@pytest.mark.family
@pytest.mark.parametrize("other", ["nominal_imu_uwb", "rotors"])
def test_other_flights_in_between_change_nothing(other: str) -> None:
    first = digest(flown("nominal_imu_uwb_yolo"))
    fly(load_scenario(other, (SHORT, PROJECTED), 8))
    np.random.default_rng().normal(size=100)
    assert digest(fly(load_scenario("nominal_imu_uwb_yolo", (SHORT, PROJECTED), 7))) == first


@pytest.mark.long
def test_a_seeds_truths_do_not_depend_on_what_the_simulator_flew_before() -> None:
    scenario = load_scenario("realistic_flow", (SHORT, PROJECTED), 3)
    simulator = FlightSimulator(scenario)
    other = digest(simulator.fly(4))
    assert digest(simulator.fly(3)) == digest(fly(scenario)) != other


@pytest.mark.processes
def test_another_process_flies_the_same_bits() -> None:
    program = (
        "import sys; sys.path[:0] = sys.argv[1:]\n"
        "from test_determinism import *\n"
        "print([digest(fly(load_scenario(name, (SHORT, PROJECTED), 7))) for name in SCENARIOS])\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, *map(str, Path(__file__).parents[:2])],
        env=os.environ | {"PYTHONHASHSEED": "12345", "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=True,
    )
    here = [digest(flown(name)) for name in SCENARIOS]
    assert done.stdout.strip() == str(here)


@pytest.mark.long
def test_different_seeds_differ_in_every_noise() -> None:
    flights = [fly(load_scenario("nominal_imu_uwb_yolo", (SHORT, PROJECTED), seed)) for seed in range(4)]
    assert len({digest(flight) for flight in flights}) == 4
    first, other = flights[:2]
    for s in range(3):  # each sensor's first measurement, taken from the very same state
        row = slice(3 * s, 3 * s + 3)
        y = [flight["measurement"].values[0, row] for flight in (first, other)]
        assert not np.any(np.isclose(y[0], y[1], rtol=0.0, atol=1e-9))
    assert not np.array_equal(first["truth"].values[1], other["truth"].values[1])  # the disturbance


def messages(world: Diagram, port: str, h: float, ticks: int = 31) -> np.ndarray:
    """Return what a world's port says at each tick while the vehicle stands still at one state."""
    context = world.CreateDefaultContext()
    world.GetInputPort("control").FixValue(context, [2.7 * 9.81, 0.0, 0.0, 0.0])
    found = []
    for k in range(ticks):
        context.SetTime(k * h)
        world.SetState(context, np.array([8.0, 1.0, 1.5, *[0.02] * 9]))
        found.append(world.GetOutputPort(port).Eval(context).copy())
    return np.array(found)


def world_of(name: str, *settings: str) -> tuple[Diagram, float]:
    scenario = load_scenario(name, (PROJECTED, *settings))
    return make_world(scenario), scenario.h


def test_adding_the_camera_leaves_the_other_sensors_noise_as_it_was() -> None:
    (without, h), (with_camera, _) = world_of("nominal_imu_uwb"), world_of("nominal_imu_uwb_yolo")
    for port in ("uwb", "imu"):
        one, other = messages(without, port, h), messages(with_camera, port, h)
        assert one.tobytes() == other.tobytes()
        assert len({row.tobytes() for row in one[::3]}) == len(one[::3])  # there is noise at all


def test_a_sensors_rate_leaves_its_noise_and_that_of_the_others_as_it_was() -> None:
    every_third, h = world_of("nominal_imu_uwb_yolo")
    every_tick, _ = world_of("nominal_imu_uwb_yolo", "uwb.link.rate=null")
    slow, fast = messages(every_third, "uwb", h), messages(every_tick, "uwb", h)
    assert slow[::3].tobytes() == fast[::3].tobytes()
    assert not slow[1::3].any()
    for port in ("imu", "detections"):
        assert messages(every_third, port, h).tobytes() == messages(every_tick, port, h).tobytes()


def test_a_message_is_a_function_of_seed_and_tick_not_of_the_order_of_asking() -> None:
    world, h = world_of("nominal_imu_uwb_yolo")
    forward = messages(world, "detections", h)
    context = world.CreateDefaultContext()
    world.GetInputPort("control").FixValue(context, [2.7 * 9.81, 0.0, 0.0, 0.0])
    for k in reversed(range(0, 31, 3)):
        context.SetTime(k * h)
        world.SetState(context, np.array([8.0, 1.0, 1.5, *[0.02] * 9]))
        assert world.GetOutputPort("detections").Eval(context).tobytes() == forward[k].tobytes()
