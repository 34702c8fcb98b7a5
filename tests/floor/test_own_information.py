"""A sensor of one's own whose noise follows from geometry gets bound, covariance and theory by what it says itself."""

from collections.abc import Iterator

import numpy as np
import pytest

import ortilo_drake as od
from ortilo_drake.floor.cramer_rao import position_floor
from ortilo_drake.model.measurement import row
from ortilo_drake.model.parts import Sensor, register_sensor
from ortilo_drake.model.room import Room
from ortilo_drake.scenario import Scenario, load_scenario
from ortilo_drake.scenario.link import Link
from ortilo_drake.scenario.own_parts import SensorSettings
from ortilo_drake.sensors.information_rows import Information, rows_of
from ortilo_drake.studies.linearization.operating_point import believed_V
from ortilo_drake.studies.loop.fix_covariance import fix_noise

SD = 0.1  # of each distance [m]


class Beacons(SensorSettings):
    """Distances to the room's anchors, all of the same noise."""

    link: Link = Link(rate=10.0)


def gradients(room: Room, p: np.ndarray) -> np.ndarray:
    """Return the unit vectors from the anchors to p (n, 3)."""
    away = p - room.anchor_positions
    return away / np.linalg.norm(away, axis=1, keepdims=True)


def covariance(scenario: Scenario, room: Room, x: np.ndarray) -> np.ndarray:
    """Return the covariance of the least-squares position."""
    g = gradients(room, x[:3])
    return SD**2 * np.linalg.inv(g.T @ g)


def information(scenario: Scenario, room: Room, truth: np.ndarray, seen: np.ndarray) -> Information:
    """Return a row for each distance."""
    ticks = np.flatnonzero(seen)
    g = np.concatenate([np.pad(gradients(room, truth[k, :3]), ((0, 0), (0, 9))) for k in ticks])
    n = len(room.anchor_positions)
    return Information({"beacons": rows_of(np.repeat(ticks, n), g, np.full(len(g), SD**2))})


@pytest.fixture
def beacons(own_register: None) -> Iterator[Scenario]:
    rows = tuple(row(f"{axis}_beacons", **{axis: 1.0}) for axis in "xyz")
    its = Sensor("beacons", Beacons, rows, make_world=lambda s, r: None, covariance=covariance, information=information)
    register_sensor(its)
    return load_scenario("nominal_imu_uwb", ("sensors=[imu, beacons]", "world.disturbance.force_density=0.05"))


def test_its_floor_is_that_of_uwb_of_the_same_noise(beacons: Scenario) -> None:
    like = "uwb={noise: {kind: constant, sd: 0.1}, link: {rate: 10, blackouts: []}}"
    uwb = load_scenario("nominal_imu_uwb", (like, "world.disturbance.force_density=0.05"))
    truth = np.zeros((60, 12))
    truth[:, :3] = np.linspace([3.0, 1.0, 1.5], [5.0, 0.5, 1.5], 60)
    floor = position_floor(beacons, truth)
    assert floor is not None
    assert floor[-1].min() > 0.0
    np.testing.assert_allclose(floor, position_floor(uwb, truth), rtol=1e-9, atol=1e-15)


def test_the_covariance_of_its_fix_is_what_it_says(beacons: Scenario) -> None:
    x = np.array([3.0, 1.0, 1.5, *[0.0] * 9])
    V, there = fix_noise(beacons, x)
    assert there["beacons"]
    np.testing.assert_array_equal(V["beacons"], covariance(beacons, beacons.load_room(), x))


def test_theory_of_no_place_takes_it_in_the_middle_of_the_room(beacons: Scenario) -> None:
    room = beacons.load_room()
    middle = (np.array(room.interior.min) + np.array(room.interior.max)) / 2.0
    V = believed_V(beacons)[beacons.measurement.rows_of("beacons")][:, beacons.measurement.rows_of("beacons")]
    np.testing.assert_allclose(V, covariance(beacons, room, np.concatenate([middle, np.zeros(9)])), rtol=1e-12)


def test_a_sensor_that_tells_no_noise_is_refused() -> None:
    rows = (row("z_silent", z=1.0),)
    with pytest.raises(od.InputError, match="silent: must give its noise as sd, or as covariance and information"):
        register_sensor(Sensor("silent", Beacons, rows, make_world=lambda s, r: None, covariance=covariance))
