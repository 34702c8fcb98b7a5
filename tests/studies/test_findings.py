"""What `ortilo room check` says of rooms that load: a good one, and one for each mistake that it warns of."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from command_line import run
from hypothesis import given, settings
from hypothesis import strategies as st

from ortilo_drake.model.inputs.room_text import parse_room
from ortilo_drake.model.room import ORTILO_ROOM, Room
from ortilo_drake.studies.rooms.findings import anchor_spread, doubted_units, look_into
from ortilo_drake.studies.rooms.new_room import new_room

LEVEL = [[0.2, 0.2, 2.5], [7.8, 0.2, 2.5], [7.8, 5.8, 2.5], [0.2, 5.8, 2.5]]
DOG = {"label": "dog", "position": [4.0, 5.5, 0.3]}


def warnings(folder: Path, **changes: Any) -> list[str]:
    data = yaml.safe_load(new_room("hall", (8.0, 6.0, 3.0), 5))
    file = folder / "room.yaml"
    file.write_text(yaml.safe_dump(data | changes))
    return look_into(file).warnings


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, []),
        ({"anchors": LEVEL}, ["anchors: 0.00 m RMS off one plane"]),
        ({"anchors": LEVEL[:3]}, ["anchors: 3 given: a position and its mirror image"]),
        ({"anchors": [*LEVEL, [4, 3, 0], [4, 3, 0]]}, ["anchors.5: (4, 3, 0): the same place as anchors.4"]),
        ({"anchors": [*LEVEL, [4, 3, 0], [4, 6.5, 0]]}, ["anchors.5: (4, 6.5, 0): outside the interior, (0, 0, 0)"]),
        ({"start": [-1.0, 2.0]}, ["start: (-1, 2, 1.5): outside the room"]),
        ({"walls": [[9.0, 2.0, 0, 1, 1, 3]]}, ["walls.0: (9, 2): outside the interior, (0, 0) to (8, 6)"]),
        (
            {"walls": [[4000.0, 2000.0, 0, 1, 1, 3]]},
            ["walls.0: (4000, 2000): outside the interior, (0, 0) to (8, 6); is it in mi"],
        ),
        (
            {"anchors": [*LEVEL, [400, 300, 20]]},
            [
                "anchors: 0.11 m RMS off one plane",
                "anchors.4: (400, 300, 20): outside the interior, (0, 0, 0) to (8, 6, 3); is it in cent",
            ],
        ),
        ({"walls": [[4.0, 5.0, 90, 0.4, 0.4, 3]]}, ["walls.0: yaw 90: is in radians, 1.571 if in °"]),
        (  # an anchor on the face of a pillar that stands askew, and one in its middle
            {
                "anchors": [*LEVEL, [4.0 + 0.1 * 2**0.5, 5.0 + 0.1 * 2**0.5, 0.3], [4.0, 5.0, 1.0]],
                "walls": [[4.0, 5.0, 0.785398, 0.4, 0.4, 3]],
            },
            ["anchors.5: (4, 5, 1): in a wall"],
        ),
        ({"walls": [[1.2, 2.0, 0, 1, 1, 3]]}, ["start: (1.2, 2, 1.5): 0.00 m from 'wall'"]),
        ({"walls": [[3.5, 3.0, 1.5708, 6, 0.1, 3]]}, ["goal: (5.5, 4.0): no free way leads there from (1.2, 2.0)"]),
        ({"goal": None}, ["goal: not given; a scenario must have planner.goal of its own"]),
        ({"landmarks": []}, ["landmarks: none"]),
        (
            {"landmarks": [DOG | {"position": [1.0, 5.5, 9.0]}]},
            ["landmarks.0: (1, 5.5, 9): out", "landmarks.0: dog"],
        ),
        (  # a dog that four walls hide
            {
                "landmarks": [DOG],
                "walls": [[4.0, y, 0.0, 1.6, 0.1, 2.9] for y in (4.9, 5.95)]
                + [[x, 5.4, 1.5708, 1.1, 0.1, 2.9] for x in (3.2, 4.8)],
            },
            ["landmarks.0: dog at (4, 5.5, 0.3): the camera sees it from nowhere at 1.5 m height"],
        ),
        (
            {"landmarks": [DOG], "walls": [[4.0, 5.5, 0.0, 1.0, 1.0, 1.0]]},
            ["landmarks.0: dog at (4, 5.5, 0.3): its middle is in a wall"],
        ),
    ],
)
def test_a_mistake_is_warned_of_and_nothing_else(tmp_path: Path, changes: dict[str, Any], expected: list[str]) -> None:
    found = warnings(tmp_path, **changes)
    assert [line[: len(part)] for line, part in zip(found, expected, strict=True)] == expected, found


@pytest.mark.long
def test_the_authors_room_is_as_it_was_published() -> None:
    found = look_into(ORTILO_ROOM)
    assert found.warnings == ["anchors.6: (14.34, 1.113, 2.102): in a wall"]  # 0.41 m deep, as published
    assert found.path is not None
    assert "12" in found.facts[1]
    assert "29: 5 person" in found.facts[2]
    assert "37 walls, 25 stands, 51 pieces of furniture" in found.facts[3]


@given(st.integers(0, 10**6), st.integers(3, 12), st.floats(0.0, 3.0))
def test_the_spread_is_the_standard_deviation_along_the_main_axes(seed: int, n: int, thickness: float) -> None:
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(n, 3)) * [9.0, 5.0, thickness]
    Q = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    expected = np.sqrt(np.maximum(np.linalg.eigvalsh(np.cov(points.T, bias=True)), 0.0))[::-1]
    np.testing.assert_allclose(anchor_spread(points @ Q.T + 7.0), expected, atol=1e-6)


@pytest.mark.long
@settings(max_examples=10)
@given(x=st.floats(4.0, 20.0), y=st.floats(4.0, 20.0), z=st.floats(2.2, 6.0), anchors=st.integers(4, 12))
def test_new_rooms_have_nothing_against_them(
    tmp_path_factory: pytest.TempPathFactory, x: float, y: float, z: float, anchors: int
) -> None:
    file = tmp_path_factory.mktemp("room") / "room.yaml"
    file.write_text(new_room("hall", (x, y, z), anchors))
    assert look_into(file).warnings == []


def test_the_command_says_it_on_stdout_and_ends_with_three(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "room.yaml"
    data = yaml.safe_load(new_room("hall", (8.0, 6.0, 3.0), 5))
    file.write_text(yaml.safe_dump(data | {"anchors": LEVEL}))
    assert run("room", "check", str(file)) == 3
    said = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in said] == ["OK"] * 5 + ["warning"]
    assert "8 x 6 x 3 m" in said[0]
    assert run("room", "check", str(tmp_path / "none.yaml")) == 2
    assert "none.yaml: cannot be read" in capsys.readouterr().err


UNITS = {"millimetres": 1000.0, "centimetres": 100.0, "inches": 1.0 / 0.0254, "feet": 1.0 / 0.3048}


def in_unit(unit: str, *fields: str) -> dict[str, Any]:
    """Return fields of the hall as a file in another unit has them."""
    data, factor = yaml.safe_load(new_room("hall", (8.0, 6.0, 3.0), 5)), UNITS[unit]
    scaled: dict[str, Any] = {
        "interior": {end: [factor * value for value in data["interior"][end]] for end in ("min", "max")},
        "landmarks": [item | {"position": [factor * v for v in item["position"]]} for item in data["landmarks"]],
    }
    for name in ("anchors", "stands"):
        scaled[name] = [[factor * value for value in point] for point in data[name]]
    for name in ("start", "goal"):
        scaled[name] = [factor * value for value in data[name]]
    return {name: value for name, value in scaled.items() if name in fields or not fields}


@pytest.mark.family
@pytest.mark.parametrize("unit", UNITS)
def test_a_room_that_is_not_in_metres_is_doubted_and_told_its_unit(tmp_path: Path, unit: str) -> None:
    found = warnings(tmp_path, **in_unit(unit))
    assert len(found) == 1
    assert f"in {unit} it would be 8 x 6 x 3 m" in found[0]
    assert f"interior, anchors, landmarks, stands, start and goal by {1 / UNITS[unit]:g}" in found[0]
    assert [line for line in warnings(tmp_path, **in_unit(unit, "anchors")) if f"in {unit} all would be" in line]


@settings(max_examples=20)
@given(x=st.floats(3.0, 100.0), y=st.floats(3.0, 100.0), z=st.floats(2.0, 20.0))
def test_no_room_that_can_be_made_is_doubted(x: float, y: float, z: float) -> None:
    room = Room.model_validate_json(json.dumps(parse_room(new_room("hall", (x, y, z), 5), "hall")))
    assert doubted_units(room) == []
