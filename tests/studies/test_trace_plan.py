"""Rooms traced over floor plans that are drawn here, wall by wall, in whole pixels."""

import struct
import zlib
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from command_line import run
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from ortilo_drake.model.input_error import InputError
from ortilo_drake.model.room import load_room
from ortilo_drake.onboard.planner.planned import path_of
from ortilo_drake.studies.rooms.room_scenario import room_scenario
from ortilo_drake.studies.rooms.trace_plan import FloorPlan, Traced, read_plan, thinnest, trace_plan

SCALE = 40.0  # px / m
MARGIN = 25  # of paper around the plan [px]
THICK = 8  # of the outer walls [px]: 20 cm


def drawn(size: tuple[int, int], walls: list[tuple[int, int, int, int]]) -> np.ndarray:
    """Return a plan: size within the outer walls, and inner walls as left, bottom, width, height [px], y up."""
    w, h = size
    picture = np.full((h + 2 * (MARGIN + THICK), w + 2 * (MARGIN + THICK)), 255, np.uint8)
    picture[MARGIN:-MARGIN, MARGIN:-MARGIN] = 0
    inner = picture[MARGIN + THICK : -MARGIN - THICK, MARGIN + THICK : -MARGIN - THICK]
    inner[:] = 255
    for left, bottom, width, height in walls:
        inner[h - bottom - height : h - bottom, left : left + width] = 0
    return picture


def traced(picture: np.ndarray, scale: float = SCALE) -> Traced:
    wall = picture < 128
    return trace_plan(FloorPlan(wall, ~wall, scale, np.zeros(2), "darker than 128", "--scale"))


def expected(walls: list[tuple[int, int, int, int]]) -> list[list[float]]:
    return sorted([(x + w / 2) / SCALE, (y + h / 2) / SCALE, w / SCALE, h / SCALE] for x, y, w, h in walls)


DOOR = [(160, 0, 6, 140), (160, 190, 6, 50), (260, 100, 60, 6)]  # a wall with a door at x = 4 m, and one alone


def test_walls_are_where_they_are_drawn_to_the_pixel() -> None:
    found = traced(drawn((320, 240), DOOR))
    assert found.size.tolist() == [8.0, 6.0]
    np.testing.assert_allclose(sorted(found.walls.tolist()), expected(DOOR), atol=1e-9)
    assert found.covered == 1.0
    assert found.start[0] < 4.0 < found.goal[0]


def test_letters_thin_lines_and_grey_carpets_are_no_walls() -> None:
    plan = drawn((320, 240), DOOR)
    plan[150:190, 60:120] = 200
    cv2.putText(plan, "kitchen", (70, 170), cv2.FONT_HERSHEY_SIMPLEX, 0.4, 0, 1)
    cv2.line(plan, (40, 60), (180, 120), 0, 1)
    plan[100:105, 300:305] = 0  # a fitting of 12 cm
    found = traced(plan)
    np.testing.assert_allclose(sorted(found.walls.tolist()), expected(DOOR), atol=1e-9)


@pytest.mark.long
@settings(max_examples=20)
@given(
    x=st.integers(60, 250), door=st.integers(10, 150), thick=st.integers(4, 14), noise=st.integers(0, 60),
    seed=st.integers(0, 9),
)  # fmt: skip
def test_a_wall_with_a_door_is_found_wherever_it_is(x: int, door: int, thick: int, noise: int, seed: int) -> None:
    walls = [(x, 0, thick, door + 15), (x, door + 55, thick, 240 - door - 55)]
    plan = drawn((320, 240), walls).astype(int)
    plan += np.random.default_rng(seed).integers(-noise, noise + 1, plan.shape)
    found = traced(np.clip(plan, 0, 255).astype(np.uint8))
    np.testing.assert_allclose(sorted(found.walls.tolist()), expected(walls), atol=1e-9)


def test_a_house_that_is_no_rectangle_has_walls_around_its_corner() -> None:
    """An L: the upper right quarter of 8 x 6 m is outside, behind walls of 20 cm."""
    plan = drawn((320, 240), [(160, 120, 160, 8), (160, 120, 8, 120)])
    plan[: MARGIN + THICK + 112, MARGIN + THICK + 168 :] = 255
    found = traced(plan)
    assert found.size.tolist() == [8.0, 6.0]
    assert found.covered > 0.999
    middles = [wall for wall in found.walls.tolist() if 3.9 < wall[0] < 6.1 and wall[1] > 2.9]
    assert len(middles) == 2
    assert found.goal[1] < 3.0


def test_the_command_writes_a_room_that_loads_and_has_a_way(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plan, file = tmp_path / "plan.png", tmp_path / "flat.yaml"
    cv2.imwrite(str(plan), cv2.cvtColor(drawn((320, 240), DOOR), cv2.COLOR_GRAY2BGRA))
    assert run("room", "trace", str(plan), "--scale", "40", "--out", str(file), "--height", "2.4") == 0
    assert "3 walls, 8.00 x 6.00 m" in capsys.readouterr().out
    room = load_room(file)
    assert room.interior.max == (8.0, 6.0, 2.4)
    rows = room.wall_boxes
    found = np.column_stack([rows[:, 0], rows[:, 1], 2 * rows[:, 4], 2 * rows[:, 5]])
    np.testing.assert_allclose(sorted(found.tolist()), expected(DOOR), atol=1e-3)
    assert np.all(rows[:, 6] == 1.2)
    assert path_of(room_scenario(file)).end_time() > 5.0
    for landmark in room.landmark_positions:
        assert np.all(np.max(np.abs(landmark[:2] - found[:, :2]) - found[:, 2:] / 2, axis=1) > 0.1)
    assert run("room", "trace", str(plan), "--scale", "40", "--out", str(file)) == 2
    assert "exists; --force overwrites it" in capsys.readouterr().err


@pytest.mark.parametrize("words", ["--scale 400", "--scale 2", "--scale 0", "--dark 1 --scale 40"])
def test_a_plan_that_makes_no_room_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str], words: str) -> None:
    plan, file = tmp_path / "plan.png", tmp_path / "flat.yaml"
    cv2.imwrite(str(plan), np.maximum(drawn((320, 240), DOOR), 5))
    assert run("room", "trace", str(plan), "--out", str(file), *words.split()) == 2
    line = capsys.readouterr().err
    assert len(line.splitlines()) == 1
    assert "scale" in line
    assert not file.exists()


def test_what_is_no_picture_is_refused(tmp_path: Path) -> None:
    plan = tmp_path / "plan.png"
    whole = cv2.imencode(".png", drawn((320, 240), DOOR))[1].tobytes()
    head = b"IHDR" + (2**20).to_bytes(4, "big") * 2 + whole[24:29]
    huge = whole[:12] + head + zlib.crc32(head).to_bytes(4, "big") + whole[33:]
    for content, reason in (
        (b"GIF89a", "is no picture of the kinds PNG"),
        (whole[:40], "is no picture of the kinds PNG"),
        (huge, "px: must have at most"),
    ):
        plan.write_bytes(content)
        with pytest.raises(InputError, match=reason):
            read_plan(plan, SCALE, 128)
    with pytest.raises(InputError, match="cannot be read"):
        read_plan(tmp_path, SCALE, 128)


def test_opacity_is_over_white_paper(tmp_path: Path) -> None:
    file = tmp_path / "plan.png"
    picture = np.zeros((4, 4, 4), np.uint8)
    picture[1, 1] = (0, 0, 0, 255)
    cv2.imwrite(str(file), picture)
    wall = read_plan(file, SCALE, 128).wall
    assert wall[1, 1]
    assert wall.sum() == 1


CELL = 0.05  # of a robot's map [m]


def grid(folder: Path, name: str = "map", ending: str = ".pgm", gap: int = 0, **fields: object) -> Path:
    """Write a map_server grid of 6 x 4 m, walls one cell thick but for one of two; return its .yaml."""
    picture = np.full((120, 160), 205, np.uint8)
    picture[20:102, 20:142] = 0
    picture[21:101, 21:141] = 254
    picture[40:42, 41:101] = 0  # two cells
    picture[80:101, 100] = 0  # one
    if gap:
        picture[50 : 50 + gap, 20] = 254
    if fields.get("negate"):
        picture = 255 - picture
    flags = [cv2.IMWRITE_PXM_BINARY, 0] if name == "ascii" else []
    assert cv2.imwrite(str(folder / f"{name}{ending}"), picture, flags)
    data = {"image": f"{name}{ending}", "resolution": CELL, "origin": [-3.0, 1.5, 0.0], "occupied_thresh": 0.65}
    (folder / f"{name}.yaml").write_text(yaml.safe_dump(data | {"free_thresh": 0.196} | fields))
    return folder / f"{name}.yaml"


@pytest.mark.family
@pytest.mark.parametrize("fields", [{"name": "ascii"}, {"negate": 1}, {"ending": ".png", "mode": "scale"}, {"gap": 8}])
def test_a_robots_map_of_walls_one_cell_thick_is_traced_in_its_own_frame(
    tmp_path: Path, fields: dict[str, Any]
) -> None:
    """The first row of the picture is the highest y, and the origin is the lower left corner of its last."""
    file = tmp_path / "room.yaml"
    assert run("room", "trace", str(grid(tmp_path, **fields)), "--out", str(file)) == 0
    room = load_room(file)
    x_0, y_0 = -3.0 + 21 * CELL, 1.5 + (120 - 101) * CELL
    np.testing.assert_allclose(room.interior.min, [x_0, y_0, 0.0], atol=1e-9)
    np.testing.assert_allclose(room.interior.max, [x_0 + 120 * CELL, y_0 + 80 * CELL, 2.5], atol=1e-9)
    walls = sorted([round(w[0] - x_0, 6), round(w[1] - y_0, 6), w[3], w[4]] for w in room.walls)
    np.testing.assert_allclose(walls, [[2.5, 3.0, 3.0, 0.1], [3.975, 0.525, 0.05, 1.05]], atol=1e-9)
    np.testing.assert_allclose(room.anchor_positions[:, :2].min(axis=0), [x_0 + 0.2, y_0 + 0.2], atol=1e-9)
    assert path_of(room_scenario(file)).end_time() > 5.0


def test_a_map_whose_picture_was_renamed_with_it_is_read(tmp_path: Path) -> None:
    grid(tmp_path).write_text("{image: other.pgm, resolution: 0.05}")
    assert read_plan(tmp_path / "map.yaml", None, 128).scale == 20.0


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("{image: no.pgm, resolution: 0.05}", "image: no.pgm: no such picture"),
        ("{image: map.pgm}", "resolution: is missing"),
        ("{image: map.pgm, resolution: 0.05, origin: [0, 0, 0.3]}", "origin: .*its yaw must be 0"),
        ("{image: map.pgm, resolution: 0.05, negate: 2}", "negate"),
    ],
)
def test_a_wrong_grid_is_told_in_a_line(tmp_path: Path, text: str, line: str) -> None:
    grid(tmp_path)
    file = tmp_path / "grid.yaml"
    file.write_text(text)
    with pytest.raises(InputError, match=line):
        read_plan(file, None, 128)
    with pytest.raises(InputError, match="--scale"):
        read_plan(tmp_path / "map.yaml", 20.0, 128)
    with pytest.raises(InputError, match="--scale"):
        read_plan(tmp_path / "map.pgm", None, 128)


@pytest.mark.long
@given(st.floats(5.0, 200.0))
def test_the_thinnest_wall_is_as_thick_as_the_message_says(scale: float) -> None:
    """A wall of so many pixels is found where it is drawn, one of a pixel less is not, and the refusal says both."""
    thin = thinnest(scale)
    assert thin / scale >= 0.75 * 0.04
    long = int(scale) + 2
    plan = np.full((40, long + 20), 255, np.uint8)
    plan[10 : 10 + thin, 10 : 10 + long] = 0
    found = traced(plan, scale)
    assert found.covered == 1.0
    np.testing.assert_allclose(found.size, np.array([long, thin]) / scale)
    if thin > 1:
        plan[10] = 255
        with pytest.raises(InputError, match=rf"0 walls found.*at least {thin} px .* thick"):
            traced(plan, scale)


def png(width: int, height: int, pixels: bytes) -> bytes:
    """Return a grey PNG of 8 bit that says this size, whatever its pixels are."""
    parts = ((b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)), (b"IDAT", zlib.compress(pixels)))
    chunks = [
        struct.pack(">I", len(x)) + t + x + struct.pack(">I", zlib.crc32(t + x)) for t, x in (*parts, (b"IEND", b""))
    ]
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunks)


GOOD = png(
    200, 160, (b"\0" + bytes(200)) * 5 + (b"\0" + bytes(5) + b"\xff" * 190 + bytes(5)) * 150 + (b"\0" + bytes(200)) * 5
)
DAMAGED = bytearray(GOOD)
DAMAGED[len(GOOD) // 2] ^= 1


@pytest.mark.parametrize(
    ("data", "line"),
    [
        (png(160, 160, (b"\0" + bytes(160)) * 160), "all of it is wall: must have free space"),
        (png(1, 1, b"\0\0"), "at --scale 40: its length, 0.025 m, must be 3 to 100 m"),
        (png(30000, 30000, b""), "30000 x 30000 px: must have at most"),
        (png(200, 160, b""), "is no whole picture"),
        (GOOD[: len(GOOD) // 2], "is no whole picture"),
        (GOOD[:-12], "is no whole picture"),
        (bytes(DAMAGED), "is no whole picture"),
    ],
    ids=["all black", "one pixel", "huge", "no pixels", "half of it", "without its end", "a bit flipped"],
)
def test_what_is_no_floor_plan_is_refused_in_one_line(
    data: bytes, line: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "plan.png").write_bytes(data)
    words = ("room", "trace", str(tmp_path / "plan.png"), "--scale", "40", "--out", str(tmp_path / "room.yaml"))
    assert run(*words) == 2
    (said,) = capfd.readouterr().err.splitlines()
    assert line in said
    assert [file.name for file in tmp_path.iterdir()] == ["plan.png"]


@pytest.mark.parametrize("mode", ["L", "I;16", "P", "1", "LA", "RGBA"])
def test_a_plan_of_any_depth_is_the_same(mode: str, tmp_path: Path) -> None:
    grey = drawn((320, 240), DOOR)
    if mode == "I;16":
        picture = Image.fromarray(grey.astype(np.uint16) * 257)
    elif mode == "RGBA":  # nothing but opacity
        picture = Image.fromarray(np.dstack([np.zeros((*grey.shape, 3), np.uint8), 255 - grey]))
    else:
        picture = Image.fromarray(grey).convert(mode)
    picture.save(tmp_path / "plan.png")
    assert np.array_equal(read_plan(tmp_path / "plan.png", SCALE, 128).wall, grey < 128)


def test_where_no_way_leads_to_the_right_the_goal_is_where_one_leads() -> None:
    found = traced(drawn((320, 240), [(160, 0, 6, 240)]))
    assert found.start[0] < found.goal[0] + 4.0 < 8.0
    assert np.linalg.norm(found.goal - found.start) > 1.0
    assert np.all((found.goal > 0.5) & (found.goal < [3.5, 5.5]))
