"""Many flights through one Diagram: each as if it had one of its own, and no memory lost."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from flight_tracks import digest
from pydrake.systems.framework import Diagram

from ortilo_drake.flight import flight as flight_module
from ortilo_drake.flight.ensemble import fly_many
from ortilo_drake.flight.flight import FlightSimulator, fly
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import load_scenario, with_seed

HOVER = ("planner={kind: hover, point: [8, 1, 1.5], duration: 1}", "settle=0.0")
ORDER = (3, 0, 2**62 + 1, 3, 2**62, 0)  # the two large seeds are one float

# What keeps something from tick to tick: chains, messages and commands in flight, the filter's history, rotors.
BURSTS = "loss: {kind: gilbert_elliott, good_to_bad: 0.3, bad_to_good: 0.4}"
KEEPING = {
    "nominal_imu_uwb_yolo": (),
    "bursty_link": (),
    "rotors": (f"command_link={{{BURSTS}, delay: 2, when_lost: hold}}",),
    "nominal_imu_uwb": (f"uwb.link={{rate: null, delay: 1, random_delay: 2, {BURSTS}}}", "estimator.delay=replay"),
}


@pytest.mark.family
@pytest.mark.parametrize("name", KEEPING)
def test_flights_of_one_simulator_are_those_of_a_diagram_each_in_any_order(name: str) -> None:
    scenario = load_scenario(name, (*HOVER, "camera.kind=projected", *KEEPING[name]))
    simulator = FlightSimulator(scenario)
    found = [digest(simulator.fly(seed)) for seed in ORDER]
    alone = {seed: digest(fly(with_seed(scenario, seed))) for seed in set(ORDER)}
    assert found == [alone[seed] for seed in ORDER]
    assert len(set(found)) == len(alone)


@pytest.mark.long
@pytest.mark.egl
def test_rendered_flights_too_with_pictures_that_come_late() -> None:
    settings = ("camera.link={rate: 10.0, delay: 1, random_delay: 2}", "planner.duration=0.8")
    scenario = load_scenario("nominal_imu_uwb_yolo", (*HOVER, *settings))
    assert scenario.is_rendered
    simulator = FlightSimulator(scenario)
    found = [digest(simulator.fly(seed)) for seed in (4, 1, 4)]
    assert found == [digest(fly(with_seed(scenario, seed))) for seed in (4, 1, 4)]


def test_a_lost_flight_leaves_nothing_to_the_next() -> None:
    scenario = load_scenario("nominal_imu_uwb", (*HOVER, "world.disturbance.force_density=11", "planner.duration=4"))
    simulator = FlightSimulator(scenario)
    flights = [simulator.fly(seed) for seed in (1, 2, 1)]
    assert all(flight.attrs["lost"] != "null" for flight in flights)
    assert digest(flights[0]) == digest(flights[2]) == digest(fly(with_seed(scenario, 1)))


def test_a_flight_carries_its_own_seed_and_refuses_one_that_cannot_be() -> None:
    simulator = FlightSimulator(load_scenario("nominal_imu_uwb", HOVER, 9))
    assert simulator.fly(2).attrs["seed"] == 2
    with pytest.raises(InputError, match="seed"):
        simulator.fly(-1)


@pytest.mark.long
def test_many_seeds_are_flown_with_one_diagram(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    built: list[Diagram] = []

    def make(*arguments: Any, **options: Any) -> Diagram:
        built.append(original(*arguments, **options))
        return built[-1]

    original = flight_module.ClosedLoop
    monkeypatch.setattr(flight_module, "ClosedLoop", make)
    scenario = load_scenario("nominal_imu_uwb", HOVER)
    fly_many(scenario, range(4), tmp_path, player="drake")
    assert len(built) == 1
    fly_many(scenario, range(4), tmp_path, player="drake")  # all there
    assert len(built) == 1


GROWTH = """
import sys
from pathlib import Path
from ortilo_drake.flight.ensemble import fly_many
from ortilo_drake.scenario import load_scenario

def resident():
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 2**20  # [MiB]

before = None

def note(summary):
    global before
    if summary.seed == 4:
        before = resident()

scenario = load_scenario("nominal_imu_uwb_yolo", tuple(sys.argv[2:]))
fly_many(scenario, range(20), Path(sys.argv[1]), progress=note, player="drake")
print(resident() - before)
"""


@pytest.mark.processes
@pytest.mark.skipif(sys.platform != "linux", reason="reads the memory of a process from /proc/self/statm of Linux")
def test_fifteen_flights_more_take_no_more_memory(tmp_path: Path) -> None:
    words = [sys.executable, "-c", GROWTH, str(tmp_path), *HOVER, "camera.kind=projected"]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    assert float(done.stdout) < 15.0  # a Diagram for each took 4 MiB each
