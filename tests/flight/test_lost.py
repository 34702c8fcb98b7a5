"""When a flight counts as lost, on made-up series of states and in flight."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ortilo_drake.flight.flight import fly
from ortilo_drake.flight.lost import contacts, find_loss
from ortilo_drake.model.room import ORTILO_ROOM, load_room
from ortilo_drake.model.vehicle import M100
from ortilo_drake.scenario import load_scenario

ROOM = load_room(ORTILO_ROOM)
H = 1.0 / 30.0


def at_rest(p_WB: tuple[float, float, float] = (8.0, 1.0, 1.5), ticks: int = 40) -> np.ndarray:
    states = np.zeros((ticks, 12))
    states[:, 0:3] = p_WB
    return states


def test_a_flight_at_rest_in_free_space_is_not_lost() -> None:
    assert find_loss(at_rest(), H, ROOM, M100) is None
    assert contacts(at_rest(), ROOM, M100) == []


@pytest.mark.parametrize(
    ("column", "value", "cause"),
    [
        (3, np.deg2rad(61.0), "tumbled"),
        (4, np.deg2rad(-61.0), "tumbled"),
        (3, np.pi, "tumbled"),  # on its back
        (2, -0.01, "left the room"),
        (2, 3.01, "left the room"),
        (0, 40.0, "left the room"),
        (0, np.nan, "diverged"),
        (10, np.inf, "diverged"),
    ],
)
@pytest.mark.parametrize("tick", [0, 1, 17, 39])
def test_a_loss_is_found_at_its_very_tick(column: int, value: float, cause: str, tick: int) -> None:
    states = at_rest()
    states[tick, column] = value
    lost = find_loss(states, H, ROOM, M100)
    assert lost is not None
    assert (lost.tick, lost.time, lost.cause) == (tick, pytest.approx(tick / 30.0), cause)


@pytest.mark.parametrize(("column", "value"), [(3, np.deg2rad(59.0)), (5, np.pi), (2, 0.01), (2, 2.99), (7, 100.0)])
def test_what_is_still_allowed_is_not_a_loss(column: int, value: float) -> None:
    states = at_rest()
    states[17, column] = value
    assert find_loss(states, H, ROOM, M100) is None


def test_tilt_is_the_angle_between_the_bodys_and_the_rooms_upward_axes() -> None:
    rpy = np.random.default_rng(1).uniform(-np.pi, np.pi, (2000, 3))
    up_B_W = Rotation.from_euler("ZYX", rpy[:, ::-1]).apply([0.0, 0.0, 1.0])
    tilt = np.arccos(np.clip(up_B_W[:, 2], -1.0, 1.0))
    states = at_rest(ticks=1).repeat(2000, axis=0)
    states[:, 3:6] = rpy
    found = [find_loss(row[np.newaxis], H, ROOM, M100) is not None for row in states]
    np.testing.assert_array_equal(found, tilt > np.deg2rad(60.0))
    assert 0.1 < np.mean(found) < 0.9


def test_the_earliest_of_several_losses_counts() -> None:
    states = at_rest()
    states[20:, 3] = np.pi
    states[12:, 2] = 5.0
    states[30:] = np.nan
    lost = find_loss(states, H, ROOM, M100)
    assert lost is not None
    assert (lost.tick, lost.cause) == (12, "left the room")


def test_a_wall_is_hit_when_the_outline_reaches_its_face() -> None:
    # The wall about (5.692, -0.832) is 1 m thick: its face is at y = -0.332.
    states = at_rest((5.0, 0.0, 1.5), 131)
    states[:, 1] = 1.0 - 0.01 * np.arange(131)
    lost = find_loss(states, H, ROOM, M100)
    first = int(np.argmax(states[:, 1] + 0.332 < M100.radius))
    assert 80 < first < 90
    assert lost is not None
    assert (lost.tick, lost.cause) == (first, "hit a wall")


@pytest.mark.parametrize(("gap", "is_hit"), [(0.30, True), (0.40, False)])
def test_the_outline_passes_a_walls_corner_as_a_disc(gap: float, is_hit: bool) -> None:
    corner = np.array([5.692 + 1.5, -0.832 + 0.5])
    assert (gap * np.sqrt(2.0) < M100.radius) == is_hit
    lost = find_loss(at_rest((corner[0] + gap, corner[1] + gap, 2.5)), H, ROOM, M100)
    assert (lost is not None) == is_hit


@pytest.mark.parametrize(
    ("point", "touched"),
    [
        ((6.656, 0.60, 1.5), ["person", "person_standing_0"]),  # 0.675 m from a person of radius 0.25 m
        ((6.656, 0.80, 1.5), []),
        ((6.656, 0.60, 2.05), ["person", "person_standing_0"]),
        ((6.656, 0.60, 2.2), []),  # over the head: 1.95 m and half a body of 0.15 m
    ],
)
def test_furniture_is_touched_but_does_not_end_a_flight(point: tuple[float, float, float], touched: list[str]) -> None:
    states = at_rest()
    states[7, 0:3] = point
    assert find_loss(states, H, ROOM, M100) is None
    assert contacts(states, ROOM, M100) == touched


@pytest.mark.parametrize(
    ("cause", "settings"),
    [
        ("tumbled", ("world.disturbance.torque_density=0.913", "planner={kind: hover, point: [8, 1, 1.5]}")),
        ("left the room", ("planner={kind: hover, point: [8, 1, 0.02]}",)),
        ("hit a wall", ("world.disturbance.force_density=0.365", "planner={kind: hover, point: [3.0, 4.04, 1.5]}")),
    ],
)
def test_a_lost_flight_ends_early_with_time_and_cause(cause: str, settings: tuple[str, ...]) -> None:
    scenario = load_scenario("nominal_imu_uwb", settings)
    flight = fly(scenario)
    lost = json.loads(flight.attrs["lost"])
    states = flight["truth"].values
    assert lost == {"time": pytest.approx(float(flight["time"][-1])), "cause": cause}
    assert flight.sizes["tick"] < 12 * 30  # 10 s of hovering and 2 s to settle
    assert find_loss(states[:-1], scenario.h, ROOM, scenario.vehicle) is None
    last = states[-1]
    match cause:
        case "tumbled":
            assert np.cos(last[3]) * np.cos(last[4]) < 0.5
        case "left the room":
            assert last[2] < 0.0
        case "hit a wall":
            assert last[1] + M100.radius > 5.053 - 0.5  # the face of the wall about (2.96, 5.053)
