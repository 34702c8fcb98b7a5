"""New room files of many sizes load, say nothing against themselves, and have a way through them that can be flown."""

import re
from pathlib import Path

import numpy as np
import pytest
from command_line import run
from hypothesis import given, settings
from hypothesis import strategies as st

from ortilo_drake.flight.flight import fly
from ortilo_drake.model.input_error import InputError
from ortilo_drake.model.room import Room, load_room
from ortilo_drake.model.typed_yaml import parse_yaml
from ortilo_drake.model.vehicle import M100
from ortilo_drake.onboard.planner.planner import plan
from ortilo_drake.scenario import GcsPlanner, load_scenario
from ortilo_drake.studies.rooms.new_room import new_room, parse_size

OPEN = "uwb.link.blackouts=[]"


def made(folder: Path, size: tuple[float, float, float], anchors: int) -> tuple[Room, Path]:
    file = folder / "hall.yaml"
    file.write_text(new_room("hall", size, anchors))
    return load_room(file), file


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("rooms")


sides = st.floats(3.0, 30.0)


@pytest.mark.long
@settings(max_examples=15)
@given(x=sides, y=sides, z=st.floats(2.0, 20.0), anchors=st.integers(3, 40))
def test_a_room_of_any_size_loads_and_has_a_way_through_it(
    folder: Path, x: float, y: float, z: float, anchors: int
) -> None:
    room, _ = made(folder, (x, y, z), anchors)
    low, high = np.zeros(3), np.array([x, y, z])
    assert len(room.anchors) == len({tuple(row) for row in room.anchors}) == anchors
    for points in (room.anchor_positions, room.landmark_positions):
        assert np.all((points > low) & (points < high + 1e-3))
    if anchors > 3:  # the smallest of the three extents of the anchors: not all in one plane
        spread = np.linalg.svd(room.anchor_positions - room.anchor_positions.mean(axis=0), compute_uv=False)
        assert spread[-1] > 0.5
    assert len(room.landmarks) >= 2
    assert room.start is not None
    assert room.goal is not None
    path = plan(GcsPlanner(start=room.start, goal=room.goal), room, M100)
    np.testing.assert_allclose(path.value(0.0)[:2, 0], room.start, atol=1e-9)
    np.testing.assert_allclose(path.value(path.end_time())[:2, 0], room.goal, atol=1e-6)


def test_a_flight_takes_start_and_goal_of_the_room_unless_it_has_its_own(folder: Path) -> None:
    room, file = made(folder, (8.0, 6.0, 3.0), 5)
    at = f"room={file}"

    def way(*changes: str) -> tuple[object, object]:
        planner = load_scenario("imu_uwb", changes).planner
        assert isinstance(planner, GcsPlanner)
        return planner.start, planner.goal

    assert way() == ((0.0, 0.0), (21.0, -3.2))
    assert way(at) == (room.start, room.goal)
    assert way(at, "planner.goal=[6.0, 1.5]", "planner.speed=0.5") == (room.start, (6.0, 1.5))
    assert way(at, "planner={kind: gcs, start: [2.0, 2.0]}") == ((2.0, 2.0), room.goal)
    own = folder / "own.yaml"
    own.write_text(f"base: imu_uwb\nroom: {file}\nplanner: {{kind: gcs, start: [2.0, 3.0]}}\n")
    scenario = load_scenario(own)
    assert isinstance(scenario.planner, GcsPlanner)
    assert (scenario.planner.start, scenario.planner.goal) == ((2.0, 3.0), room.goal)
    assert load_scenario(scenario, ("planner.speed=0.5",)).planner == scenario.planner.model_copy(update={"speed": 0.5})
    elsewhere = load_scenario(load_scenario("imu_uwb"), (at,)).planner
    assert isinstance(elsewhere, GcsPlanner)
    assert (elsewhere.start, elsewhere.goal) == (room.start, room.goal)


@pytest.mark.long
def test_a_new_room_is_flown_to_its_goal(folder: Path) -> None:
    room, file = made(folder, (8.0, 6.0, 3.0), 5)
    flight = fly(load_scenario("imu_uwb", (f"room={file}", OPEN)))
    assert flight.attrs["lost"] == "null"
    np.testing.assert_allclose(flight["truth"].values[-1, :2], room.goal, atol=0.3)


def test_the_command_writes_a_file_once(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = folder / "my flat.yaml"
    assert run("room", "new", str(file), "--size", "5x4x2.5", "--anchors", "6") == 0
    text = file.read_text()
    assert load_room(file).interior.max == (5.0, 4.0, 2.5)
    assert len(load_room(file).anchors) == 6
    assert load_room(file).name == "my flat"
    assert run("room", "check", str(file)) == 0
    capsys.readouterr()
    assert run("room", "new", str(file)) == 2
    assert "exists; --force overwrites it" in capsys.readouterr().err
    assert file.read_text() == text
    assert run("room", "new", str(file), "--force") == 0
    assert file.read_text() != text


def test_each_field_of_the_file_is_explained(folder: Path) -> None:
    text = new_room("hall", (8.0, 6.0, 3.0), 5)
    for field in parse_yaml(text, "hall"):
        before = text[: text.index(f"\n{field}:")].splitlines()[-3:]
        assert any(re.match("#", line) for line in before), field


@pytest.mark.parametrize("size", ["8x6", "8 by 6", "x6x3", "2x6x3", "8x6x1", "nanx6x3", "1e9x6x3", "-8x6x3", ""])
def test_a_wrong_size_is_refused(size: str) -> None:
    with pytest.raises(InputError, match="--size"):
        parse_size(size)


@pytest.mark.parametrize("anchors", [-1, 0, 2, 1001])
def test_a_wrong_number_of_anchors_is_refused(anchors: int) -> None:
    with pytest.raises(InputError, match=r"--anchors.*3 to 1000"):
        new_room("hall", (8.0, 6.0, 3.0), anchors)
