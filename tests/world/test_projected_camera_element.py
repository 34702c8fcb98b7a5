"""The projected camera as an element: its boxes are OpenCV's, of the landmarks that are there."""

from itertools import pairwise
from typing import Any

import cv2
import numpy as np
import pytest
from plain_box import PlainBox
from scipy.spatial.transform import Rotation

from ortilo_drake.model.pinhole import R_BC
from ortilo_drake.model.room import load_room
from ortilo_drake.model.signals import ARRIVED, DETECTION_SIZE, PAYLOAD, STAMP
from ortilo_drake.scenario import Camera as Settings
from ortilo_drake.scenario import load_scenario
from ortilo_drake.scenario.camera import ParametricErrors
from ortilo_drake.world.sensors.projected_camera import camera_box

H = 1.0 / 30.0
ROOM = load_room()
P_BC, F, C, IMAGE, _ = ROOM.camera.scaled_to(320).constants
NO_ERRORS = ParametricErrors(kind="parametric", edge_sd=0.0, miss_base=0.0, miss_per_metre=0.0, false_boxes=0.0)
X = np.array([0.0, 0.0, 1.5, 0.01, -0.02, 0.03, *np.zeros(6)])
SENT, NOT_SENT = np.zeros(1), np.array([-1.0])
Fault = dict[str, Any]


def camera(*faults: Fault, start: float = 0.0) -> PlainBox:
    laid = [{"start": start} | fault for fault in faults]
    scenario = load_scenario("nominal_imu_uwb_yolo", ("camera.kind=projected", ("faults", laid)))
    return PlainBox(camera_box(Settings(errors=NO_ERRORS), ROOM, scenario.faults, H))


def boxes(message: np.ndarray) -> np.ndarray:
    rows = message[PAYLOAD:].reshape(-1, DETECTION_SIZE)
    return rows[rows[:, 0] >= 0.0]


def projected(i: int, rpy: np.ndarray, p_BC: np.ndarray = P_BC, by: tuple[float, ...] = (0.0, 0.0, 0.0)) -> np.ndarray:
    """The box of landmark i by OpenCV, of a camera that looks along the x axis of axes turned by rpy; cut."""
    R_WA = Rotation.from_euler("ZYX", rpy[::-1]).as_matrix()
    R_WB = Rotation.from_euler("ZYX", X[[5, 4, 3]]).as_matrix()
    R_CW, K = (R_WA @ R_BC).T, np.array([[F, 0.0, C[0]], [0.0, F, C[1]], [0.0, 0.0, 1.0]])
    points = ROOM.landmark_positions[i] + ROOM.landmark_outlines[i] + by
    uv = cv2.projectPoints(points, cv2.Rodrigues(R_CW)[0], -R_CW @ (X[:3] + R_WB @ p_BC), K, None)[0][:, 0]
    return np.concatenate((uv.min(axis=0), uv.max(axis=0))).clip(-0.5, np.tile(IMAGE, 2) - 0.5)


def shown(plain: np.ndarray) -> list[int]:
    """Landmark of each box, by OpenCV."""
    every = [projected(i, X[3:6]) for i in range(len(ROOM.landmarks))]
    return [int(np.argmin([np.abs(box[2:] - other).max() for other in every])) for box in plain]


@pytest.fixture(scope="module")
def plain() -> np.ndarray:
    """Rows of boxes without a fault."""
    return boxes(camera().say(sent=SENT, state=X))


def test_boxes_are_opencvs_in_a_tick_in_which_the_message_is_sent(plain: np.ndarray) -> None:
    seen = shown(plain)
    its = camera()
    message = its.say(k=60, sent=SENT, state=X)
    assert (message[ARRIVED], message[STAMP]) == (1.0, pytest.approx(2.0))
    assert len(seen) >= 4
    assert all(before < after for before, after in pairwise(seen))
    np.testing.assert_allclose(boxes(message)[:, 2:], [projected(i, X[3:6]) for i in seen], atol=1e-9)
    assert boxes(message)[:, 0].tolist() == ROOM.landmark_labels[seen].tolist()
    assert not its.say(k=61, sent=NOT_SENT, state=X).any()


def test_a_turned_camera_that_stands_elsewhere_sees_what_opencv_projects(plain: np.ndarray) -> None:
    its, turned, moved = camera(), np.array([0.02, -0.01, 0.03]), P_BC + [0.05, -0.02, 0.01]
    its.n["turned"], its.tables["camera_p_BC"][:] = turned, moved
    R_WA = Rotation.from_euler("ZYX", X[[5, 4, 3]]) * Rotation.from_euler("ZYX", turned[::-1])
    found = boxes(its.say(sent=SENT, state=X))
    expected = [projected(i, R_WA.as_euler("ZYX")[::-1], moved) for i in shown(plain)]
    np.testing.assert_allclose(found[:, 2:], expected, atol=1e-6)


def test_a_landmark_that_is_gone_or_moved_changes_its_own_box_alone(plain: np.ndarray) -> None:
    i, by = shown(plain)[1], (0.1, 0.2, 0.1)
    gone, moved = {"kind": "landmark_gone", "landmark": i}, {"kind": "landmark_moved", "landmark": i, "by": list(by)}
    np.testing.assert_array_equal(boxes(camera(gone).say(sent=SENT, state=X)), np.delete(plain, 1, axis=0))
    found = boxes(camera(moved).say(sent=SENT, state=X))
    np.testing.assert_allclose(found[1, 2:], projected(i, X[3:6], by=by), atol=1e-9)
    np.testing.assert_array_equal(np.delete(found, 1, axis=0), np.delete(plain, 1, axis=0))
    later = camera(gone, moved, start=1.0)
    np.testing.assert_array_equal(boxes(later.say(k=29, sent=SENT, state=X))[:, 2:], plain[:, 2:])


def test_people_hide_what_they_stand_before(plain: np.ndarray) -> None:
    walks = [[1.0, -4.0, 1.0, -4.0], *([1.0, y, 1.0, y] for y in np.linspace(-1.5, 1.5, 16))]
    wall = {"kind": "people", "walks": walks, "height": 3.0}
    assert len(boxes(camera(wall).say(sent=SENT, state=X))) == 0
    aside = {"kind": "people", "walks": walks[:1], "height": 3.0}
    np.testing.assert_array_equal(boxes(camera(aside).say(sent=SENT, state=X)), plain)
