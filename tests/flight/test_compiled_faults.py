"""Compiled flights in which something goes wrong are those of the Drake diagram, whatever goes wrong."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import xarray as xr
from sameness import assert_same_bits

from ortilo_drake.flight.engine import Engine
from ortilo_drake.flight.flight import FlightSimulator
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario, load_scenario
from ortilo_drake.world.faults.table import KINDS

Fault = dict[str, Any]
SHORT = ("planner={kind: waypoints, points: [[7.0, 1.0, 1.5], [8.2, 1.6, 1.5]]}", "settle=2.0")
SETTINGS: dict[str, Fault] = {
    "nlos_storm": {"share": 0.5, "mean": 0.6},
    "outlier_bursts": {"every": 0.5, "length": 0.2, "sd": 1.0},
    "stuck": {"sensor": "uwb"},
    "anchor_moved": {"anchor": 3, "by": [0.3, -0.1, 0.2]},
    "anchors_dying": {"anchors": [3, 0, 7], "every": 0.4},
    "clock_jump": {"by": 0.5},
    "yaw_jump": {"by": 0.2},
    "gyro_bias": {"by": [0.01, -0.02, 0.03]},
    "camera_blinded": {},
    "landmark_moved": {"landmark": 1, "by": [0.1, 0.4, 0.0]},
    "landmark_gone": {"landmark": 1},
    "people": {"walks": [[8.5, 0.5, 8.5, 3.0], [6.0, 2.0, 8.0, 4.0], [9.5, 2.0, 9.5, 2.0]], "speed": 1.0},
    "gust": {"force": [0.5, 2.0, -0.5]},
    "load_dropped": {"mass_factor": 0.9},
    "rotor_weak": {"rotor": 1, "factor": 0.8},
}
CASES: list[Fault] = [{"kind": kind} | settings for kind, settings in SETTINGS.items()]
CASES += [{"kind": "stuck", "sensor": "imu"}, {"kind": "stuck", "sensor": "camera"}]
IDS = [f"{case['kind']}-{case.get('sensor', '')}".strip("-") for case in CASES]
ROTORS = ("world.plant=continuous", "world.rotors={kind: first_order}")
ESTIMATORS = {
    "imu_uwb_yolo": ROTORS,
    "robust_imu_uwb_yolo": ("uwb.link.delay=2", "camera.link.random_delay=2"),
    "tight_imu_uwb_yolo": ("imu.link.loss=0.1", "imu.link.rate=60"),
}


def with_faults(name: str, faults: list[Fault], *changes: str, short: bool = True) -> Scenario:
    laid = (*(SHORT if short else ()), "camera.kind=projected", *changes)
    return load_scenario(name, (*laid, ("faults", faults)))


@pytest.fixture(scope="module")
def calm() -> Callable[[str], list[xr.Dataset]]:
    """A function that returns the flights of an estimator without a fault, seeds 0 and 1."""
    kept: dict[str, list[xr.Dataset]] = {}

    def fly(name: str) -> list[xr.Dataset]:
        if name not in kept:
            simulator = FlightSimulator(with_faults(name, [], *ESTIMATORS[name]))
            kept[name] = [simulator.fly(seed) for seed in (0, 1)]
        return kept[name]

    return fly


def test_every_kind_is_flown() -> None:
    kinds = Scenario.model_json_schema()["properties"]["faults"]["items"]["discriminator"]["mapping"]
    assert set(SETTINGS) == set(KINDS) == set(kinds)


@pytest.mark.long  # each compiles for a minute
@pytest.mark.parametrize("name", ESTIMATORS)
@pytest.mark.parametrize("case", CASES, ids=IDS)
def test_a_flight_with_a_fault_is_drakes(case: Fault, name: str, calm: Callable[[str], list[xr.Dataset]]) -> None:
    fault = {"start": 1.0} | ({} if case["kind"] == "load_dropped" else {"end": 2.5}) | case
    scenario = with_faults(name, [fault], *ESTIMATORS[name])
    engine, simulator = Engine(scenario), FlightSimulator(scenario)
    for seed, without in zip((0, 1), calm(name), strict=True):
        flight = engine.fly(seed)
        assert_same_bits(simulator.fly(seed), flight)
        with pytest.raises(AssertionError):
            assert_same_bits(flight, without)


SEVERAL: list[Fault] = [
    {"kind": "stuck", "sensor": "uwb", "start": 20.0, "end": 21.0},
    {"kind": "nlos_storm", "start": 22.0, "end": 26.0, "share": 0.3, "mean": 0.5},
    {"kind": "people", "start": 23.0, "end": 33.0, "walks": [[8.0, 0.0, 8.0, 4.0]]},
    {"kind": "anchor_moved", "start": 25.0, "anchor": 2},
    {"kind": "nlos_storm", "start": 25.5, "end": 27.0, "share": 0.2, "mean": 0.3},
    {"kind": "landmark_gone", "start": 20.0, "landmark": 3},
    {"kind": "landmark_moved", "start": 30.0, "landmark": 9, "by": [0.1, 0.1, 0.0]},
    {"kind": "yaw_jump", "start": 28.0, "end": 30.0, "by": 0.1},
    {"kind": "stuck", "sensor": "imu", "start": 29.0, "end": 29.5},
    {"kind": "gust", "start": 31.0, "end": 33.0, "force": [0.0, 1.0, 0.0]},
    {"kind": "load_dropped", "start": 35.0, "mass_factor": 0.95},
    {"kind": "rotor_weak", "start": 36.0, "end": 40.0, "rotor": 2, "factor": 0.95},
    {"kind": "camera_blinded", "start": 37.0, "end": 39.0},
]
TRUTH = (
    "truth.survey={anchors_sd: 0.02, landmarks_sd: 0.02}",
    "truth.vehicle={thrust_factor: 0.98}",
    "truth.clock={offset: 0.004}",
    "truth.uwb={bias: 0.03, slow_sd: 0.02}",
)


@pytest.mark.long
@pytest.mark.parametrize("name", ["robust_imu_uwb_yolo", "tight_imu_uwb_yolo"])
def test_a_long_flight_with_several_faults_is_drakes(name: str) -> None:
    scenario = with_faults(name, SEVERAL, *TRUTH, short=False)
    assert_same_bits(FlightSimulator(scenario).fly(3), Engine(scenario).fly(3))


@pytest.mark.long
def test_a_flight_is_the_one_without_faults_up_to_the_first() -> None:
    scenario = with_faults(
        "robust_imu_uwb_yolo", [{"kind": "gust", "start": 2.0}, {"kind": "clock_jump", "start": 2.0}]
    )
    flight = Engine(scenario).fly(1)
    calm = FlightSimulator(scenario.model_copy(update={"faults": ()})).fly(1)
    tick = round(2.0 / scenario.h)
    assert np.array_equal(flight["truth"].values[: tick + 1], calm["truth"].values[: tick + 1])
    assert not np.array_equal(flight["truth"].values[tick + 1], calm["truth"].values[tick + 1])


def test_faults_of_what_is_not_there_are_refused() -> None:
    scenario = with_faults("imu_uwb_yolo", [{"kind": "rotor_weak", "start": 1.0, "rotor": 4}])
    with pytest.raises(InputError, match="rotor 4: must be below 4"):
        Engine(scenario)
