"""All that is wrong with a room file, at once."""

from pathlib import Path

import pytest
import yaml
from command_line import run

from ortilo_drake.model.input_error import InputError
from ortilo_drake.model.room import ORTILO_ROOM, load_room
from ortilo_drake.studies.rooms.findings import room_problems

LEAST = "interior: {min: [0, 0, 0], max: [8, 6, 3]}\nanchors: [[0, 0, 1], [8, 0, 2], [8, 6, 1], [0, 6, 3]]\n"
FIVE_MISTAKES = """
interior: {min: [0, 0, 0], max: [8, -1, 3]}                     # y
anchors: [[0, 0, 1], [8, .nan, 2], [8, 6], [0, 6, 3]]           # not a number; no z
landmarks: [{label: dog, position: [1, 1, 0.3], yaww: 3}]       # yaww
furniture: [[shelves, 5.0, 4.0, 0.0, 0.0, 0.0, 0.0]]            # no furniture_size
"""


def problems(tmp_path: Path, text: str) -> list[str]:
    file = tmp_path / "room.yaml"
    file.write_text(text)
    found = room_problems(file)
    assert all(line.startswith(f"{file}: ") for line in found)
    return [line.removeprefix(f"{file}: ") for line in found]


def test_five_mistakes_are_told_in_five_lines_each_with_field_value_and_what_is_allowed(tmp_path: Path) -> None:
    assert sorted(problems(tmp_path, FIVE_MISTAKES)) == [
        "anchors.1.1: nan: must be a finite number",
        "anchors.2.2: is missing",
        "furniture_size: no size for kind 'shelves'",
        "interior: min y = 0.0 must be below max y = -1.0",
        "landmarks.0.yaww: unknown key (value 3), did you mean 'yaw'?",
    ]


def test_the_command_prints_them_all_and_ends_with_two(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "room.yaml"
    file.write_text(FIVE_MISTAKES)
    assert run("room", "check", str(file)) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert len(printed.err.splitlines()) == 5
    assert all(line.startswith(f"ortilo: {file}: ") for line in printed.err.splitlines())


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("[1, 2]", ["the file: [1, 2]: must hold fields by name, not list"]),
        ("", ["the file: None: must hold fields by name, not NoneType"]),
        ("name: hall", ["interior: is missing", "anchors: is missing"]),
        (LEAST + "start: [1, .inf]", ["start.1: inf: must be a finite number"]),
        (LEAST + "walls: [[1, 1, 0], [1, 1]]", ["walls.1: [1, 1]: must have at least 3 items"]),
        (LEAST + "walls: [[1, 1, 0, 2, 0, 1]]", ["walls.0: [1.0, 1.0, 0.0, 2.0, 0.0, 1.0]: must be x, y, yaw"]),
        (LEAST + "landmarks: [{label: owl, position: [1, 1, 1]}]", ["landmark_size: no size for class 'owl'"]),
        (LEAST + "camera: {width: 0}", ["camera.width: 0: must be", "camera.height: is missing"]),
    ],
)
def test_each_line_names_its_field(tmp_path: Path, text: str, expected: list[str]) -> None:
    found = problems(tmp_path, text)
    assert [line[: len(part)] for line, part in zip(found, expected, strict=False)] == expected


def test_too_few_anchors_are_told_but_not_where_wrong_ones_are_told_already(tmp_path: Path) -> None:
    two = LEAST.replace("[8, 6, 1], [0, 6, 3]", "")
    assert problems(tmp_path, two) == ["anchors: 2 given, a position needs at least 3"]
    assert problems(tmp_path, two.replace("[0, 0, 1]", "[0, 0, up]")) == ["anchors.0.2: 'up': must be a number"]


def test_a_file_of_the_least_has_the_rest_of_the_authors_room(tmp_path: Path) -> None:
    file = tmp_path / "room.yaml"
    file.write_text(LEAST + "landmarks: [{label: dog, position: [1, 1, 0.3]}, {label: chair, position: [2, 1, 0.3]}]\n")
    assert room_problems(file) == []
    room, known = load_room(file), yaml.safe_load(ORTILO_ROOM.read_text())
    for label in ("dog", "chair"):
        assert list(room.landmark_size[label]) == known["landmark_size"][label]
        assert [list(point) for point in room.landmark_outline[label]] == known["landmark_outline"][label]
    assert room.camera == load_room().camera
    assert (room.wall_size, room.stand_radius, room.stand_height) == ((3.0, 1.0, 3.0), 0.25, 0.86)
    assert room.walls == room.stands == room.furniture == ()


def test_a_wall_may_have_a_size_of_its_own(tmp_path: Path) -> None:
    file = tmp_path / "room.yaml"
    file.write_text(LEAST + "wall_size: [2, 0.5, 1]\nwalls: [[1, 2, 0.3], [4, 2, 1.5, 1.0, 0.2, 2.4]]\n")
    expected = [[1, 2, 0.5, 0.3, 1.0, 0.25, 0.5], [4, 2, 1.2, 1.5, 0.5, 0.1, 1.2]]
    assert load_room(file).wall_boxes.tolist() == expected


CFCLIENT = "{0: {x: 0.0, y: 0.0, z: 0.3}, 1: {x: 4.0, y: 0.0, z: 2.6}, 0x1a: [0.0, 3.0, 2.5], 07: {x: 4, y: 3, z: 1}}"


def test_anchors_by_name_are_read_in_the_order_of_the_file(tmp_path: Path) -> None:
    """As cfclient saves them: number: {x, y, z}."""
    file = tmp_path / "room.yaml"
    for anchors in (CFCLIENT, "[{x: 0, y: 0, z: 0.3}, [4, 0, 2.6], {x: 0, y: 3, z: 2.5}, [4, 3, 1]]"):
        file.write_text(f"interior: {{min: [0, 0, 0], max: [4, 3, 3]}}\nanchors: {anchors}\n")
        assert room_problems(file) == []
        assert load_room(file).anchors == ((0.0, 0.0, 0.3), (4.0, 0.0, 2.6), (0.0, 3.0, 2.5), (4.0, 3.0, 1.0))


@pytest.mark.parametrize(
    ("text", "line"),
    [
        (
            f"interior: {{}}\nanchors: {CFCLIENT.replace(', z: 2.6', '')}",
            r"anchors\.1: .*must be \[\[x, y, z\], \.\.\.\] in m, or",
        ),
        (
            f"interior: {{}}\nanchors: {CFCLIENT.replace('[0.0, 3.0, 2.5]', 'here')}",
            r"anchors\.0x1a: here: must be \[\[x",
        ),
        (
            CFCLIENT.replace("[0.0, 3.0, 2.5]", "{x: 0, y: 3, z: 2}"),
            "holds anchors alone; a room has them under 'anchors:'",
        ),
    ],
)
def test_anchors_by_name_that_are_none_are_told_what_is_wanted(tmp_path: Path, text: str, line: str) -> None:
    file = tmp_path / "room.yaml"
    file.write_text(text)
    with pytest.raises(InputError, match=line):
        load_room(file)
