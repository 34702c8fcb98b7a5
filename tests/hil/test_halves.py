"""The two halves, met at the ticks, against the closed loop that Drake simulates in one piece."""

import numpy as np
import pytest
import xarray as xr

from ortilo_drake.experiments.flight import fly
from ortilo_drake.hil.lockstep import fly_lockstep, in_this_process
from ortilo_drake.scenario import Scenario, load_scenario

LATE = (
    "camera_link={every: 3, delay: 1, random_delay: 2, loss: {kind: bernoulli, probability: 0.2}}",
    "command_link={delay: 1, loss: {kind: bernoulli, probability: 0.1}}",
)


def same_flight(scenario: Scenario) -> xr.Dataset:
    """Fly a scenario both ways, and return the flight if it is the same bit for bit."""
    whole, halves = fly(scenario), fly_lockstep(scenario, in_this_process(scenario))
    del whole.attrs["real_time_factor"]
    xr.testing.assert_identical(whole, halves)
    for name in whole.data_vars:
        np.testing.assert_array_equal(whole[name].values, halves[name].values)
    return halves


@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("imu_uwb", ()),
        ("imu_uwb_yolo", ("camera=projected",)),
        ("imu_uwb_yolo", ("camera=projected", *LATE)),
        ("paper_imu_uwb", ()),
        ("rotors", ("planner={kind: hover, duration: 4.0}",)),
    ],
)
def test_halves_fly_the_closed_loop_bit_for_bit(name: str, settings: tuple[str, ...]) -> None:
    same_flight(load_scenario(name, settings))


@pytest.mark.egl
@pytest.mark.parametrize("settings", [(), LATE[:1]])
def test_rendered_halves_fly_the_closed_loop_bit_for_bit(settings: tuple[str, ...]) -> None:
    flight = same_flight(load_scenario("imu_uwb_yolo", ("settle=0", "planner={kind: hover, duration: 4}", *settings)))
    assert flight["arrival"].sel(sensor="camera").sum() > 20


def test_a_lost_flight_ends_at_the_same_tick() -> None:
    flight = same_flight(load_scenario("imu_uwb", ("world.disturbance.torque_sd=0.6",)))
    assert flight.attrs["lost"] != "null"
