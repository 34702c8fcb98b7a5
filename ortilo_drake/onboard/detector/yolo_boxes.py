"""From a YOLOv3 network's raw heads to boxes in the image (Redmon and Farhadi, "YOLOv3", 2018, section 2.1).

For an anchor (p_w, p_h) [px of the network's input] in the cell (c_x, c_y) of a grid (n_x, n_y), a box is, in shares of
the image:

    b_x = (s sigmoid(t_x) - (s - 1) / 2 + c_x) / n_x,  b_w = p_w exp(t_w) / input width,  the same in y and h
    score = sigmoid(t_obj) sigmoid(t_class) of the best class

s = 1 in YOLOv3; YOLOv4's scale_x_y (Bochkovskiy et al., "YOLOv4", 2020) reaches a cell's edges with s > 1.

The image fills the input: an image of another shape is stretched along each axis separately, as in OpenCV's
blobFromImage. A pixel's centre has integer coordinates, so the share b_x is at u = b_x width - 1/2.
"""

from collections.abc import Sequence

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.compiled.cached import cached_njit


@register_jitable
def _sigmoid(t: float) -> float:
    return 1.0 / (1.0 + np.exp(-np.float64(t)))


@register_jitable
def _best_class(head: np.ndarray, first: int, classes: int, row: int, column: int) -> int:
    """Return the class with the largest logit, the first one of equal logits."""
    best = 0
    for k in range(1, classes):
        if head[first + k, row, column] > head[first + best, row, column]:
            best = k
    return best


@cached_njit
def _decode(
    heads: tuple[np.ndarray, ...],
    anchors: tuple[np.ndarray, ...],
    scales: np.ndarray,
    input_size: np.ndarray,
    image_size: np.ndarray,
    threshold: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Do `decode`, compiled, with heads (a (5 + c), n_y, n_x) and anchors (a, 2) as arrays."""
    n = 0
    for i in range(len(heads)):
        n += len(anchors[i]) * heads[i].shape[1] * heads[i].shape[2]
    labels, scores, boxes = np.empty(n, dtype=np.int64), np.empty(n), np.empty((n, 4))
    # A score is at most sigmoid(t_obj), so most cells are dropped without computing an exp.
    logit = np.log(threshold / (1.0 - threshold))
    k = 0
    for i in range(len(heads)):
        head, p, s = heads[i], anchors[i], scales[i]
        n_y, n_x = head.shape[1], head.shape[2]
        step = head.shape[0] // len(p)
        for a in range(len(p)):
            t = a * step
            for row in range(n_y):
                for column in range(n_x):
                    if not head[t + 4, row, column] >= logit:
                        continue
                    best = _best_class(head, t + 5, step - 5, row, column)
                    score = _sigmoid(head[t + 4, row, column]) * _sigmoid(head[t + 5 + best, row, column])
                    if not score >= threshold:
                        continue
                    b_x = (s * _sigmoid(head[t, row, column]) - 0.5 * (s - 1.0) + column) / n_x
                    b_y = (s * _sigmoid(head[t + 1, row, column]) - 0.5 * (s - 1.0) + row) / n_y
                    b_w = p[a, 0] * np.exp(np.float64(head[t + 2, row, column])) / input_size[0]
                    b_h = p[a, 1] * np.exp(np.float64(head[t + 3, row, column])) / input_size[1]
                    boxes[k, 0] = (b_x - 0.5 * b_w) * image_size[0] - 0.5
                    boxes[k, 1] = (b_y - 0.5 * b_h) * image_size[1] - 0.5
                    boxes[k, 2] = (b_x + 0.5 * b_w) * image_size[0] - 0.5
                    boxes[k, 3] = (b_y + 0.5 * b_h) * image_size[1] - 0.5
                    # The exp of an untrained network may overflow.
                    if np.isfinite(boxes[k]).all():
                        labels[k], scores[k] = best, score
                        k += 1
    return labels[:k].copy(), scores[:k].copy(), boxes[:k].copy()


def decode(
    heads: Sequence[np.ndarray],
    anchors: Sequence[np.ndarray],
    input_size: np.ndarray,
    image_size: np.ndarray,
    threshold: float,
    scales: Sequence[float] | None = None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return labels (k), scores (k) and boxes (k, 4) [px] of one image, in the order head, anchor, row, column.

    A box is (u_min, v_min, u_max, v_max) and may extend beyond the image's border. Each anchor of a cell gives only its
    best class, and only if the score is `threshold` or more. Raw heads are float32, (a (5 + classes), n_y, n_x) or (1,
    a (5 + classes), n_y, n_x), each with anchors (a, 2) [px of the network's input] and a scale_x_y, by default 1.
    Sizes are width and height (2) [px].
    """
    planes = tuple(np.ascontiguousarray(head.reshape(head.shape[-3:]), dtype=np.float32) for head in heads)
    p = tuple(np.ascontiguousarray(pairs, dtype=np.float64) for pairs in anchors)
    s = np.ones(len(p)) if scales is None else np.array(scales, dtype=np.float64)
    return _decode(planes, p, s, np.asarray(input_size, float), np.asarray(image_size, float), threshold)


@register_jitable
def overlap(a: np.ndarray, b: np.ndarray) -> tuple[float, float]:
    """Return the areas of two boxes' intersection and union [px^2]."""
    width = min(a[2], b[2]) - max(a[0], b[0])
    height = min(a[3], b[3]) - max(a[1], b[1])
    both = max(width, 0.0) * max(height, 0.0)
    return both, (a[2] - a[0]) * (a[3] - a[1]) + (b[2] - b[0]) * (b[3] - b[1]) - both


@cached_njit
def non_max_suppression(labels: np.ndarray, scores: np.ndarray, boxes: np.ndarray, iou: float) -> np.ndarray:
    """Return the indices (k) of the boxes to keep, best score first; boxes with equal scores keep their order.

    A box (u_min, v_min, u_max, v_max) is dropped if its intersection over union with a better kept box of its class
    exceeds `iou`.
    """
    order = np.argsort(-scores, kind="mergesort")
    kept = np.empty(len(order), dtype=np.int64)
    k = 0
    for i in order:
        falls = False
        for j in kept[:k]:
            if labels[j] == labels[i]:
                both, either = overlap(boxes[i], boxes[j])
                if both > iou * either:
                    falls = True
                    break
        if not falls:
            kept[k] = i
            k += 1
    return kept[:k].copy()
