"""Recorded boxes of landmarks, drawn by OpenCV through a lens that bends: read, given to landmarks, and flown by."""

from itertools import product

import cv2
import numpy as np
import pytest
import yaml
from made_up_motion import ANCHORS
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from ortilo_drake.interop.recorded.map_file import load_map
from ortilo_drake.interop.recorded.recording import read_recording
from ortilo_drake.model.inputs.room_text import ORTILO_ROOM
from ortilo_drake.model.room import load_room
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.studies.recorded.filter_types import FilterSetup
from ortilo_drake.studies.recorded.filtered import estimate
from ortilo_drake.studies.recorded.replayed import AIDED, BOXED, aided_name
from ortilo_drake.studies.recorded.setups import with_aids

HOVERS, TURNED, AT = np.array([1.0, 4.0, 1.2]), np.array([0.06, -0.04, 0.5]), np.array([0.1, 0.02, -0.03])
K = np.array([[400.0, 0.0, 322.0], [0.0, 396.0, 243.0], [0.0, 0.0, 1.0]])
BEND = np.array([-0.12, 0.03, 0.001, -0.0005, 0.0])
THINGS = [("dog", (5.5, 4.5, 0.5)), ("dog", (5.0, 8.0, 1.4)), ("chair", (4.0, 6.6, 0.4)), ("person", (7.0, 7.0, 1.0))]
SIZE = np.array([0.4, 0.5, 0.6])
MAP = f"""
ranges: {{file: ranges.csv, time: t, values: [r0, r1, r2, r3, r4, r5]}}
anchors: {ANCHORS.tolist()}
imu: {{file: imu.csv, time: t, rates: [wx, wy, wz], force: [fx, fy, fz]}}
boxes: {{file: boxes.csv, time: t, label: class, box: [left, top, right, bottom], room: room.yaml, camera: lens.yaml,
  at: {AT.tolist()}}}
start: {{position: {HOVERS.tolist()}, position_sd: 0.2, heading: {TURNED[2] + 0.2}, heading_sd: 0.3}}
filter: {{range_correlated: 0.001}}
"""


def box_of(position) -> np.ndarray:
    """Return u_min, v_min, u_max, v_max of a thing as OpenCV projects its corners [px]."""
    corners = np.array(position) + 0.5 * SIZE * list(product((-1.0, 1.0), repeat=3))
    ahead = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])  # the camera's axes in the body's
    turn = ahead @ Rotation.from_euler("xyz", TURNED).as_matrix().T
    where = HOVERS + Rotation.from_euler("xyz", TURNED).apply(AT)
    points = cv2.projectPoints(corners, cv2.Rodrigues(turn)[0], -turn @ where, K, BEND)[0][:, 0]
    return np.concatenate([points.min(axis=0), points.max(axis=0)])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Write 10 s of a body that hovers: every tenth box is 90 px off, some are of no landmark."""
    folder, rng = tmp_path_factory.mktemp("boxes"), np.random.default_rng(4)
    room = yaml.safe_load(ORTILO_ROOM.read_text(encoding="utf-8"))
    room["landmarks"] = [{"label": c, "position": list(p), "size": SIZE.tolist()} for c, p in THINGS]
    room["landmark_outline"] = {}
    (folder / "room.yaml").write_text(yaml.safe_dump(room))
    lens = {"image_width": 640, "image_height": 480, "distortion_model": "plumb_bob"}
    for name, value in (("camera_matrix", K), ("distortion_coefficients", BEND)):
        lens[name] = {"data": value.ravel().tolist()}
    (folder / "lens.yaml").write_text(yaml.safe_dump(lens))
    (folder / "MAP.yaml").write_text(MAP)
    t, R = np.arange(0.0, 10.0, 0.1), Rotation.from_euler("xyz", TURNED)
    r = np.linalg.norm(HOVERS - ANCHORS, axis=1) + 0.05 * rng.standard_normal((len(t), 6))
    head = ",".join(f"r{i}" for i in range(6))
    np.savetxt(folder / "ranges.csv", np.column_stack([t, r]), "%.6f", ",", header=f"t,{head}", comments="")
    t_imu, noise = np.arange(0.0, 10.0, 0.02), rng.standard_normal((2, 500, 3))
    imu = np.hstack([0.001 * noise[0], R.inv().apply([0.0, 0.0, 9.81]) + 0.03 * noise[1]])
    head = "t,wx,wy,wz,fx,fy,fz"
    np.savetxt(folder / "imu.csv", np.column_stack([t_imu, imu]), "%.6f", ",", header=head, comments="")
    lines = ["t,class,left,top,right,bottom", "0.05,cow,10,10,20,20", "0.05,Dog,10,10,10,20", "0.05,dog,,10,20,20"]
    for k, stamp in enumerate(t + 0.05):
        for c, p in THINGS:
            off = 90.0 * (k % 10 == 3) + rng.standard_normal(4)
            lines.append(f"{stamp:.3f},{c}," + ",".join(f"{u:.2f}" for u in box_of(p) + off))
    (folder / "boxes.csv").write_text("\n".join(lines))
    return folder


def test_boxes_of_a_stamp_are_a_picture_and_what_is_no_box_is_counted(folder) -> None:
    recording = read_recording(folder, load_map(folder / "MAP.yaml"))
    counted = {reason.split(": ")[-1]: n for reason, n in recording.rejected.items()}
    assert counted["boxes of classes that the room has no landmark of"] == 1
    assert any("('cow')" in line for line in recording.told)
    assert counted["boxes without a size"] == counted["boxes with NaN or an empty cell"] == 1
    assert len(recording.looks.boxes) == len(recording.looks.boxes_t) == 100
    classes = load_room(folder / "room.yaml").classes
    seen = [classes[int(row)] for row in recording.looks.boxes[0][2::6][:4]]
    assert seen == [c for c, _ in THINGS]
    np.testing.assert_allclose(recording.looks.boxes[0][4:8], box_of(THINGS[0][1]), atol=4.0)
    np.testing.assert_allclose(recording.scene.camera.p_BC, AT)


@pytest.mark.long
def test_boxes_tell_the_heading_and_the_smoother_carries_it_back(folder) -> None:
    map_ = load_map(folder / "MAP.yaml")
    recording = read_recording(folder, map_)
    known, at = FilterSetup(ANCHORS, np.zeros(6), np.zeros(3), None), np.array([0.1, 9.9])

    def turned(looks: bool, smoothed: bool) -> np.ndarray:
        told = with_aids(known, recording, map_, looks)
        found = estimate(recording.ranges, recording.imu, told, map_.filter, at, smoothed)
        if looks:
            e = found.p - HOVERS
            squares = np.einsum("ki,ki->k", e, np.linalg.solve(found.P, e[:, :, None])[:, :, 0])
            assert squares.max() < chi2.ppf(0.999, 3)
            assert np.sqrt(np.trace(found.P[-1])) < 0.03
        off = Rotation.from_matrix(found.R) * Rotation.from_euler("xyz", TURNED).inv()
        return off.magnitude()

    assert turned(True, False)[-1] < 0.01
    assert turned(False, False)[-1] > 0.15  # ranges to one tag tell nothing of it
    assert turned(True, True)[0] < 0.01


def test_rows_are_called_by_what_is_seen(folder) -> None:
    map_ = load_map(folder / "MAP.yaml")
    assert aided_name(map_) == BOXED
    assert aided_name(map_.model_copy(update={"boxes": None})) is None
    finder = load_map_with(folder, "range_finder: {file: a.csv, time: t, distance: d}\n")
    assert aided_name(finder) == f"{AIDED}, and boxes"


def load_map_with(folder, more: str, old: str = "", new: str = ""):
    (folder / "OTHER.yaml").write_text(MAP.replace(old, new) + more)
    return load_map(folder / "OTHER.yaml")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("room: room.yaml", "room: none.yaml", "none.yaml: no such room file"),
        ("camera: lens.yaml", "camera: none.yaml", "none.yaml': no such file"),
        ("label: class", "label: top", "no box is of a class that the room has"),
        ("[left, top, right, bottom]", "[left, top, right]", "boxes.box"),
        ("imu:", "# imu:", "boxes: needs `imu`"),
    ],
)
def test_what_is_wrong_of_boxes_is_one_line(folder, old, new, said) -> None:
    with pytest.raises(InputError, match=said):
        read_recording(folder, load_map_with(folder, "", old, new))
