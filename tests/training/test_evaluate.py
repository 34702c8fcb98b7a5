"""Judging detectors whose faults are known."""

from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pytest
from pydrake.math import RigidTransform

from ortilo_drake.model.as_data import as_data
from ortilo_drake.model.room import load_room
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.detector.detector import Boxes
from ortilo_drake.onboard.detector.detector_network import OWN_CLASSES
from ortilo_drake.scenario import Detector, load_scenario
from ortilo_drake.training.judging import recognised as judged
from ortilo_drake.training.judging.evaluate import CenterError, evaluate, is_whole, milliseconds_per_frame
from ortilo_drake.training.judging.judge import draw_boxes, judge
from ortilo_drake.training.judging.recognised import NEAR, near_poses, recognised, way_poses
from ortilo_drake.training.pictures.labels import BOX, CLASS, LABEL_SIZE, LANDMARK, MAX_OBJECTS, Frames
from ortilo_drake.world.scenery.rendering import camera_in_body

W, H, CLASSES = 160, 120, ("cat", "dog", "clock")


def frames_of(n: int = 8, seed: int = 0) -> Frames:
    """Return pictures with three objects each, well apart and inside, of two of the classes; a number marks each."""
    rng = np.random.default_rng(seed)
    images = np.zeros((n, H, W, 3), np.uint8)
    images[:, 0, 0, 0] = np.arange(n)
    labels = np.full((n, MAX_OBJECTS, LABEL_SIZE), -1.0, dtype=np.float32)
    for i in range(n):
        for k in range(3):
            u, v, w, h = 10 + 50 * k, rng.integers(10, 60), rng.integers(20, 30), rng.integers(20, 40)
            labels[i, k] = [rng.integers(2), u, v, u + w, v + h, 1.0, k, 3.0]
    return Frames(images, labels)


FRAMES = frames_of()


def detector(
    change: Callable[[np.ndarray], np.ndarray] = lambda boxes: boxes, score: float = 0.9, frames: Frames = FRAMES
) -> Callable[[np.ndarray], Boxes]:
    """Return a detector that knows the truth and tells it changed."""

    def detect(image: np.ndarray) -> Boxes:
        rows = frames.labels[image[0, 0, 0]]
        rows = rows[rows[:, 0] >= 0].astype(float)
        return rows[:, 0].astype(np.int64), np.full(len(rows), score), change(rows[:, 1:5])

    return detect


def test_a_perfect_detector() -> None:
    found = evaluate(detector(), FRAMES, CLASSES, 0.5)
    assert found.map50 == 1.0
    assert found.ap50 == {"cat": 1.0, "dog": 1.0, "clock": None}
    assert found.center_error_px == CenterError(0.0, 0.0)
    assert found.recall == 1.0
    assert found.false_boxes_per_image == 0.0
    assert (found.objects, found.images) == (24, 8)


def test_a_shifted_detectors_centre_error_is_the_shift() -> None:
    found = evaluate(detector(lambda boxes: boxes + [1.5, -2.0, 1.5, -2.0]), FRAMES, CLASSES, 0.5)
    assert found.map50 == 1.0
    assert found.center_error_px.median == pytest.approx(2.5, abs=1e-5)
    assert found.center_error_px.p95 == pytest.approx(2.5, abs=1e-5)


def test_a_detector_that_grows_boxes_about_their_centres_has_no_centre_error() -> None:
    found = evaluate(detector(lambda boxes: boxes + [-2.0, -1.0, 2.0, 1.0]), FRAMES, CLASSES, 0.5)
    assert found.center_error_px.p95 == pytest.approx(0.0, abs=1e-5)


def test_boxes_that_the_border_cuts_tell_nothing_of_centres() -> None:
    labels = FRAMES.labels.copy()
    labels[:, 0, 1] = -0.5  # the truth reaches the border
    frames = Frames(FRAMES.images, labels)

    def shift_the_cut(boxes: np.ndarray) -> np.ndarray:
        return boxes + np.where(boxes[:, :1] == -0.5, 3.0, 0.0) * [0.0, 0.0, 1.0, 0.0]

    found = evaluate(detector(shift_the_cut, frames=frames), frames, CLASSES, 0.5)
    assert found.recall == 1.0
    assert found.center_error_px.p95 == 0.0
    np.testing.assert_array_equal(
        is_whole(np.array([[1.1, 1.1, 157.9, 117.9], [0.9, 5, 9, 9], [5, 5, 158.1, 9], [5, 5, 9, 118.1]]), W, H),
        [True, False, False, False],
    )


def test_a_detector_that_misses_every_third_object() -> None:
    def detect(image: np.ndarray) -> Boxes:
        labels, scores, boxes = detector()(image)
        return labels[:2], scores[:2], boxes[:2]

    found = evaluate(detect, FRAMES, CLASSES, 0.5)
    assert found.recall == pytest.approx(2 / 3)
    missed = FRAMES.labels[:, 2, 0]
    for c in (0, 1):
        of_class = np.sum(FRAMES.labels[:, :3, 0] == c)
        assert found.ap50[CLASSES[c]] == pytest.approx(1.0 - np.sum(missed == c) / of_class)
    assert found.map50 == pytest.approx(np.mean([found.ap50["cat"], found.ap50["dog"]]))


def test_false_boxes_are_counted_from_the_score_it_flies_with_and_the_worst_come_first() -> None:
    def detect(image: np.ndarray) -> Boxes:
        labels, scores, boxes = detector()(image)
        k = int(image[0, 0, 0])
        if k in (3, 5):
            count = {3: 1, 5: 2}[k]
            extra = np.tile([100.0, 100.0, 118.0, 118.0], (count, 1))
            labels, boxes = np.append(labels, np.ones(count, int)), np.vstack([boxes, extra])
            scores = np.append(scores, np.full(count, 0.6))
        return labels, scores, boxes

    found = evaluate(detect, FRAMES, CLASSES, 0.5)
    assert found.false_boxes_per_image == 3 / 8
    assert found.worst[:2] == [5, 3]
    assert evaluate(detect, FRAMES, CLASSES, 0.7).false_boxes_per_image == 0.0
    assert found.map50 == 1.0  # all objects come before, in the order of scores


def test_below_the_score_it_flies_with_nothing_is_found_but_precision_is_known() -> None:
    found = evaluate(detector(score=0.3), FRAMES, CLASSES, 0.5)
    assert found.map50 == 1.0
    assert found.recall == 0.0
    assert found.center_error_px == CenterError(None, None)


def test_a_detector_that_finds_nothing() -> None:
    found = evaluate(lambda image: (np.empty(0, int), np.empty(0), np.empty((0, 4))), FRAMES, CLASSES, 0.5)
    assert found.map50 == found.recall == 0.0
    assert found.center_error_px == CenterError(None, None)


def test_what_need_not_be_found_is_neither_missed_nor_false() -> None:
    labels = FRAMES.labels.copy()
    labels[:, 1, 5] = 0.2
    frames = Frames(FRAMES.images, labels)
    found = evaluate(detector(frames=frames), frames, CLASSES, 0.5)
    assert (found.map50, found.recall, found.false_boxes_per_image) == (1.0, 1.0, 0.0)
    assert found.objects == 16


def test_pictures_without_objects_are_refused() -> None:
    empty = Frames(FRAMES.images, np.full_like(FRAMES.labels, -1.0))
    with pytest.raises(InputError, match="none shows an object"):
        evaluate(detector(frames=empty), empty, CLASSES, 0.5)


def test_time_is_the_detectors_own(monkeypatch: pytest.MonkeyPatch) -> None:
    now = 100.0
    spends = iter([9.0, 0.004, 0.001, 0.005, 0.5, 0.006])  # the first picture warms up; the median of the rest counts

    def detect(image: np.ndarray) -> None:
        nonlocal now
        now += next(spends)

    clock = SimpleNamespace(perf_counter=lambda: now)
    monkeypatch.setattr("ortilo_drake.training.judging.evaluate.time", clock)
    assert milliseconds_per_frame(detect, FRAMES.images, 5) == pytest.approx(5.0)  # type: ignore[arg-type]


def test_drawn_boxes_lie_on_the_pictures_pixels() -> None:
    truth = FRAMES.labels[0]
    drawn = draw_boxes(FRAMES.images[0], (np.empty(0, int), np.empty(0), np.empty((0, 4))), truth, CLASSES)
    assert drawn.shape == (2 * H, 2 * W, 3)
    green = np.all(drawn == [60, 220, 60], axis=2)
    v, u = np.nonzero(green)
    edges = 2.0 * (truth[:3, 1:5] + 0.5)
    assert (u.min(), u.max()) == (round(edges[:, 0].min()), round(edges[:, 2].max()))
    assert (v.min(), v.max()) == (round(edges[:, 1].min()), round(edges[:, 3].max()))


@pytest.mark.long
def test_judging_our_network_writes_plain_data_and_a_picture_whatever_its_weights(tmp_path) -> None:  # type: ignore[no-untyped-def]
    import json

    import cv2

    for kind, n in (("paper_room", 2), ("random_rooms", 5)):
        frames = frames_of(n)
        folder = tmp_path / "test" / kind
        folder.mkdir(parents=True)
        np.savez(folder / "00000.npz", images=frames.images, labels=frames.labels)
    worst = tmp_path / "worst.png"
    result = judge(Detector(backend="opencv"), load_room(), tmp_path, 0.01, worst)
    assert json.loads(json.dumps(as_data(result), allow_nan=False))["backend"] == "opencv"
    assert set(result.sets) == {"paper_room", "random_rooms"}
    assert set(result.sets["paper_room"].ap50) == set(OWN_CLASSES)
    assert result.ms_per_frame > 0
    assert cv2.imread(str(worst)).shape == (2 * H * 3, 2 * W * 4, 3)  # one row of two, two of five


def test_judging_by_sets_of_different_sizes_is_refused(tmp_path) -> None:  # type: ignore[no-untyped-def]
    for kind, scale in (("paper_room", 1), ("random_rooms", 2)):
        folder = tmp_path / "test" / kind
        folder.mkdir(parents=True)
        np.savez(folder / "0.npz", images=np.zeros((8, scale * H, scale * W, 3), np.uint8), labels=FRAMES.labels)
    with pytest.raises(InputError, match="of different sizes"):
        judge(Detector(backend="opencv"), load_room(), tmp_path, 0.01)


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
