"""Random rooms and poses hold what they promise, for any seed."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ortilo_drake.model.pinhole import R_BC
from ortilo_drake.model.room import Room, load_room
from ortilo_drake.training.pictures.random_rooms import clutter_kinds, random_pose, random_room
from ortilo_drake.world.scenery.scene import mesh_file, scene_items

BASE = load_room()
seeds = st.integers(0, 2**63 - 1)


def room_of(seed: int) -> Room:
    return random_room(BASE, np.random.default_rng(seed))


def from_wall(x: float, y: float, room: Room) -> float:
    """Return the distance from the nearest wall in plan, 0 within one."""
    distances = []
    for wall_x, wall_y, _, yaw, half_x, half_y, _ in room.wall_boxes:
        along = np.cos(yaw) * (x - wall_x) + np.sin(yaw) * (y - wall_y)
        across = -np.sin(yaw) * (x - wall_x) + np.cos(yaw) * (y - wall_y)
        distances.append(np.hypot(max(abs(along) - half_x, 0.0), max(abs(across) - half_y, 0.0)))
    return min(distances)


@pytest.mark.long
@given(seeds)
def test_a_room_is_valid_and_of_the_bases_classes_and_camera(seed: int) -> None:
    room = room_of(seed)
    assert Room.model_validate_json(room.model_dump_json()) == room
    assert 5 <= len(room.landmarks) <= 24
    assert set(room.classes) <= set(BASE.classes)
    assert room.camera == BASE.camera
    for landmark in room.landmarks:
        assert landmark.size is not None
        ratio = np.array(landmark.size) / BASE.landmark_size[landmark.label]
        assert np.ptp(ratio) < 1e-3 * ratio.max()  # its shape stays
        assert 0.54 < ratio.mean() < 1.61


@pytest.mark.long
@given(seeds)
def test_landmarks_stand_within_the_walls_and_apart(seed: int) -> None:
    room = room_of(seed)
    low, high = np.array(room.interior.min), np.array(room.interior.max)
    p = room.landmark_positions
    assert np.all(p > low)
    assert np.all(p < high)
    things = np.vstack([p[:, :2], [item[1:3] for item in room.furniture]])
    apart = np.hypot(*(things[:, None] - things[None]).transpose(2, 0, 1)) + 10.0 * np.eye(len(things))
    assert apart.min() >= 0.75
    for x, y in things:
        assert from_wall(x, y, room) > 0.44
    bottoms = p[:, 2] - np.array([landmark.size for landmark in room.landmarks])[:, 2] / 2
    assert bottoms.min() > -1e-9


@pytest.mark.long
@given(seeds)
def test_the_walls_leave_no_gap_around_the_room(seed: int) -> None:
    room = room_of(seed)
    (x_0, y_0, _), (x_1, y_1, _) = room.interior.min, room.interior.max
    for share in np.linspace(0.0, 1.0, 41):
        x, y = x_0 + share * (x_1 - x_0), y_0 + share * (y_1 - y_0)
        for edge in ((x, y_0 - 0.3), (x, y_1 + 0.3), (x_0 - 0.3, y), (x_1 + 0.3, y)):
            assert from_wall(*edge, room) == 0.0


@pytest.mark.long
@given(seeds, st.booleans())
@settings(max_examples=40)
def test_poses_are_clear_of_obstacles_and_level_but_for_a_tilt(seed: int, on_a_path: bool) -> None:
    room, rng = room_of(seed), np.random.default_rng(seed)
    middle = np.array([(room.interior.min[0] + room.interior.max[0]) / 2, 0.0, 1.5])
    path = middle + np.linspace(-3.0, 3.0, 50)[:, None] * [1.0, 0.0, 0.0]
    for _ in range(5):
        X_WC = random_pose(room, rng, path if on_a_path else None)
        R_WB = X_WC.rotation().matrix() @ R_BC.T
        p_WB = X_WC.translation() - R_WB @ np.array(room.camera.position)
        assert np.all(p_WB[:2] > np.array(room.interior.min[:2]))
        assert np.all(p_WB[:2] < np.array(room.interior.max[:2]))
        assert from_wall(p_WB[0], p_WB[1], room) >= 0.45 - 1e-9
        for landmark in room.landmarks:
            assert landmark.size is not None
            top = landmark.position[2] + landmark.size[2] / 2
            away = np.hypot(*(p_WB[:2] - landmark.position[:2]))
            assert away > 0.45 or p_WB[2] > top
        assert R_WB[2, 2] > np.cos(0.5)  # upright
        if on_a_path:
            assert R_WB[0, 0] > 0.5  # it looks along x


@given(seeds)
@settings(max_examples=10)
def test_the_same_seed_gives_the_same_room_and_poses_and_another_does_not(seed: int) -> None:
    one, other = room_of(seed), room_of(seed)
    assert one == other
    assert one != room_of(seed + 1)
    poses = [random_pose(one, np.random.default_rng(seed)).GetAsMatrix34() for _ in range(2)]
    np.testing.assert_array_equal(*poses)


def test_everything_in_a_random_room_has_a_mesh() -> None:
    room = room_of(3)
    assert {item.kind for item in scene_items(room)} - {"floor", "post"} <= {
        kind for kind in (*clutter_kinds(BASE), *room.classes, "wall", "stand") if mesh_file(kind).exists()
    }


@pytest.mark.long
def test_a_room_without_a_free_place_says_so() -> None:
    low, high = BASE.interior.min, BASE.interior.max
    walls = [[x, y, 0.0] for x in np.arange(low[0], high[0] + 3, 3.0) for y in np.arange(low[1], high[1] + 1, 1.0)]
    room = Room.model_validate_json(json.dumps(BASE.model_dump(mode="json") | {"walls": walls}))
    with pytest.raises(RuntimeError, match="no free place"):
        random_pose(room, np.random.default_rng(0))
