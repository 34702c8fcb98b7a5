"""Decoding and suppression against plain forms in NumPy and SciPy, and against OpenCV's suppression."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import expit

from ortilo_drake.onboard.detector.yolo_boxes import decode, non_max_suppression

Detections = tuple[np.ndarray, np.ndarray, np.ndarray]


def plain_decode(
    heads: list[np.ndarray],
    anchors: list[np.ndarray],
    input_size: np.ndarray,
    image_size: np.ndarray,
    threshold: float,
    scales: list[float],
) -> Detections:
    """The paper's equations on whole arrays, in the same order: head, anchor, row, column."""
    found = []
    for head, pairs, s in zip(heads, anchors, scales, strict=True):
        t = head.astype(float).reshape(len(pairs), -1, *head.shape[1:])
        n_y, n_x = head.shape[1:]
        c_y, c_x = np.mgrid[:n_y, :n_x]
        x, y = (s * (expit(t[:, k]) - 0.5) + 0.5 for k in (0, 1))  # about the cell's middle
        b_x, b_y = (x + c_x) / n_x, (y + c_y) / n_y
        b_w = pairs[:, 0, None, None] * np.exp(t[:, 2]) / input_size[0]
        b_h = pairs[:, 1, None, None] * np.exp(t[:, 3]) / input_size[1]
        edges = [b_x - b_w / 2, b_y - b_h / 2, b_x + b_w / 2, b_y + b_h / 2]
        box = np.stack(edges, axis=-1) * np.tile(image_size, 2) - 0.5
        score = expit(t[:, 4]) * expit(t[:, 5:].max(axis=1))
        keep = score >= threshold
        found.append((t[:, 5:].argmax(axis=1)[keep], score[keep], box[keep]))
    return tuple(np.concatenate(parts) for parts in zip(*found, strict=True))  # type: ignore[return-value]


def plain_suppression(labels: np.ndarray, scores: np.ndarray, boxes: np.ndarray, iou: float) -> list[int]:
    kept: list[int] = []
    for i in sorted(range(len(labels)), key=lambda i: (-scores[i], i)):
        for j in kept:
            w = min(boxes[i][2], boxes[j][2]) - max(boxes[i][0], boxes[j][0])
            h = min(boxes[i][3], boxes[j][3]) - max(boxes[i][1], boxes[j][1])
            areas = sum((box[2] - box[0]) * (box[3] - box[1]) for box in (boxes[i], boxes[j]))
            if labels[i] == labels[j] and w > 0 and h > 0 and w * h / (areas - w * h) > iou:
                break
        else:
            kept.append(i)
    return kept


@pytest.mark.long
@given(
    seed=st.integers(0, 2**32 - 1),
    grids=st.lists(st.tuples(st.integers(1, 4), st.integers(1, 7), st.integers(1, 6)), min_size=2, max_size=2),
    classes=st.integers(1, 9),
    threshold=st.floats(0.01, 0.95),
    whole=st.booleans(),
    scales=st.lists(st.sampled_from([1.0, 1.05, 1.2, 2.0]), min_size=2, max_size=2),
)
def test_decode_is_the_papers_equations(
    seed: int, grids: list[tuple[int, int, int]], classes: int, threshold: float, whole: bool, scales: list[float]
) -> None:
    rng = np.random.default_rng(seed)
    heads = [rng.normal(0.0, 2.0, (a * (5 + classes), n_y, n_x)).astype(np.float32) for a, n_y, n_x in grids]
    if whole:  # many equal logits
        heads = [np.round(head) for head in heads]
    anchors = [rng.uniform(1.0, 100.0, (a, 2)) for a, _, _ in grids]
    input_size, image_size = np.array([320.0, 240.0]), np.array([641.0, 333.0])
    labels, scores, boxes = decode(heads, anchors, input_size, image_size, threshold, scales)
    expected = plain_decode(heads, anchors, input_size, image_size, threshold, scales)
    np.testing.assert_array_equal(labels, expected[0])
    np.testing.assert_allclose(scores, expected[1], rtol=1e-12)
    np.testing.assert_allclose(boxes, expected[2], rtol=1e-12, atol=1e-9)
    batch = decode([head[None] for head in heads], anchors, input_size, image_size, threshold, scales)
    np.testing.assert_array_equal(batch[2], boxes)


def test_a_box_that_is_the_whole_image_spans_it_from_edge_to_edge() -> None:
    head = np.zeros((6, 1, 1), dtype=np.float32)
    head[4:] = 40.0
    labels, scores, boxes = decode([head], [np.array([[32.0, 64.0]])], np.array([32, 64]), np.array([640, 480]), 0.5)
    assert labels.tolist() == [0]
    assert scores.tolist() == [1.0]
    np.testing.assert_allclose(boxes, [[-0.5, -0.5, 639.5, 479.5]], rtol=1e-15)


def test_cells_that_are_nan_or_overflow_give_no_box() -> None:
    head = np.full((6, 1, 4), 5.0, dtype=np.float32)
    head[4, 0, 0] = np.nan
    head[2, 0, 1] = 2000.0
    head[5, 0, 2] = np.nan
    boxes = decode([head], [np.array([[8.0, 8.0]])], np.array([32, 8]), np.array([32, 8]), 0.5)[2]
    assert len(boxes) == 1
    assert boxes[0, 0] + boxes[0, 2] == pytest.approx(2 * ((3 + expit(5.0)) * 8 - 0.5))


@st.composite
def detections(draw: st.DrawFn) -> Detections:
    n = draw(st.integers(0, 25))
    labels = draw(st.lists(st.integers(0, 2), min_size=n, max_size=n))
    scores = draw(st.lists(st.integers(1, 9), min_size=n, max_size=n))  # many ties
    corners = st.tuples(st.integers(0, 12), st.integers(0, 12), st.integers(1, 9), st.integers(1, 9))
    boxes = np.array(draw(st.lists(corners, min_size=n, max_size=n)), dtype=float).reshape(n, 4)
    boxes[:, 2:] += boxes[:, :2]
    return np.array(labels, dtype=np.int64), np.array(scores, dtype=float) / 10.0, boxes


# Irrational: no overlap of boxes on whole pixels lies on it, where rounding would decide.
IOU = st.floats(0.05, 0.9).map(lambda x: round(x, 2) + np.pi * 1e-4)


@pytest.mark.long
@given(detections(), IOU)
def test_suppression_is_the_plain_form(found: Detections, iou: float) -> None:
    assert non_max_suppression(*found, iou).tolist() == plain_suppression(*found, iou)


@pytest.mark.long
@given(detections(), IOU)
def test_suppression_is_opencvs(found: Detections, iou: float) -> None:
    labels, scores, boxes = found
    sides = np.hstack([boxes[:, :2], boxes[:, 2:] - boxes[:, :2]])
    # OpenCV's order of equal scores is its own: make them differ.
    scores = scores - 1e-3 * np.arange(len(scores))
    expected = cv2.dnn.NMSBoxesBatched(sides.tolist(), scores.tolist(), labels.tolist(), 0.0, iou)
    assert non_max_suppression(labels, scores, boxes, iou).tolist() == list(expected)


@pytest.mark.long
@given(detections(), IOU)
def test_suppression_keeps_what_it_kept(found: Detections, iou: float) -> None:
    kept = [values[non_max_suppression(*found, iou)] for values in found]
    assert non_max_suppression(kept[0], kept[1], kept[2], iou).tolist() == list(range(len(kept[0])))
