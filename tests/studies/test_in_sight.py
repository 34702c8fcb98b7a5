"""Anchors in sight, their dilution and landmarks in view, against closed forms, NumPy's inverse and hand-made walls."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from ortilo_drake.model.room import Room
from ortilo_drake.model.typed_yaml import validate
from ortilo_drake.scenario import load_scenario
from ortilo_drake.studies.rooms.in_sight import Eyes, anchors_in_sight, dilution

TETRAHEDRON = np.array([[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]])
LEAST: dict[str, Any] = {
    "interior": {"min": [0, 0, 0], "max": [10, 10, 3]},
    "anchors": [[1, 1, 1], [9, 1, 2], [9, 7, 1]],
}
OCTAHEDRON = np.vstack([np.eye(3), -np.eye(3)])


def room_with(**changes: Any) -> Room:
    return validate(Room, LEAST | changes, "room.yaml")


@given(st.floats(0.1, 30.0), st.tuples(*[st.floats(-20.0, 20.0)] * 3))
def test_anchors_spread_alike_dilute_by_3_over_root_n(scale: float, middle: tuple[float, float, float]) -> None:
    at = np.array([middle])
    for corners, expected in ((TETRAHEDRON, np.sqrt(9.0 / 4.0)), (OCTAHEDRON, np.sqrt(9.0 / 6.0))):
        found = dilution(at, at + scale * corners, np.ones((1, len(corners)), dtype=bool))
        np.testing.assert_allclose(found, expected, rtol=1e-9)


@given(st.integers(0, 10**6), st.integers(3, 9))
def test_dilution_is_the_inverse_of_the_normal_matrix_over_those_in_sight(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    point, anchors, seen = rng.normal(size=(1, 3)), 5.0 * rng.normal(size=(n + 2, 3)), np.ones((1, n + 2), dtype=bool)
    seen[0, :2] = False
    G = (anchors[2:] - point) / np.linalg.norm(anchors[2:] - point, axis=1)[:, None]
    expected = np.sqrt(np.trace(np.linalg.inv(G.T @ G)))
    np.testing.assert_allclose(dilution(point, anchors, seen), expected, rtol=1e-6)


def test_two_anchors_or_a_plane_through_the_vehicle_give_no_position() -> None:
    at, flat = np.zeros((1, 3)), np.array([[1.0, 0, 0], [0, 1, 0], [-1, 1, 0], [-1, -1, 0], [2, -1, 0]])
    assert dilution(at, TETRAHEDRON, np.array([[True, True, False, False]])) == np.inf
    assert dilution(at, flat, np.ones((1, 5), dtype=bool)) == np.inf
    assert dilution(at, TETRAHEDRON, np.zeros((1, 4), dtype=bool)) == np.inf


def test_a_wall_takes_the_sight_of_what_is_behind_it_and_no_more() -> None:
    """A wall at x = 5, 0.2 m thick, from y = 2 to 6 and 2 m high, seen from (2, 4, 1)."""
    anchors = {
        (8.0, 4.0, 1.0): False,  # straight behind it
        (8.0, 4.0, 4.9): True,  # over it: at x = 5.1 the line is 3.0 m high
        (8.0, 4.0, 2.9): False,  # not over it: at x = 5.1 the line is 1.98 m high
        (8.0, 8.9, 1.0): True,  # past its end: at x = 4.9 the line is at y = 6.37
        (8.0, 7.7, 1.0): False,  # at x = 4.9 the line is at y = 5.79
        (4.0, 4.0, 1.0): True,  # in front of it
        (5.0, 5.0, 1.0): True,  # in the wall, which holds it
    }
    room = room_with(anchors=[list(p) for p in anchors], walls=[[5.0, 4.0, np.pi / 2, 4.0, 0.2, 2.0]])
    at = np.array([[2.0, 4.0, 1.0]])
    assert anchors_in_sight(at, room, 100.0, walls_block=True).tolist() == [list(anchors.values())]
    assert anchors_in_sight(at, room, 100.0, walls_block=False).all()
    near = [np.linalg.norm(np.array(p) - at) <= 6.5 for p in anchors]
    assert anchors_in_sight(at, room, 6.5, walls_block=False).tolist() == [near]


@pytest.mark.parametrize("yaw", [0.0, np.pi / 2, np.pi, -np.pi / 2, 0.4, -2.5])
def test_a_landmark_is_in_view_where_the_vehicle_looks_at_it_and_no_wall_is_between(tmp_path: Path, yaw: float) -> None:
    """Persons 4 m away every 90 degrees; a picture spans 47 degrees to each side, and one is behind a wall."""
    around = np.arange(4) * np.pi / 2
    places = 5.0 + 4.0 * np.column_stack([np.cos(around), np.sin(around)])
    people = [{"label": "person", "position": [*p.tolist(), 1.0]} for p in places]
    walls = [[5.0, 3.0, 0.0, 3.0, 0.2, 3.0]]
    file = tmp_path / "room.yaml"
    file.write_text(yaml.safe_dump(LEAST | {"landmarks": people, "walls": walls}))
    scenario = load_scenario("imu_uwb_yolo", (f"room={file}", "camera.kind=projected", "planner.kind=hover"))
    found = Eyes(scenario).in_view(np.array([5.0, 5.0, 1.2]), yaw)
    off = np.abs((around - yaw + np.pi) % (2 * np.pi) - np.pi)
    assert found.tolist() == [i for i in range(3) if off[i] < np.radians(43)]
