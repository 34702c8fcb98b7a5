"""Flights with the tightly coupled filter: honest, better than fixes, through gaps of every sensor, at the floor."""

import numpy as np
import pytest

from ortilo_drake.flight.flight import FlightSimulator
from ortilo_drake.flight.metrics import position_nees, summary
from ortilo_drake.scenario import load_scenario

pytestmark = pytest.mark.long

SHORT = "planner={kind: waypoints, points: [[0, 0, 1.5], [4, 1.5, 1.5], [5, 1.5, 1.5]]}"
OPEN = "uwb.link.blackouts=[]"
PROJECTED = "camera.kind=projected"


def mse(name: str, *settings: str, seeds: range = range(3)) -> tuple[float, float, float]:
    """Return mean squared position error [m^2], that over the Cramer-Rao floor, and mean NEES of flights."""
    simulator = FlightSimulator(load_scenario(name, (SHORT, *settings)))
    found, floors, nees = [], [], []
    for seed in seeds:
        flight = simulator.fly(seed)
        result = summary(flight)
        assert result.lost is None
        found.append(sum(result.mse.values()))
        floors.append(sum(result.floor.values()) if result.floor else np.nan)
        nees.append(float(np.mean(position_nees(flight))))
    return float(np.mean(found)), float(np.mean(found) / np.mean(floors)), float(np.mean(nees))


def test_it_is_near_the_floor_and_honest() -> None:
    """Through the first blackout; three flights scatter the ratio by a factor of two and the NEES by half."""
    _, over_floor, nees = mse("tight_imu_uwb")
    assert 0.3 < over_floor < 2.5
    assert 1.5 < nees < 6.0


def test_single_ranges_do_better_than_fixes_where_two_anchors_answer() -> None:
    """No fix can be made of two ranges; the tight filter takes them."""
    near = ("uwb.max_distance=3.2", OPEN)
    tight, _, _ = mse("tight_imu_uwb", *near)
    loose, _, _ = mse("nominal_imu_uwb", *near)
    assert tight < 0.5 * loose


def test_it_flies_through_gaps_of_the_imu_and_of_ranges() -> None:
    gaps = ("imu.link.loss=0.2", "uwb.link.loss=0.5", "estimator.imu.coasting_sd=[0.02, 0.3]")
    error, _, _ = mse("tight_imu_uwb", OPEN, *gaps, seeds=range(1))
    assert error < 0.02


def test_ranges_with_a_clock_of_their_own_are_flown_by_differences() -> None:
    error, _, _ = mse("tight_imu_uwb", OPEN, "estimator.ranges.differences=true", "truth.uwb.bias=3.0", seeds=range(1))
    assert error < 0.02


@pytest.mark.parametrize("pairs", ["cycle", "all"])
def test_differences_in_turn_are_flown_near_the_floor(pairs: str) -> None:
    """Through the first blackout, as by single ranges; and what all ranges err by is not seen."""
    _, over_floor, nees = mse("tight_differences", f"uwb.pairs={pairs}", "truth.uwb.bias=3.0")
    assert 0.3 < over_floor < 2.5
    assert 1.5 < nees < 6.0


@pytest.mark.parametrize("delay", [0, 2])
def test_pictures_count_at_their_own_time(delay: int) -> None:
    """A box two ticks late is as good as one in time, up to what the vehicle has not learnt meanwhile."""
    late = (PROJECTED, OPEN, f"camera.link.delay={delay}", "estimator.horizon=0.2")
    error, _, nees = mse("tight_imu_uwb_yolo", *late, seeds=range(1))
    assert error < 1e-3
    assert nees < 8.0


def test_a_message_older_than_the_horizon_is_not_used() -> None:
    """With every picture too late it flies as without a camera: bit for bit in what it estimates of the position."""
    late = (PROJECTED, OPEN, "camera.link.delay=8", "estimator.horizon=0.07", SHORT)
    with_camera = FlightSimulator(load_scenario("tight_imu_uwb_yolo", late)).fly(0)
    alone = ("camera.link.delay=8", "estimator.horizon=0.07", OPEN, SHORT)
    without = FlightSimulator(load_scenario("tight_imu_uwb", alone[1:])).fly(0)
    np.testing.assert_allclose(
        with_camera["estimate"].values[:, :3], without["estimate"].values[:, :3], rtol=0.0, atol=1e-9
    )


def test_a_flow_sensor_is_taken_too() -> None:
    with_flow, _, _ = mse("tight_imu_uwb", "sensors=[uwb, imu, altimeter, flow]", seeds=range(2))
    without, _, _ = mse("tight_imu_uwb", seeds=range(2))
    assert with_flow < 0.5 * without
