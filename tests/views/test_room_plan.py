"""The plan of a room: to scale, its labels over nothing, and in characters."""

from pathlib import Path

import numpy as np
import pytest
from command_line import run
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from matplotlib.text import Annotation, Text
from PIL import Image

from ortilo_drake.model.room import ORTILO_ROOM, Room, load_room
from ortilo_drake.onboard.planner.planned import path_of
from ortilo_drake.studies.rooms.new_room import new_room
from ortilo_drake.studies.rooms.room_scenario import room_scenario
from ortilo_drake.views.room_plan import draw_plan
from ortilo_drake.views.room_text import room_text
from ortilo_drake.views.themes import Theme, themed


@pytest.fixture(params=["ortilo", "8x6", "3x20", "40x25"])
def room_file(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    if request.param == "ortilo":
        return ORTILO_ROOM
    x, y = map(float, request.param.split("x"))
    file = tmp_path / "room.yaml"
    file.write_text(new_room("hall", (x, y, 3.0), 9))
    return file


def plan_of(file: Path) -> tuple[Room, Figure]:
    return load_room(file), draw_plan(load_room(file), path_of(room_scenario(file)))


@pytest.mark.family("8x6")
def test_every_anchor_and_landmark_has_a_label_and_no_two_of_them_overlap(room_file: Path) -> None:
    room, figure = plan_of(room_file)
    renderer = FigureCanvasAgg(figure).get_renderer()
    figure.draw(renderer)
    (axes,) = figure.axes
    labels = [child for child in axes.get_children() if isinstance(child, Annotation)]
    said = {label.get_text() for label in labels}
    assert said >= {f"{i} {landmark.label}" for i, landmark in enumerate(room.landmarks)}
    assert len(labels) == len(said) == len(room.anchors) + len(room.landmarks) + 2
    boxes = [label.get_window_extent(renderer) for label in labels]
    whole = axes.get_window_extent(renderer)
    for i, box in enumerate(boxes):
        assert not any(box.overlaps(other) for other in boxes[:i]), labels[i].get_text()
        assert whole.x0 <= box.x0
        assert box.x1 <= whole.x1
        for p in np.vstack([room.anchor_positions, room.landmark_positions]):
            assert not box.contains(*axes.transData.transform(p[:2])), labels[i].get_text()


@pytest.mark.family("3x20")
def test_the_plan_is_to_scale_and_says_its_units(room_file: Path) -> None:
    room, figure = plan_of(room_file)
    (axes,) = figure.axes
    a, b = (axes.transData.transform(p) for p in ((0.0, 0.0), (1.0, 1.0)))
    assert (b - a)[0] == pytest.approx((b - a)[1], rel=1e-6)
    assert "[m]" in axes.get_xlabel()
    assert "[m]" in axes.get_ylabel()
    (bar,) = [text for text in axes.texts if text.get_text().endswith(" m") and not isinstance(text, Annotation)]
    (line,) = [line for line in axes.lines if not line.get_clip_on()]
    ends = axes.transData.inverted().transform(axes.transAxes.transform(np.column_stack(line.get_data())))
    assert np.ptp(ends[:, 0]) == pytest.approx(float(bar.get_text().removesuffix("m")))
    corners = [patch.get_xy()[:4] for patch in axes.patches if isinstance(patch, Polygon)]
    for x, y, _, yaw, half_x, half_y, _ in room.wall_boxes:
        expected = [x + half_x * np.cos(yaw) - half_y * np.sin(yaw), y + half_x * np.sin(yaw) + half_y * np.cos(yaw)]
        assert any(np.any(np.all(np.isclose(found, expected), axis=1)) for found in corners)


def test_characters_stand_where_things_are(tmp_path: Path) -> None:
    """A room of 10 x 5 m in 100 columns and 25 rows; the last line of the plan is the first 20 cm of y."""
    file = tmp_path / "room.yaml"
    file.write_text(
        "interior: {min: [0, 0, 0], max: [10, 5, 3]}\nanchors: [[0.05, 0.1, 1], [9.95, 0.1, 2], [9.95, 4.9, 1]]\n"
        "walls: [[5.0, 2.5, 0.0, 1.0, 1.0, 2.0]]\nstart: [1.05, 2.5]\ngoal: [9.05, 2.5]\n"
    )
    rows = room_text(load_room(file), path_of(room_scenario(file)), 102).splitlines()
    top, *inner, bottom, _ = rows
    assert top == bottom == "+" + "-" * 100 + "+"
    assert len(inner) == 25
    assert inner[-1] == "|A" + " " * 98 + "A|"
    assert inner[0] == "|" + " " * 99 + "A|"
    assert inner[12][11] == "S"
    assert inner[12][91] == "G"
    wall = [(i, j) for i, row in enumerate(inner) for j, mark in enumerate(row) if mark == "#"]
    assert {i for i, _ in wall} == {10, 11, 12, 13, 14}
    assert {j for _, j in wall} == set(range(46, 56))


@pytest.mark.long
def test_the_command_writes_a_picture_or_prints_a_plan(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, png = tmp_path / "room.yaml", tmp_path / "plan.png"
    file.write_text(new_room("hall", (8.0, 6.0, 3.0), 5))
    assert run("room", "show", str(file), "--png", str(png)) == 0
    with Image.open(png) as drawn:
        assert min(drawn.size) > 500
    assert "wrote" in capsys.readouterr().out
    assert run("room", "show", str(file)) == 0
    assert "# wall" in capsys.readouterr().out
    assert run("room", "show", str(file), "--png", str(tmp_path / "plan.frog")) == 2
    assert "plan.frog" in capsys.readouterr().err


@pytest.mark.parametrize("what", ["imu_uwb", "file"])
def test_a_room_on_a_slide_is_read_from_afar_and_its_labels_clear_the_walls(what: str, tmp_path: Path) -> None:
    """16:9, 1920 pixels wide, no letters below 20 pixels; a ready-made scenario's room has the scenario's name."""
    file = tmp_path / "hall.yaml"
    file.write_text(new_room("hall", (8.0, 6.0, 3.0), 5))
    picture = tmp_path / "room.png"
    assert run("--theme", "slides", "room", "show", str(file) if what == "file" else what, "--png", str(picture)) == 0
    with Image.open(picture) as image:
        assert image.size == (1920, 1080)
    with themed(Theme.slides):
        figure = draw_plan(load_room(file), path_of(room_scenario(file)), "another")
    renderer = FigureCanvasAgg(figure).get_renderer()
    figure.draw(renderer)
    said = [text for text in figure.findobj(Text) if text.get_visible() and text.get_text()]
    assert figure.get_size_inches().tolist() == [9.6, 5.4]
    assert min(text.get_fontsize() for text in said) >= 7.2
    assert any(text.get_text().startswith("another") for text in said)
    (axes,) = figure.axes
    for label in (one for one in said if isinstance(one, Annotation)):
        box = axes.transData.inverted().transform_bbox(label.get_window_extent(renderer))
        assert not any(box.x0 < x < box.x1 for x in (0.0, 8.0)), label.get_text()
        assert not any(box.y0 < y < box.y1 for y in (0.0, 6.0)), label.get_text()
    low, high = np.transpose([axes.get_xlim(), axes.get_ylim()])
    assert np.max(np.abs([low - [0.0, 0.0], high - [8.0, 6.0]])) < 0.3, "the axes are away from the room"
    for ticks in (axes.get_xticks(), axes.get_yticks()):
        assert float(f"{np.diff(ticks)[0]:e}"[0]) in (1.0, 2.0, 5.0)
        assert np.diff(ticks) == pytest.approx(float(f"{np.diff(ticks)[0]:.0e}"))
