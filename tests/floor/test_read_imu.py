"""What the filter reads of the imu, in the Cramer-Rao floor: whichever filter it is that reads it."""

import numpy as np
import pytest

from ortilo_drake.floor.cramer_rao import position_floor
from ortilo_drake.scenario import load_scenario
from ortilo_drake.studies.rooms.planned_floor import without_sensor

READING = "estimator={kind: intermittent, force: measured, rates: measured}"
FLYING = "imu.standstill=0"


def path(ticks: int) -> np.ndarray:
    truth = np.zeros((ticks, 12))
    truth[:, :3] = [3.0, 1.0, 1.5] + np.linspace(0.0, 1.0, ticks)[:, None] * np.array([1.0, 0.4, -0.2])
    return truth


def test_with_the_imu_alone_the_tight_filters_floor_in_z_is_specific_force_integrated_twice() -> None:
    """A tick's force is known by its sample, of variance s^2, and a priori: together by 1 / (1 / s^2 + 1 / sigma^2)."""
    scenario, n = load_scenario("tight_imu_uwb", ("sensors=[imu]",)), np.arange(300)
    floor = position_floor(scenario, path(300))
    assert floor is not None
    h, sample = scenario.h, scenario.imu.specific_force_density**2 / scenario.h
    before = (scenario.world.disturbance.sds(h)[0] / scenario.vehicle.mass) ** 2
    a2 = 1.0 / (1.0 / sample + 1.0 / before)
    np.testing.assert_allclose(floor[:, 2], a2 * h**4 * (n**3 / 3.0 - n / 12.0), rtol=1e-9, atol=1e-15)


@pytest.mark.parametrize("name", ["tight_imu_uwb", "realistic_tight"])
def test_two_filters_that_read_the_same_have_the_same_floor(name: str) -> None:
    settings = ("sensors=[uwb, imu]", FLYING)
    tight, other = (position_floor(load_scenario(name, (*settings, *more)), path(90)) for more in ((), (READING,)))
    np.testing.assert_array_equal(tight, other)


def test_without_an_imu_nothing_is_read_of_it() -> None:
    tight = load_scenario("tight_imu_uwb", ("sensors=[uwb, imu]",))
    ranges_only = load_scenario("tight_imu_uwb", ("sensors=[uwb]", "estimator={kind: intermittent, force: none}"))
    found, expected = (position_floor(scenario, path(90)) for scenario in (without_sensor(tight, "imu"), ranges_only))
    np.testing.assert_array_equal(found, expected)
