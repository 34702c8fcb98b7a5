"""Which landmarks a detector recognises: with detectors that see all, nothing, or one class."""

import numpy as np
import pytest
from pydrake.math import RigidTransform

from ortilo_drake.onboard.detector.detector import Boxes
from ortilo_drake.scenario import load_scenario
from ortilo_drake.training.judging import recognised as judged
from ortilo_drake.training.judging.recognised import NEAR, near_poses, recognised, way_poses
from ortilo_drake.training.pictures.labels import BOX, CLASS, LANDMARK
from ortilo_drake.world.scenery.rendering import camera_in_body

SCENARIO = load_scenario("imu_uwb_yolo")
ROOM = SCENARIO.load_room()
HYDRANT = ROOM.classes.index("fire hydrant")


def test_a_view_from_near_looks_at_the_landmark_from_that_far() -> None:
    for X_WC in near_poses(ROOM, 4):
        p_CL = X_WC.inverse() @ ROOM.landmark_positions[4]
        np.testing.assert_allclose(p_CL, [0.0, 0.0, NEAR], atol=1e-12)
        assert X_WC.rotation().matrix()[2, 1] == pytest.approx(-1.0)  # the picture's down is down


@pytest.mark.long
def test_the_way_is_seen_in_steps_of_equal_length_and_forward() -> None:
    poses = way_poses(SCENARIO, ROOM)
    points = np.array([X.translation() for X in poses])
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    np.testing.assert_allclose(steps, judged.STEP, atol=0.02)
    R_BC = camera_in_body(ROOM.camera).rotation()
    for X in poses:
        np.testing.assert_allclose(X.rotation().matrix(), R_BC.matrix(), atol=1e-12)


class Made:
    """A studio whose picture shows one landmark, and a detector that finds some classes in it with a score of 0.3."""

    truth = np.full((32, 8), -1.0)

    def __init__(self, *_: object) -> None:
        pass

    def picture(self, X_WC: RigidTransform) -> tuple[np.ndarray, np.ndarray]:
        truth = self.truth.copy()
        truth[0, [CLASS, LANDMARK]] = HYDRANT, 2
        truth[0, BOX] = 100, 100, 140, 160
        truth[0, 5] = 1.0
        return np.zeros((240, 320, 3), np.uint8), truth


@pytest.mark.parametrize(("label", "best"), [(HYDRANT, 0.3), (HYDRANT + 1, 0.0)])
def test_a_box_counts_by_its_class_and_its_score(label: int, best: float, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(judged, "Studio", Made)

    def detect(picture: np.ndarray) -> Boxes:
        return np.array([label]), np.array([0.3]), np.array([[101.0, 101.0, 141.0, 161.0]])

    for threshold in (0.2, 0.4):
        found = recognised(detect, SCENARIO, threshold)
        assert [one.label for one in found] == [landmark.label for landmark in ROOM.landmarks]
        way = found[2].way
        assert way.best == best
        assert way.found == (way.pictures if best >= threshold else 0)
        assert way.pictures == len(way_poses(SCENARIO, ROOM))
        assert found[2].near.pictures == judged.DIRECTIONS
        assert found[3].way.pictures == 0
