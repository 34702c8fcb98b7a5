"""The corridor about a path ends where a flight would be lost."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from ortilo_drake.flight.lost import find_loss
from ortilo_drake.model.room import Room, load_room
from ortilo_drake.model.vehicle import Vehicle
from ortilo_drake.studies.tube.corridor import Corridor, corridor, margin
from ortilo_drake.studies.tube.tube import Tube

ROOM, VEHICLE = load_room(), Vehicle()


def is_lost(p_WB: np.ndarray) -> bool:
    states = np.zeros((1, 12))
    states[0, :3] = p_WB
    return find_loss(states, 0.1, ROOM, VEHICLE) is not None


@pytest.mark.long
@given(st.floats(-0.5, 22.0), st.floats(-4.0, 3.0), st.floats(0.0, 2.0 * np.pi), st.floats(0.0, 0.999))
def test_nothing_within_the_corridor_is_lost(x: float, y: float, direction: float, share: float) -> None:
    p = np.array([x, y, 1.5])
    about = corridor(ROOM, VEHICLE, p[None])
    assume(about.radius[0] > 0.0)
    away = share * about.radius[0] * np.array([np.cos(direction), np.sin(direction), 0.0])
    assert not is_lost(p + away)


@pytest.mark.long
@given(st.floats(0.0, 21.0), st.floats(-3.5, 2.5))
def test_a_step_beyond_the_corridor_is_lost_in_some_direction(x: float, y: float) -> None:
    p = np.array([x, y, 1.5])
    about = corridor(ROOM, VEHICLE, p[None])
    assume(about.radius[0] > 0.0)
    angles = np.linspace(0.0, 2.0 * np.pi, 721)
    reach = about.radius[0] * 1.01 + 1e-3
    ring = p + reach * np.column_stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)])
    assert any(is_lost(point) for point in ring)


def test_height_reaches_floor_and_ceiling() -> None:
    path = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 2.8]])
    low, high = ROOM.interior.min[2], ROOM.interior.max[2]
    np.testing.assert_allclose(
        corridor(ROOM, VEHICLE, path).height, [min(1.0 - low, high - 1.0), min(2.8 - low, high - 2.8)]
    )


def test_a_wall_beside_the_path_is_named() -> None:
    x, y, _ = ROOM.walls[9]
    alone = Room.model_validate(ROOM.model_dump() | {"walls": ((x, y, 0.0),)})
    half_y = ROOM.wall_size[1] / 2
    path = np.array([[x, y + half_y + VEHICLE.radius + 0.4, 1.5]])
    about = corridor(alone, VEHICLE, path)
    np.testing.assert_allclose(about.radius, 0.4, atol=1e-12)
    assert about.nearest[0] == 0


def test_margin_is_the_least_over_the_path() -> None:
    n = 4
    about = Corridor(np.array([1.0, 0.6, 2.0, 1.0]), np.full(n, 1.5), np.array([3, 7, -1, 2]))
    r = np.arange(3.0 * n).reshape(n, 3)
    tube = Tube(
        np.arange(n), r, np.zeros((n, 3)), np.zeros((n, 3, 3)), np.zeros((n, 3, 3)), np.full(n, 0.5), np.full(n, 1.6)
    )
    found = margin(tube, about)
    assert (found.tick, found.nearest) == (1, 7)
    np.testing.assert_allclose([found.horizontal, found.vertical, found.least], [0.1, -0.1, -0.1])
    np.testing.assert_array_equal(found.place, r[1])
