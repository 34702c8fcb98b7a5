"""Average precision and matching: by hand, and against a plain form over random detections."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ortilo_drake.training.judging.evaluate import average_precision, iou_matrix, match_detections
from ortilo_drake.training.pictures.labels import LABEL_SIZE, MAX_OBJECTS


def truth_of(*objects: tuple[int, tuple[float, float, float, float], float]) -> np.ndarray:
    """Return labels of (class, box, visible share)."""
    rows = np.full((MAX_OBJECTS, LABEL_SIZE), -1.0, dtype=np.float32)
    for i, (label, box, visible) in enumerate(objects):
        rows[i] = [label, *box, visible, i, 3.0]
    return rows


def found(truth: np.ndarray, *detections: tuple[int, float, tuple[float, float, float, float]]) -> list[int]:
    labels, scores = np.array([d[0] for d in detections]), np.array([d[1] for d in detections])
    return match_detections(
        labels, scores, np.array([d[2] for d in detections], dtype=float).reshape(-1, 4), truth
    ).tolist()


# --- the curve ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("hits", "objects", "expected"),
    [
        ([], 3, 0.0),
        ([1], 1, 1.0),
        ([0], 1, 0.0),
        ([1, 1], 4, 0.5),
        ([0, 1], 1, 0.5),  # precision 1/2 at recall 1
        ([1, 0, 1], 2, 0.5 + 0.5 * 2 / 3),  # 1 up to recall 1/2, 2/3 up to 1
        ([0, 1, 1], 2, 2 / 3),  # the 1/2 at recall 1/2 is raised to the 2/3 that follows
        ([1, 0, 0, 1, 1], 5, 0.2 + 0.4 * 3 / 5),
        ([1, 1, 0, 0], 2, 1.0),  # what comes after the last object costs nothing
    ],
)
def test_cases_worked_by_hand(hits: list[int], objects: int, expected: float) -> None:
    scores = np.linspace(0.9, 0.1, len(hits))
    shuffled = np.random.default_rng(0).permutation(len(hits))
    true = np.array(hits, dtype=bool)
    assert average_precision(scores[shuffled], true[shuffled], objects) == pytest.approx(expected, rel=1e-12, abs=0.0)


def test_without_objects_it_is_not_defined() -> None:
    assert np.isnan(average_precision(np.array([0.5]), np.array([False]), 0))


@given(st.lists(st.booleans(), max_size=30), st.integers(0, 10))
def test_it_is_the_area_under_the_best_precision_at_or_beyond_each_recall(hits: list[bool], missed: int) -> None:
    objects = sum(hits) + missed
    if objects == 0:
        return
    expected = 0.0
    for wanted in range(1, objects + 1):  # the curve is level between one object more and the next
        reached = [sum(hits[:n]) / n for n in range(1, len(hits) + 1) if sum(hits[:n]) >= wanted]
        expected += max(reached, default=0.0) / objects
    scores = -np.arange(len(hits), dtype=float)
    assert average_precision(scores, np.array(hits, dtype=bool), objects) == pytest.approx(expected, abs=1e-12)


# --- which detection finds what -------------------------------------------------------------------------------

A, B = (10.0, 10.0, 30.0, 30.0), (60.0, 10.0, 80.0, 30.0)


def test_the_better_of_two_on_one_object_finds_it_and_the_other_is_false() -> None:
    assert found(truth_of((0, A, 1.0)), (0, 0.6, A), (0, 0.9, A)) == [-1, 0]


def test_another_class_and_too_small_an_overlap_are_false() -> None:
    truth = truth_of((0, A, 1.0), (1, B, 1.0))
    assert found(truth, (1, 0.9, A), (0, 0.8, (10.0, 10.0, 30.0, 20.0)), (1, 0.7, B)) == [
        -1,
        -1,
        1,
    ]  # IoU 1/2 is not more


def test_an_object_is_found_when_the_overlap_is_just_more_than_half() -> None:
    assert found(truth_of((0, A, 1.0)), (0, 0.9, (10.0, 10.0, 30.0, 20.1))) == [0]


@pytest.mark.parametrize(
    ("box", "visible"), [(A, 0.49), ((10.0, 10.0, 15.9, 40.0), 1.0), ((10.0, 10.0, 40.0, 15.9), 1.0)]
)
def test_what_lies_on_an_object_that_need_not_be_found_does_not_count(box: tuple[float, ...], visible: float) -> None:
    truth = truth_of((0, box, visible), (0, B, 1.0))  # type: ignore[arg-type]
    assert found(truth, (0, 0.9, box), (0, 0.8, box), (1, 0.7, box), (0, 0.6, B)) == [-2, -2, -1, 1]  # type: ignore[arg-type]


def test_an_object_to_be_found_comes_before_one_that_need_not() -> None:
    near = (11.0, 10.0, 31.0, 30.0)
    assert found(truth_of((0, A, 0.1), (0, near, 1.0)), (0, 0.9, A), (0, 0.8, A)) == [1, -2]


def test_no_detections_and_no_objects() -> None:
    assert found(truth_of((0, A, 1.0))) == []
    assert found(truth_of(), (0, 0.9, A)) == [-1]


boxes = st.tuples(st.integers(0, 12), st.integers(0, 12), st.integers(1, 16), st.integers(1, 16)).map(
    lambda b: (float(b[0]), float(b[1]), float(b[0] + b[2]), float(b[1] + b[3]))
)


def pixels(box: tuple[float, ...]) -> set[tuple[int, int]]:
    return {(u, v) for u in range(int(box[0]), int(box[2])) for v in range(int(box[1]), int(box[3]))}


@pytest.mark.long
@given(
    st.lists(st.tuples(st.integers(0, 1), boxes, st.sampled_from([0.2, 1.0])), max_size=6),
    st.lists(st.tuples(st.integers(0, 1), boxes), max_size=8),
)
def test_matching_is_the_plain_form_on_counted_pixels(objects: list, detections: list) -> None:
    scores = np.linspace(0.9, 0.2, len(detections)) if detections else np.empty(0)
    left = set(range(len(objects)))
    expected = []
    for label, box in detections:  # best first
        overlaps = {}
        for i, (other, area, _) in enumerate(objects):
            a, b = pixels(box), pixels(area)
            if other == label and 2 * len(a & b) > len(a | b):
                overlaps[i] = len(a & b) / len(a | b)
        to_find = {
            i for i in overlaps if objects[i][2] >= 0.5 and min(np.subtract(objects[i][1][2:], objects[i][1][:2])) >= 6
        }
        free = to_find & left
        if free:
            best = max(sorted(free), key=lambda i: overlaps[i])
            left.remove(best)
            expected.append(best)
        else:
            expected.append(-2 if set(overlaps) - to_find else -1)
    order = np.random.default_rng(len(detections)).permutation(len(detections))
    rows = [(detections[k][0], float(scores[k]), detections[k][1]) for k in order]
    assert found(truth_of(*objects), *rows) == [expected[k] for k in order]


@given(st.lists(boxes, min_size=1, max_size=5), st.lists(boxes, min_size=1, max_size=5))
def test_intersection_over_union_is_counted_pixels(one: list, other: list) -> None:
    expected = [[len(pixels(a) & pixels(b)) / len(pixels(a) | pixels(b)) for b in other] for a in one]
    np.testing.assert_allclose(iou_matrix(np.array(one), np.array(other)), expected, rtol=1e-12)
