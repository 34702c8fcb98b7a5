"""Videos: that other programs read them, and that they show what happened in the flight."""

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest
import xarray as xr
from command_line import run
from matplotlib.figure import Figure
from PIL import Image

from ortilo_drake.diagrams.wiring.world import sensor_system
from ortilo_drake.flight.blackouts import in_blackout
from ortilo_drake.flight.flight import fly, scenario_of
from ortilo_drake.model.room import load_room
from ortilo_drake.model.signals import DETECTION_SIZE, PAYLOAD
from ortilo_drake.scenario import Scenario, load_scenario
from ortilo_drake.views import video
from ortilo_drake.views.scene_view import class_bgr, draw_boxes, make_camera_view, make_room_view, viewer_pose
from ortilo_drake.views.video import STRIP_HEIGHT, error_strip, flight_video, frame_ticks, make_views

HOVER = "planner={kind: hover, point: [2, 0.5, 1.5], duration: 0.7}"
PARAMETRIC = "camera.errors={kind: parametric}"
ROOM = load_room()

pytestmark = [pytest.mark.egl, pytest.mark.video]


def scenario(*settings: str) -> Scenario:
    return load_scenario("nominal_imu_uwb_yolo", (HOVER, "camera.kind=projected", PARAMETRIC, "settle=0.0", *settings))


@pytest.fixture(scope="module")
def flight() -> xr.Dataset:
    return fly(scenario())


@pytest.fixture(scope="module")
def views(flight: xr.Dataset) -> Callable[[int], np.ndarray]:
    return make_views(flight, 320)


def sharp(picture: np.ndarray) -> bool:
    return bool(picture.std() > 20)


# --- boxes ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("scale", [1.0, 2.0])
def test_a_box_is_drawn_where_its_numbers_say_in_its_classs_colour(scale: float) -> None:
    picture = np.zeros((round(240 * scale), round(320 * scale), 3), dtype=np.uint8)
    box = np.array([60.0, 80.0, 110.5, 170.0])
    draw_boxes(picture, np.array([[1.0, 0.875, *box]]), ROOM, scale)
    assert ROOM.classes[1] == "fire hydrant"
    edge = np.all(picture == class_bgr(ROOM, "fire hydrant"), axis=2)
    below = edge[round((80 + 0.5) * scale - 0.5) :]  # the label is above
    v, u = np.nonzero(below)
    shown = np.array([u.min(), v.min() + round((80 + 0.5) * scale - 0.5), u.max(), v.max() + len(edge) - len(below)])
    np.testing.assert_allclose(shown, (box + 0.5) * scale - 0.5, atol=0.5 + 1e-9)
    middle = (shown[0] + shown[2]) // 2, (shown[1] + shown[3]) // 2
    assert not edge[middle[1] - 5 : middle[1] + 5, middle[0] - 5 : middle[0] + 5].any()  # an outline, thin
    assert edge[shown[3], shown[0] : shown[2] + 1].all()
    label = picture[shown[1] - 14 : shown[1] - 1, shown[0] : shown[0] + 60]
    assert np.any(np.all(label == class_bgr(ROOM, "fire hydrant"), axis=2))
    assert np.any(np.all(label > 180, axis=2))  # white letters


def test_labels_of_boxes_at_the_border_stay_in_the_picture() -> None:
    picture = np.zeros((240, 320, 3), dtype=np.uint8)
    draw_boxes(picture, np.array([[0.0, 0.5, 300.0, -0.5, 319.5, 239.5]]), ROOM, 1.0)
    assert np.count_nonzero(np.all(picture > 180, axis=2)) > 20


# --- what is drawn again --------------------------------------------------------------------------------------


def test_boxes_are_those_of_the_flight(flight: xr.Dataset) -> None:
    chosen = scenario()
    view = make_camera_view(chosen)
    camera = sensor_system(chosen, ROOM, "camera")
    context = camera.CreateDefaultContext()
    camera.set_seed_in(context, chosen.seed)
    for tick in (0, 9):
        time, x = float(flight["time"][tick]), flight["truth"].values[tick]
        context.SetTime(time)
        camera.GetInputPort("state").FixValue(context, x)
        rows = camera.get_output_port().Eval(context)[PAYLOAD:].reshape(-1, DETECTION_SIZE)
        picture, boxes = view(time, x)
        assert picture.shape == (240, 320, 3)
        np.testing.assert_array_equal(boxes, rows[rows[:, 0] >= 0])
        assert len(boxes) > 0
        again, _ = make_camera_view(chosen)(time, x)
        np.testing.assert_array_equal(again, picture)


def test_boxes_of_a_rendered_flight_are_its_detectors(monkeypatch: pytest.MonkeyPatch, flight: xr.Dataset) -> None:
    seen = []

    def detect(image: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        seen.append(image.copy())
        return np.array([2, 0]), np.array([0.4, 0.9]), np.array([[1.0, 2, 30, 40], [5, 6, 70, 80]])

    monkeypatch.setattr("ortilo_drake.views.scene_view.load_detector", lambda *arguments: detect)
    picture, boxes = make_camera_view(scenario("camera.kind=rendered"))(0.0, flight["truth"].values[0])
    np.testing.assert_array_equal(boxes, [[0, 0.9, 5, 6, 70, 80], [2, 0.4, 1, 2, 30, 40]])
    np.testing.assert_array_equal(seen[0][..., ::-1], picture)


def test_the_vehicle_is_seen_in_the_middle_and_its_path_behind_it() -> None:
    x = np.zeros(12)
    x[:3] = [8.0, 1.0, 1.5]
    view = make_room_view(ROOM, np.array([[8.0, 1.0, 1.5], [9.0, 1.0, 1.5]]), 320, 240)
    p_V = viewer_pose(x[:3]).inverse() @ x[:3]
    focal = 120 / np.tan(np.deg2rad(27.5))
    u, v = p_V[:2] / p_V[2] * focal + [159.5, 119.5]
    assert abs(u - 159.5) < 30
    assert abs(v - 119.5) < 30
    here, flown = view(x, x[np.newaxis, :3]), view(x, np.array([[7.0, 1.0, 1.5], [8.0, 1.0, 1.5]]))
    rows, columns = np.nonzero(np.any(here != flown, axis=2))
    assert rows.min() >= v - 2  # nearer to the viewer is lower
    assert 10 < len(rows) < 500
    assert np.abs(columns[rows <= v + 3] - u).max() < 12
    x[5] = 0.8  # the propellers turn about the middle, nothing else changes
    rows, columns = np.nonzero(np.any(view(x, x[np.newaxis, :3]) != here, axis=2))
    reach = 0.6 * focal / p_V[2]
    assert np.hypot(columns - u, rows - v).max() < reach
    assert np.hypot(columns - u, rows - v).max() > reach / 2
    assert len(rows) > 200


def test_a_scenario_without_camera_has_a_black_panel() -> None:
    views = make_views(fly(scenario("sensors=[uwb, imu]")), 320)
    left = views(3)[:, :320]
    assert np.mean(left == 0) > 0.9
    assert left.max() == 255  # says why


def test_the_camera_shows_the_last_picture_taken(views: Callable[[int], np.ndarray]) -> None:
    np.testing.assert_array_equal(views(5)[:, :320], views(3)[:, :320])
    assert np.any(views(6)[:, :320] != views(3)[:, :320])


def dark(flight: xr.Dataset, sensor: str) -> np.ndarray:
    return in_blackout(flight["truth"].values, scenario_of(flight), sensor)


def test_blackouts_are_where_and_when_the_scenario_has_them() -> None:
    flown = fly(scenario("uwb.link.blackouts=[{kind: time, start: 0.2, end: 0.4}, {kind: position, start: 8, end: 9}]"))
    time = flown["time"].values
    np.testing.assert_array_equal(dark(flown, "uwb"), (time >= 0.2) & (time < 0.4))
    assert not dark(flown, "camera").any()
    assert dark(fly(scenario()), "uwb").all()  # it hovers in one


def test_a_shade_begins_and_ends_with_the_messages() -> None:
    shaded = "uwb.link.blackouts=[{kind: time, start: 0.066666667, end: 0.266666667}]"  # ticks 2 and 8, up to rounding
    flown = fly(scenario("uwb.link.rate=30", shaded))
    arrived = flown["arrival"].sel(sensor="uwb").values
    np.testing.assert_array_equal(dark(flown, "uwb"), ~arrived)
    np.testing.assert_array_equal(np.flatnonzero(~arrived), np.arange(2, 8))


def test_the_strip_counts_its_columns_in_time(flight: xr.Dataset) -> None:
    picture, columns, (top, bottom) = error_strip(flight, 640, STRIP_HEIGHT)
    assert picture.shape == (STRIP_HEIGHT, 640, 3)
    assert 0 <= top < bottom < STRIP_HEIGHT
    assert 0 < columns[0] < columns[-1] < 640
    time = flight["time"].values
    expected = np.interp(time, time[[0, -1]], columns[[0, -1]])
    np.testing.assert_allclose(columns, expected, atol=0.51)
    frame = picture[top:bottom, columns[0]]
    assert np.mean(np.all(frame < 60, axis=1)) > 0.5  # the axis stands at the first tick


def test_labels_of_the_strip_stay_beside_their_own_axes(flight: xr.Dataset, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: list[Figure] = []
    monkeypatch.setattr(video, "Figure", lambda **size: drawn.append(Figure(**size)) or drawn[0])
    error_strip(flight, 640, STRIP_HEIGHT)
    upright = [axes.yaxis.label.get_window_extent().intervaly for axes in drawn[0].axes[:3]]
    assert all(above[0] > below[1] for above, below in pairwise(upright))
    assert drawn[0].axes[-1].xaxis.label.get_window_extent().y0 >= 0


# --- files ----------------------------------------------------------------------------------------------------


def test_mp4(flight: xr.Dataset, tmp_path: Path) -> None:
    done = []
    path = flight_video(flight, tmp_path / "new" / "flight.mp4", lambda k, n: done.append((k, n)))
    count = len(range(0, flight.sizes["tick"], 3))
    assert done == [(k + 1, count) for k in range(count)]
    reader = cv2.VideoCapture(str(path))
    assert reader.get(cv2.CAP_PROP_FPS) == pytest.approx(30.0)  # 10 Hz, three times as fast
    frames = []
    while (read := reader.read())[0]:
        frames.append(read[1])
    reader.release()
    assert len(frames) == count
    assert frames[0].shape == (480 + STRIP_HEIGHT, 1280, 3)
    assert sharp(frames[0][:480, :640])
    assert sharp(frames[0][:480, 640:])
    # The cursor moves on: what it covers is dark now and was not before.
    _, columns, (top, bottom) = error_strip(flight, 1280, STRIP_HEIGHT)
    for k in (2, 5):
        rows = slice(480 + top + 2, 480 + bottom - 2)
        assert np.median(frames[k][rows, columns[3 * k]]) < 110
        assert np.median(frames[0][rows, columns[3 * k]]) > 180
    assert [p.name for p in path.parent.iterdir()] == ["flight.mp4"]


def test_gif(flight: xr.Dataset, tmp_path: Path) -> None:
    path = flight_video(flight, tmp_path / "flight.GIF")
    with Image.open(path) as gif:
        assert gif.n_frames == len(range(0, flight.sizes["tick"], 12))
        assert gif.size == (640, 240 + STRIP_HEIGHT)
        assert gif.info["duration"] == 130  # 2.5 Hz, three times as fast
        gif.seek(1)
        frame = np.asarray(gif.convert("RGB"))
    assert sharp(frame[:240, :320])
    assert sharp(frame[:240, 320:])
    assert path.stat().st_size < 40_000 * gif.n_frames


def test_frames_come_at_about_the_rate_asked_for(flight: xr.Dataset) -> None:
    np.testing.assert_array_equal(frame_ticks(flight, 10.0), np.arange(0, flight.sizes["tick"], 3))
    np.testing.assert_array_equal(frame_ticks(flight, 1000.0), np.arange(flight.sizes["tick"]))
    lost = flight.copy(deep=True)
    lost["truth"].values[-2:] = np.nan
    assert frame_ticks(lost, 30.0)[-1] == flight.sizes["tick"] - 3


@pytest.mark.parametrize("suffix", ["mp4", "gif"])
def test_ctrl_c_leaves_nothing(
    monkeypatch: pytest.MonkeyPatch,
    flight: xr.Dataset,
    views: Callable[[int], np.ndarray],
    tmp_path: Path,
    suffix: str,
) -> None:
    monkeypatch.setattr(video, "make_frames", lambda *arguments: views)

    def interrupt(done: int, total: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        flight_video(flight, tmp_path / f"flight.{suffix}", interrupt)
    assert list(tmp_path.iterdir()) == []


def test_another_suffix_is_refused_before_flying(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    def flies(*arguments: object) -> None:
        pytest.fail("it flies")

    monkeypatch.setattr("ortilo_drake.flight.flight.fly", flies)
    file = tmp_path / "flight.avi"
    assert run("fly", "--set", HOVER, "--set", PARAMETRIC, "--video", str(file)) == 2
    assert capsys.readouterr().err == f"ortilo: {file}: unknown kind of video '.avi', give one of .gif, .mp4\n"
    assert list(tmp_path.iterdir()) == []


def test_fly_writes_the_video(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setattr(video, "PANEL", {".gif": 160})
    file = tmp_path / "flight.gif"
    projected = ("--set", "camera.kind=projected", "--set", PARAMETRIC)
    words = ("--set", HOVER, *projected, "--set", "settle=0.0", "--video", str(file))
    assert run("fly", *words) == 0
    captured = capsys.readouterr()
    assert f"  wrote {file}\n" in captured.out
    assert captured.err == ""
    with Image.open(file) as gif:
        assert gif.size == (320, 120 + STRIP_HEIGHT)
