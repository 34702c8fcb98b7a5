"""Anchors for a path: the exchange against closed forms, the fast bound against the floor, and what a placing gives."""

from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from example_rooms import example_room, spread_evenly

from ortilo_drake.floor.cramer_rao import dynamics, information_rows, position_floor
from ortilo_drake.model.room import Room
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario, load_scenario
from ortilo_drake.studies.room_design.exchange import exchange, greedy
from ortilo_drake.studies.room_design.mounting import mounting_places
from ortilo_drake.studies.room_design.path_bound import path_model, position_variance
from ortilo_drake.studies.room_design.place import (
    place_anchors,
    range_information,
    room_text,
    with_anchors,
    worst_floor,
)
from ortilo_drake.studies.rooms.planned_floor import planned_truth

PATH = "planner={kind: waypoints, points: [[1, 0, 1.5], [4, 1, 1.5]]}"
OPEN = ("uwb.walls.kind=block", "uwb.link.blackouts=[]")


def bearings(n: int) -> np.ndarray:
    """Return the information of unit ranges from n directions in the plane (n, 1, 3, 3)."""
    angles = 2.0 * np.pi * np.arange(n) / n
    u = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(n)])
    return np.einsum("ci,cj->cij", u, u)[:, None]


def plane_trace(J: np.ndarray, there: np.ndarray) -> float:
    return float(np.trace(np.linalg.inv(J[0, :2, :2] + 1e-9 * np.eye(2))))


@pytest.mark.parametrize("n", [3, 4, 5, 6])
def test_anchors_around_a_point_are_found_as_theory_has_them(n: int) -> None:
    # tr J^-1 = 4 / n at best, where the doubled bearings sum to 0: three anchors 120 degrees apart, or their opposites
    # (Abel, "Optimal sensor placement for passive source localization", ICASSP 1990).
    J = bearings(60)
    there = np.ones((60, 1), dtype=bool)
    chosen = exchange(J, there, greedy(J, there, n, plane_trace, lambda: None), plane_trace, lambda: None)
    np.testing.assert_allclose(plane_trace(J[chosen].sum(axis=0), there), 4.0 / n, rtol=1e-6)
    assert abs(np.exp(2j * 2.0 * np.pi * np.array(chosen) / 60).sum()) < 1e-9


def test_after_the_exchange_no_single_one_lowers_the_cost() -> None:
    rng = np.random.default_rng(0)
    u = rng.normal(size=(14, 2, 3))
    J, there = np.einsum("csi,csj->csij", u, u), np.ones((14, 2), dtype=bool)

    def cost(J: np.ndarray, there: np.ndarray) -> float:
        return max(float(np.trace(np.linalg.inv(part + 0.1 * np.eye(3)))) for part in J)

    chosen = exchange(J, there, [0, 1, 2, 3], cost, lambda: None)
    found = cost(J[chosen].sum(axis=0), there)
    every = {its: cost(J[list(its)].sum(axis=0), there) for its in combinations(range(14), 4)}
    neighbours = [value for its, value in every.items() if len(set(its) & set(chosen)) == 3]
    assert found <= min(neighbours) * (1.0 + 2e-6)
    assert found <= 1.1 * min(every.values())


@pytest.fixture(scope="module")
def hall() -> Room:
    return example_room(1, 8)


def in_hall(room: Room, folder: Path, *settings: str) -> Scenario:
    file = folder / "hall.yaml"
    file.write_text(room_text(room, "a hall"))
    return load_scenario("nominal_imu_uwb", (*OPEN, f"room={file}", PATH, *settings))


def test_a_written_room_is_read_as_it_was(hall: Room, tmp_path: Path) -> None:
    assert in_hall(hall, tmp_path).load_room() == hall


def test_information_of_ranges_by_hand(hall: Room, tmp_path: Path) -> None:
    scenario = in_hall(hall, tmp_path, "uwb.noise={kind: constant, sd: 0.1}")
    wall = hall.model_copy(update={"walls": ((5.0, 0.0, np.pi / 2),)})  # its faces are at x = 4.85 and 5.15
    truth = np.zeros((30, 12))
    truth[:, :3] = [3.0, 0.0, 1.5]
    places = np.array([[3.0, 2.0, 1.5], [3.0, 0.0, 3.0], [7.0, 0.0, 1.5], [6.0, 3.0, 1.5], [4.8, 0.0, 1.5]])
    J, there = range_information(scenario, truth, wall, places, 15)
    five = 5.0 / 0.1**2  # messages at 10 Hz in half a second
    np.testing.assert_allclose(J[0], [np.diag([0.0, five, 0.0])] * 2, atol=1e-12)
    np.testing.assert_allclose(J[1], [np.diag([0.0, 0.0, five])] * 2, atol=1e-12)
    assert not J[2].any()  # behind the wall
    half = five / 2.0  # at 45 degrees, past the wall's end at y = 1.2
    np.testing.assert_allclose(J[3], [[[half, half, 0.0], [half, half, 0.0], [0.0, 0.0, 0.0]]] * 2, atol=1e-9)
    assert there.all(axis=1).tolist() == [True, True, False, True, True]


@pytest.mark.parametrize("base", ["nominal_imu_uwb", "imu_uwb", "flow"])
def test_the_fast_bound_in_steps_of_one_tick_is_the_floor(hall: Room, tmp_path: Path, base: str) -> None:
    file = tmp_path / "hall.yaml"
    file.write_text(room_text(hall, "a hall"))
    settings = (*OPEN, f"room={file}", PATH, "sensors=[uwb, imu]", "imu.standstill=0")  # what it leaves is no row
    scenario = load_scenario(base, settings)
    truth = planned_truth(scenario)[1][:200]
    others = scenario.model_copy(update={"sensors": ("imu",)})
    found = information_rows(others, truth, hall)
    assert found is not None
    model = path_model(*dynamics(scenario), found[0], len(truth), 1)
    J, there = range_information(scenario, truth, hall, hall.anchor_positions, 1)
    fast = position_variance(model, J.sum(axis=0), there.sum(axis=0), 1)
    floor = position_floor(scenario, truth)
    assert floor is not None
    np.testing.assert_allclose(fast, floor.sum(axis=1), rtol=1e-6, atol=1e-15)


def test_ranges_of_fewer_anchors_than_a_fix_takes_count_nothing(hall: Room, tmp_path: Path) -> None:
    scenario = in_hall(hall, tmp_path)
    truth = planned_truth(scenario)[1]
    found = information_rows(scenario.model_copy(update={"sensors": ("imu",)}), truth, hall)
    assert found is not None
    model = path_model(*dynamics(scenario), found[0], len(truth), 10)
    J, there = range_information(scenario, truth, hall, hall.anchor_positions[:2], 10)
    J_sum, heard = J.sum(axis=0), there.sum(axis=0)
    nothing = position_variance(model, np.zeros_like(J_sum), heard, 0)
    np.testing.assert_array_equal(position_variance(model, J_sum, heard, 3), nothing)
    assert position_variance(model, J_sum, heard, 1)[-1] < nothing[-1]


def test_mounting_places_are_free_and_away_from_the_path(hall: Room, tmp_path: Path) -> None:
    scenario = in_hall(hall, tmp_path)
    path = planned_truth(scenario)[1][:, :3]
    places = mounting_places(hall, 1.5, path, scenario.vehicle.radius)
    assert len(places) > 80
    low, high = np.array(hall.interior.min), np.array(hall.interior.max)
    assert np.all(places > low)
    assert np.all(places < high)
    for x, y, z, yaw, *half in hall.wall_boxes:  # turned by 0 or 90 degrees
        turned = np.array(half if yaw == 0.0 else [half[1], half[0], half[2]])
        assert not np.any(np.all(np.abs(places - [x, y, z]) < turned, axis=1))
    gaps = np.linalg.norm(places[:, None] - path[None], axis=2).min(axis=1)
    assert gaps.min() > scenario.vehicle.radius
    sides = np.minimum(places - low, high - places)
    nearest = np.minimum(sides[:, :2].min(axis=1), high[2] - places[:, 2])  # outer walls and ceiling
    for x, y, _, yaw, a, b, _ in hall.wall_boxes:
        half = np.array([a, b] if yaw == 0.0 else [b, a])
        beyond = np.maximum(np.abs(places[:, :2] - [x, y]) - half, 0.0)
        nearest = np.minimum(nearest, np.hypot(*beyond.T))
    np.testing.assert_allclose(nearest, 0.05, atol=1e-3)


@pytest.mark.long
def test_placing_lowers_the_worst_floor_and_is_always_the_same(hall: Room, tmp_path: Path) -> None:
    scenario = in_hall(hall, tmp_path)
    found = place_anchors(scenario, 8, spacing=2.0)
    assert found.after.floor < 0.7 * found.before.floor
    assert found == place_anchors(scenario, 8, spacing=2.0)
    file = tmp_path / "placed.yaml"
    file.write_text(room_text(found.room, "placed"))
    moved = scenario.model_copy(update={"room": str(file)})
    assert worst_floor(moved) == found.after
    floor = position_floor(moved, planned_truth(moved)[1])
    assert floor is not None
    assert np.sqrt(floor.sum(axis=1).max()) == found.after.floor
    assert len(found.room.anchors) == 8
    assert with_anchors(found.room, hall.anchor_positions) == hall


@pytest.mark.long
def test_what_cannot_be_placed_is_refused(hall: Room, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"sensors: .* must have uwb"):
        place_anchors(in_hall(hall, tmp_path, "sensors=[imu]"), 8)
    with pytest.raises(InputError, match=r"uwb\.kind: differences: must be ranges"):
        place_anchors(load_scenario("tight_differences"), 4)
    with pytest.raises(InputError, match="N: 500: must not exceed the"):
        place_anchors(in_hall(hall, tmp_path), 500, spacing=3.0)
    for spacing in (0.25, 0.4):
        with pytest.raises(InputError, match=f"--spacing {spacing}: makes about"):
            place_anchors(in_hall(hall, tmp_path), 8, spacing=spacing)


def test_anchors_spread_evenly_stand_on_the_walls() -> None:
    low, high = np.array([0.0, -2.0, 0.0]), np.array([6.0, 2.0, 3.0])
    p = spread_evenly(low, high, 10)
    np.testing.assert_allclose(np.minimum(p - low, high - p)[:, :2].min(axis=1), 0.0, atol=1e-12)
    along = np.array([1.0, 3.0, 5.0, 6.0, 6.0, 5.0, 3.0, 1.0, 0.0, 0.0])
    np.testing.assert_allclose(p[:, 0], along, atol=1e-12)
