"""Recordings for Rerun, read back by Rerun's own reader, beside the flight, its log and geometry of SciPy's."""

import errno
import importlib.util
import os
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import pytest
import xarray as xr
from command_line import run
from rerun_files import Rows, kinds, needs_rerun, read_entities
from scipy.spatial.transform import Rotation

import ortilo_drake as od
from ortilo_drake.flight.flight import fly
from ortilo_drake.flight.saved_flight import save_flight
from ortilo_drake.interop.log.logged_flight import fly_logged
from ortilo_drake.interop.log.reader import LoggedTick, read_ticks
from ortilo_drake.interop.rerun.recording import save_recording
from ortilo_drake.interop.rerun.sightings import Sightings, SightingsRecorder
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import ARRIVED, DETECTION_SIZE, PAYLOAD, STAMP
from ortilo_drake.scenario import Scenario, load_scenario

HOVER = ("planner={kind: hover, point: [2, 0.5, 1.5], duration: 1.5}", "settle=0")
WAYPOINTS = ("planner={kind: waypoints, points: [[0, 0, 1.5], [1, 0, 1.5], [1.5, 0.4, 1.6]]}", "settle=0")
PROJECTED = (
    "camera.kind=projected",
    "camera.errors={kind: parametric, false_boxes: 0}",
)  # no boxes of what is not there

pytestmark = needs_rerun


class Recorded(NamedTuple):
    """A flight, its log's ticks, and its recording read back."""

    scenario: Scenario
    flight: xr.Dataset
    ticks: list[LoggedTick]
    file: Path
    entities: dict[tuple[str, str], Rows]


def record(folder: Path, *settings: str, scenario: str = "nominal_imu_uwb_yolo") -> Recorded:
    scenario = load_scenario(scenario, settings)
    recorder = SightingsRecorder(scenario)
    flight = fly_logged(scenario, folder / "log", also=recorder.record)
    save_recording(flight, recorder.sightings, folder / "flight.rrd")
    ticks = list(read_ticks(folder / "log"))
    return Recorded(scenario, flight, ticks, folder / "flight.rrd", read_entities(folder / "flight.rrd"))


@pytest.fixture(scope="module")
def projected(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    return record(tmp_path_factory.mktemp("projected"), *WAYPOINTS, *PROJECTED)


@pytest.fixture(scope="module")
def rendered(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    return record(tmp_path_factory.mktemp("rendered"), *HOVER)


def nanoseconds(times: np.ndarray) -> list[int]:
    return [round(t * 1e9) for t in times.tolist()]


def scalars(recorded: Recorded, path: str) -> tuple[np.ndarray, np.ndarray]:
    rows = recorded.entities[path, "Scalars:scalars"]
    return rows.times, np.array(rows.values)


def test_a_recording_holds_one_flight_and_one_layout(projected: Recorded) -> None:
    assert kinds(projected.file) == (1, 1)
    (about,) = projected.entities["/scenario", "TextDocument:text"].values
    assert projected.scenario.model_dump_json(indent=2) in about[0]


@pytest.mark.family("estimate")
@pytest.mark.parametrize("name", ["truth", "estimate"])
def test_poses_are_the_flights_at_every_tick(projected: Recorded, name: str) -> None:
    states, entities = projected.flight[name].values, projected.entities
    moved = entities[f"/world/{name}", "Transform3D:translation"]
    assert moved.times.tolist() == nanoseconds(projected.flight["time"].values)
    np.testing.assert_array_equal(np.array(moved.values)[:, 0], states[:, :3].astype(np.float32))
    turned = np.array(entities[f"/world/{name}", "Transform3D:quaternion"].values)[:, 0]
    expected = Rotation.from_euler("xyz", states[:, 3:6])  # fixed axes: roll, then pitch, then yaw
    assert (Rotation.from_quat(turned).inv() * expected).magnitude().max() < 1e-6
    (way,) = entities[f"/world/paths/{name}", "LineStrips3D:strips"].values
    np.testing.assert_array_equal(way[0], states[:, :3].astype(np.float32))


def test_the_room_is_the_surveyed_one(projected: Recorded) -> None:
    room, entities = projected.scenario.load_room(), projected.entities
    (anchors,) = entities["/world/room/anchors", "Points3D:positions"].values
    np.testing.assert_allclose(anchors, room.anchor_positions, rtol=1e-6)
    (labels,) = entities["/world/room/landmarks", "Boxes3D:labels"].values
    assert labels == [landmark.label for landmark in room.landmarks]
    (walls,) = entities["/world/room/walls", "Boxes3D:centers"].values
    assert len(walls) == len(room.walls)
    (dots,) = entities["/world/waypoints", "Points3D:positions"].values
    np.testing.assert_allclose(dots, [[0, 0, 1.5], [1, 0, 1.5], [1.5, 0.4, 1.6]], rtol=1e-6)


def test_signals_are_the_flights(projected: Recorded) -> None:
    flight = projected.flight
    time = nanoseconds(flight["time"].values)
    for i, axis in enumerate("xyz"):
        times, found = scalars(projected, f"/errors/{axis}")
        sd = np.sqrt(flight["covariance"].values[:, i, i])
        error = flight["estimate"].sel(xbar=axis).values - flight["truth"].sel(state=axis).values
        assert times.tolist() == time
        np.testing.assert_array_equal(found, np.column_stack([error, 3 * sd, -3 * sd]))
    for sensor in ("uwb", "camera", "imu"):
        own = flight.sel(sensor=sensor)
        times, found = scalars(projected, f"/arrivals/{sensor}")
        np.testing.assert_array_equal(found, np.column_stack([own["due"], own["arrival"]]).astype(float))
        times, _ = scalars(projected, f"/measurement/{sensor}")
        assert times.tolist() == nanoseconds(flight["time"].values[own["arrival"].values])
    names = [f"{axis}_uwb" for axis in "xyz"]
    there = flight["arrival"].sel(sensor="uwb").values
    for path in ("measurement", "innovation"):
        _, found = scalars(projected, f"/{path}/uwb")
        np.testing.assert_array_equal(found, flight[path].sel(output=names).values[there])
    _, reference = scalars(projected, "/reference/velocity")
    np.testing.assert_array_equal(reference, flight["reference_velocity"].values)


def test_thrusts_of_the_rotors_make_the_command(projected: Recorded) -> None:
    """Each rotor's thrust at its place: their sum and their moments are the command."""
    _, thrusts = scalars(projected, "/control/rotor_thrust")
    u, a = projected.flight["control"].values, projected.scenario.vehicle.arm_length / np.sqrt(2)
    x, y = a * np.array([1, 1, -1, -1]), a * np.array([1, -1, -1, 1])  # front left, front right, rear right, rear left
    made = np.column_stack([thrusts.sum(axis=1), thrusts @ y, -thrusts @ x])
    np.testing.assert_allclose(made, u[:, :3], atol=1e-9)


def test_ranges_are_those_of_the_log(projected: Recorded) -> None:
    sent = [tick.messages["uwb"] for tick in projected.ticks if tick.messages.get("uwb", [0])[ARRIVED] == 1.0]
    n = len(projected.scenario.load_room().anchors)
    for i in range(n):
        there = [message for message in sent if message[PAYLOAD + n + i]]
        times, found = scalars(projected, f"/ranges/anchor_{i}")
        assert times.tolist() == [round(message[STAMP] * 1e9) for message in there]
        assert found[:, 0].tolist() == [message[PAYLOAD + i] for message in there]
        assert len(there) > 3


@pytest.mark.long
def test_differences_of_ranges_are_those_of_the_log_at_their_own_times(tmp_path: Path) -> None:
    hover = "planner={kind: hover, point: [0.5, 0.5, 1.5], duration: 1.0}"  # out of the blackouts
    found = record(tmp_path, hover, "settle=0", scenario="tight_differences")
    n, sent = len(found.scenario.load_room().anchors), 0
    for a in range(n):
        for b in range(n):
            rows = [
                (message[STAMP] - row[4], row[2])
                for message in (tick.messages.get("uwb", np.zeros(1)) for tick in found.ticks)
                for row in (message[PAYLOAD:].reshape(-1, 5) if message[ARRIVED] == 1.0 else ())
                if row[3] == 1.0 and (int(row[0]), int(row[1])) == (a, b)
            ]
            if rows:
                times, values = scalars(found, f"/differences/anchor_{b}_less_anchor_{a}")
                assert times.tolist() == [round(t * 1e9) for t, _ in rows]
                assert values[:, 0].tolist() == [value for _, value in rows]
            sent += len(rows)
    assert sent > 20
    assert not any(path.startswith("/ranges") for path, _ in found.entities)


def boxes_of(recorded: Recorded) -> tuple[np.ndarray, list[np.ndarray], list[list[str]]]:
    """Return times, boxes (k, 4) by their low and high corner, and labels."""
    path, entities = "/world/truth/camera/picture/boxes", recorded.entities
    middle = entities[path, "Boxes2D:centers"]
    found = []
    for c, h in zip(middle.values, entities[path, "Boxes2D:half_sizes"].values, strict=True):
        center, half = np.array(c).reshape(-1, 2), np.array(h).reshape(-1, 2)
        found.append(np.hstack([center - half, center + half]))
    return middle.times, found, entities[path, "Boxes2D:labels"].values


def test_boxes_are_those_of_the_log_also_where_there_are_none(projected: Recorded) -> None:
    sent = [t.messages["detections"] for t in projected.ticks if t.messages.get("detections", [0])[ARRIVED] == 1.0]
    times, boxes, labels = boxes_of(projected)
    classes = projected.scenario.load_room().classes
    assert times.tolist() == [round(message[STAMP] * 1e9) for message in sent]
    assert len(sent) > 10
    for message, found, named in zip(sent, boxes, labels, strict=True):
        rows = message[PAYLOAD:].reshape(-1, DETECTION_SIZE)
        rows = rows[rows[:, 0] >= 0]
        np.testing.assert_allclose(found, rows[:, 2:] + 0.5, atol=1e-3)  # a pixel's corner is Rerun's origin
        assert [name.rpartition(" ")[0] for name in named or []] == [classes[int(row[0])] for row in rows]


def projection(recorded: Recorded, tick: int, p_W: np.ndarray) -> np.ndarray:
    """Return where Rerun shows points p_W (n, 3) in the picture (n, 2) [px], by the transforms in the recording."""
    entities, camera = recorded.entities, "/world/truth/camera"
    p_WB = np.array(entities["/world/truth", "Transform3D:translation"].values[tick][0])
    R_WB = Rotation.from_quat(entities["/world/truth", "Transform3D:quaternion"].values[tick][0])
    p_BC = np.array(entities[camera, "Transform3D:translation"].values[0][0])
    R_BC = np.array(entities[camera, "Transform3D:mat3x3"].values[0][0]).reshape(3, 3).T  # column by column
    K = np.array(entities[camera, "Pinhole:image_from_camera"].values[0][0]).reshape(3, 3).T
    p_C = (R_WB.inv().apply(p_W - p_WB) - p_BC) @ R_BC
    seen = p_C @ K.T
    return np.where(seen[:, 2:] > 0.5, seen[:, :2] / seen[:, 2:], np.nan)


def test_the_camera_hangs_where_its_boxes_are_about_the_landmarks(projected: Recorded) -> None:
    room: Room = projected.scenario.load_room()
    times, boxes, labels = boxes_of(projected)
    width, height = projected.entities["/world/truth/camera", "Pinhole:resolution"].values[0][0]
    ticks = nanoseconds(projected.flight["time"].values)
    checked = 0
    for time, found, named in zip(times.tolist(), boxes, labels, strict=True):
        pixels = projection(projected, ticks.index(time), room.landmark_positions)
        for box, name in zip(found, named or [], strict=True):
            own = pixels[[landmark.label == name.rpartition(" ")[0] for landmark in room.landmarks]]
            if box.min() < 2.0 or box[2] > width - 2.0 or box[3] > height - 2.0:
                continue  # cut at the border: the landmark's centre may be outside
            low, high = box[:2] - 4.0, box[2:] + 4.0  # boxes are in error by a pixel or two
            assert np.any(np.all((own >= low) & (own <= high), axis=1)), (time, name)
            checked += 1
    assert checked > 20


@pytest.mark.long
@pytest.mark.egl
def test_pictures_are_those_of_the_log(rendered: Recorded) -> None:
    taken = [tick.messages for tick in rendered.ticks if "image" in tick.messages]
    pictures = rendered.entities["/world/truth/camera/picture", "EncodedImage:blob"]
    assert len(taken) > 10
    assert pictures.times.tolist() == [round(messages["shutter"][STAMP] * 1e9) for messages in taken]
    for messages, blob in zip(taken, pictures.values, strict=True):
        drawn = cv2.imdecode(np.array(blob[0], np.uint8), cv2.IMREAD_COLOR)
        difference = drawn[..., ::-1].astype(float) - messages["image"][..., :3]
        assert np.abs(difference).mean() < 4.0  # of 255: JPEG
    times, boxes, _ = boxes_of(rendered)
    assert times.tolist() == pictures.times.tolist()
    assert sum(map(len, boxes)) > 10


@pytest.mark.long
@pytest.mark.egl
def test_a_saved_flights_pictures_are_drawn_again(rendered: Recorded, tmp_path: Path) -> None:
    save_flight(rendered.flight, tmp_path / "flight.nc")
    assert run("report", str(tmp_path / "flight.nc"), "--rerun", str(tmp_path / "again.rrd")) == 0
    assert sorted(file.name for file in tmp_path.iterdir()) == ["again.rrd", "flight.nc"]
    again, key = read_entities(tmp_path / "again.rrd"), ("/world/truth/camera/picture", "EncodedImage:blob")
    first = dict(zip(rendered.entities[key].times.tolist(), rendered.entities[key].values, strict=True))
    drawn = dict(zip(again[key].times.tolist(), again[key].values, strict=True))
    due = rendered.flight["time"].values[:: rendered.scenario.every("camera")]
    assert list(drawn) == nanoseconds(due)
    assert set(first) <= set(drawn)
    for time, blob in first.items():
        was, now = (cv2.imdecode(np.array(b[0], np.uint8), cv2.IMREAD_COLOR).astype(float) for b in (blob, drawn[time]))
        assert np.abs(was - now).mean() < 1.0  # of 255: VTK does not draw every pixel of a first picture alike


@pytest.mark.long
def test_the_command_writes_what_python_writes(projected: Recorded, tmp_path: Path) -> None:
    words = [word for setting in (*WAYPOINTS, *PROJECTED) for word in ("--set", setting)]
    assert run("fly", "nominal_imu_uwb_yolo", *words, "--rerun", str(tmp_path / "flight.rrd")) == 0
    found = read_entities(tmp_path / "flight.rrd")
    assert found.keys() == projected.entities.keys()
    for key in projected.entities:
        if not key[0].startswith("/__properties"):
            assert found[key].values == projected.entities[key].values, key
    again = read_entities(od.Flight(projected.flight).to_rerun(tmp_path / "again.rrd"))
    assert {path for path, _ in found} - {path for path, _ in again} == {
        "/world/truth/camera/picture/boxes",
        *(f"/ranges/anchor_{i}" for i in range(len(projected.scenario.load_room().anchors))),
    }


def test_a_flight_that_diverged_is_written_up_to_there(tmp_path: Path) -> None:
    flight = fly(load_scenario("nominal_imu_uwb", HOVER)).copy(deep=True)
    flight["truth"].values[20:] = np.nan
    flight["estimate"].values[25:] = np.nan
    save_recording(flight, Sightings(), tmp_path / "flight.rrd")
    found = read_entities(tmp_path / "flight.rrd")
    assert len(found["/world/truth", "Transform3D:translation"].times) == 20
    assert len(found["/world/estimate", "Transform3D:translation"].times) == 25
    assert len(found["/errors/x", "Scalars:scalars"].times) == 20
    assert not any("camera" in path for path, _ in found)


# --- what is refused ------------------------------------------------------------------------------------------


def test_what_cannot_be_written_is_refused_in_one_line_before_anything_flies(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    flight = ("fly", "nominal_imu_uwb", "--set", HOVER[0], "--rerun")
    (tmp_path / "file").write_text("")
    for words, said in (
        ((*flight, str(tmp_path / "a.mcap")), "unknown kind of recording '.mcap', give .rrd"),
        ((*flight, str(tmp_path / "file" / "a.rrd")), "cannot be written: "),
        ((*flight, str(tmp_path)), "cannot be written: is a folder"),
        ((*flight, str(tmp_path / "a.rrd"), "--meshcat"), "--rerun: cannot be combined with --meshcat"),
        (("report", str(tmp_path / "file"), "--rerun", str(tmp_path / "a.rrd")), "only a flight's .nc has a recording"),
    ):
        assert run(*words) == 2
        captured = capsys.readouterr()
        assert captured.out == ""
        (line,) = captured.err.splitlines()
        assert said in line
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "rerun" else find(name))
    assert run(*flight, str(tmp_path / "a.rrd")) == 2
    missing = "ortilo: rerun: is not installed, needed for this: pip install 'ortilo-drake[rerun]'\n"
    assert capsys.readouterr().err == missing
    assert [file.name for file in tmp_path.iterdir()] == ["file"]


@pytest.mark.family
@pytest.mark.parametrize("there_before", [False, True])
@pytest.mark.parametrize("what", ["full disk", "Ctrl-C"])
def test_nothing_half_written_stays(
    what: str, there_before: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "flight.rrd"
    if there_before:
        file.write_text("before")

    def fail(descriptor: int) -> None:  # the bytes are written to the temporary file, and do not reach the disk
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)) if what == "full disk" else KeyboardInterrupt

    monkeypatch.setattr("ortilo_drake.flight.files.os.fsync", fail)
    code = run("fly", "nominal_imu_uwb", "--set", HOVER[0], "--set", HOVER[1], "--rerun", str(file))
    full = f"ortilo: {file}: cannot be written: No space left on device\n"
    interrupted = "ortilo: interrupted; what is finished is kept\n"
    assert (code, capsys.readouterr().err) == ((2, full) if what == "full disk" else (130, interrupted))
    assert [left.name for left in tmp_path.iterdir()] == (["flight.rrd"] if there_before else [])
    assert not there_before or file.read_text() == "before"
