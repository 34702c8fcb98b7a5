"""What is drawn of a world: the given mean and spread over seeds, each number by its own stream."""

import numpy as np
import pytest

from ortilo_drake.flight.flyable import check_flyable
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario, load_scenario
from ortilo_drake.world.drawn_truth import LEAST_FACTOR, Drawn, draw_truth

ROOM = load_scenario("nominal_imu_uwb").load_room()
N, M = len(ROOM.anchors), len(ROOM.landmarks)
PAYLOADS = {"uwb": 2 * N, "camera": 0, "imu": 9, "altimeter": 1, "flow": 5}
SPREADS = (
    "truth.vehicle={mass_factor: 1.1, mass_factor_sd: 0.03}",
    "truth.vehicle.center_of_gravity=[0.01, -0.02]",
    "truth.vehicle.center_of_gravity_sd=0.01",
    "truth.force={mean: [0.1, 0, -0.2], mean_sd: 0.3}",
    "truth.imu={level: [0.01, 0.02], level_sd: 0.005, yaw: -0.1, yaw_sd: 0.02}",
    "truth.uwb={bias: 0.1, bias_sd: 0.05, factor: 1.01, factor_sd: 0.002}",
    "truth.survey={anchors_sd: 0.03, landmarks: [0.1, 0, 0], landmarks_sd: 0.02}",
    "truth.clock={offset: 0.005, offset_sd: 0.001}",
    "truth.sensors.flow={bias: [0.1, 0, 0, 0, 0], bias_sd: [0.01, 0.02, 0, 0, 0], factor_sd: [0.1, 0, 0, 0, 0]}",
)
# Mean and standard deviation of each number, as the settings above say.
EXPECTED = {
    "vehicle.mass_factor": (1.1, 0.03),
    "vehicle.inertia_factor": (1.0, 0.0),
    "vehicle.center_of_gravity": ([0.01, -0.02], 0.01),
    "force.mean": ([0.1, 0.0, -0.2], 0.3),
    "imu.level": ([0.01, 0.02], 0.005),
    "imu.yaw": (-0.1, 0.02),
    "uwb.bias": (np.full(N, 0.1), 0.05),
    "uwb.factor": (1.01, 0.002),
    "survey.anchors": (np.zeros((N, 3)), 0.03),
    "survey.landmarks": (np.tile([0.1, 0.0, 0.0], (M, 1)), 0.02),
    "clock.offset.uwb": (0.005, 0.001),
    "clock.offset.altimeter": (0.005, 0.001),
    "clock.drift.uwb": (0.0, 0.0),
    "sensors.flow.bias": ([0.1, 0.0, 0.0, 0.0, 0.0], [0.01, 0.02, 0.0, 0.0, 0.0]),
    "sensors.flow.factor": (np.ones(5), [0.1, 0.0, 0.0, 0.0, 0.0]),
}


def scenario_with(*settings: str) -> Scenario:
    return load_scenario("flow", ("sensors=[uwb, camera, imu, altimeter, flow]", "camera.kind=projected", *settings))


def drawn(scenario: Scenario, seed: int) -> Drawn:
    return draw_truth(scenario.truth, seed, ROOM, PAYLOADS)


@pytest.mark.long
def test_what_is_drawn_has_the_mean_and_the_spread_that_are_given() -> None:
    scenario, seeds = scenario_with(*SPREADS), 1500
    found = [drawn(scenario, seed) for seed in range(seeds)]
    for key, (mean, sd) in EXPECTED.items():
        values = np.array([one[key] for one in found])
        assert values.shape[1:] == np.shape(mean), key
        sd = np.broadcast_to(sd, np.shape(mean))
        # Five standard errors, of the mean and of the standard deviation of Gaussian numbers.
        tight = 5.0 / np.sqrt(seeds)
        assert np.all(np.abs(values.mean(axis=0) - mean) <= tight * sd + 1e-15), key
        assert np.all(np.abs(values.std(axis=0) - sd) <= tight / np.sqrt(2.0) * sd + 1e-15), key
    anchors = np.array([one["survey.anchors"].ravel() for one in found])
    correlations = np.corrcoef(anchors.T) - np.eye(3 * N)
    assert np.max(np.abs(correlations)) < 5.5 / np.sqrt(seeds)


def test_a_draw_is_the_seeds_and_does_not_move_when_another_entry_changes() -> None:
    scenario = scenario_with(*SPREADS)
    one, again, other = drawn(scenario, 3), drawn(scenario, 3), drawn(scenario, 4)
    assert all(np.array_equal(one[key], again[key]) for key in one)
    spread = [key for key, (_, sd) in EXPECTED.items() if np.any(sd)]
    assert not any(np.array_equal(one[key], other[key]) for key in spread)
    changed = drawn(scenario_with(*SPREADS, "truth.imu.yaw=0.3", "truth.vehicle.inertia_factor_sd=0.1"), 3)
    assert {key for key in one if not np.array_equal(one[key], changed[key])} == {"imu.yaw", "vehicle.inertia_factor"}
    fewer = draw_truth(scenario_with("truth.clock.offset_sd=0.01").truth, 3, ROOM, {"uwb": 2 * N, "imu": 9})
    more = draw_truth(scenario_with("truth.clock.offset_sd=0.01").truth, 3, ROOM, PAYLOADS)
    assert all(np.array_equal(fewer[key], more[key]) for key in fewer)


def test_without_a_spread_the_values_are_the_numbers_themselves() -> None:
    found = drawn(scenario_with("truth.vehicle.mass_factor=1.07", "truth.sensors.altimeter.factor=[1.02]"), 5)
    assert found["vehicle.mass_factor"] == 1.07
    assert found["sensors.altimeter.factor"] == [1.02]
    assert found["vehicle.thrust_factor"] == 1.0
    assert not np.any(found["uwb.bias"])


@pytest.mark.long
def test_no_factor_is_drawn_below_the_least() -> None:
    scenario = scenario_with("truth.vehicle={mass_factor: 0.5, mass_factor_sd: 0.2}")
    masses = np.array([drawn(scenario, seed)["vehicle.mass_factor"] for seed in range(1000)])
    assert np.any(masses == LEAST_FACTOR)
    assert np.all(masses >= LEAST_FACTOR)


def test_only_registered_sensors_err_so_and_those_that_do_not_fly_not_at_all() -> None:
    for name, line in (("flo", "did you mean 'flow'"), ("uwb", "none of the registered")):
        with pytest.raises(InputError, match=rf"truth\.sensors\.{name}: is none of the registered sensors") as refused:
            scenario_with(f"truth.sensors.{name}.bias=[0.1]")
        assert line in str(refused.value)
    scenario = load_scenario("altimeter", ("truth.sensors.flow.bias=[0.1]",))
    check_flyable(scenario)
    found = draw_truth(scenario.truth, 0, ROOM, {"uwb": 2 * N, "imu": 9, "altimeter": 1})
    assert not [key for key in found if key.startswith("sensors")]


@pytest.mark.parametrize("name", ["bias", "bias_sd", "factor", "factor_sd", "slow_sd"])
def test_as_many_numbers_as_the_payload_has(name: str) -> None:
    value = "1.0, 1.0" if name == "factor" else "0.1, 0.1"
    scenario = scenario_with(f"truth.sensors.flow.{name}=[{value}]")
    with pytest.raises(InputError, match=rf"^truth\.sensors\.flow\.{name}: \[.*\]: must have 5 numbers, as its"):
        drawn(scenario, 0)
    with pytest.raises(InputError, match=rf"^truth\.sensors\.flow\.{name}: "):
        check_flyable(scenario)
