"""Average precision as PASCAL VOC (since 2010) defines it, and the error of the boxes' centres."""

import numpy as np

from ortilo_drake.training.pictures.labels import BOX, CLASS, LEAST, is_to_be_found


def iou_matrix(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the intersection over union of boxes (n, 4) and (m, 4), each (u_min, v_min, u_max, v_max)."""
    low, high = np.maximum(a[:, None, :2], b[None, :, :2]), np.minimum(a[:, None, 2:], b[None, :, 2:])
    both = np.prod(np.maximum(high - low, 0.0), axis=2)
    area = [np.prod(x[:, 2:] - x[:, :2], axis=1) for x in (a, b)]
    return both / np.maximum(area[0][:, None] + area[1][None] - both, 1e-9)


def match_detections(
    labels: np.ndarray,
    scores: np.ndarray,
    boxes: np.ndarray,
    truth: np.ndarray,
    iou: float = 0.5,
    least: tuple[float, float] = LEAST,
) -> np.ndarray:
    """Return for each detection of a picture the row of the truth it finds, -1 if false, -2 if it does not count.

    Detections choose in the order of their scores, the highest first. Each takes the object that it overlaps most,
    among the free objects of its class with an overlap above iou. So a detection that covers two objects may find the
    second; PASCAL's own program calls it false. A detection on an object that need not be found does not count.

    Args:
        labels: classes (k).
        scores: scores (k).
        boxes: boxes (k, 4).
        truth: labels of the picture (m, 8), see labels.py.
        iou: least overlap.
        least: limits of what must be found, see is_to_be_found.
    """
    found = np.full(len(labels), -1)
    needed = is_to_be_found(truth, least)
    overlaps = iou_matrix(boxes, truth[:, BOX].astype(float))
    taken = np.zeros(len(truth), dtype=bool)
    for k in np.argsort(-scores, kind="stable"):
        same = (truth[:, CLASS] == labels[k]) & (overlaps[k] > iou)
        free = same & needed & ~taken
        if free.any():
            i = int(np.argmax(np.where(free, overlaps[k], -1.0)))
            taken[i], found[k] = True, i
        elif (same & ~needed).any():
            found[k] = -2
    return found


def average_precision(scores: np.ndarray, true: np.ndarray, objects: int) -> float:
    """Return the area under precision, made monotone, over recall; NaN without objects.

    Args:
        scores: of all detections of a class (k).
        true: whether each finds an object (k).
        objects: number of objects to find.
    """
    if objects == 0:
        return float("nan")
    order = np.argsort(-scores, kind="stable")
    hits = np.cumsum(true[order])
    recall, precision = hits / objects, hits / np.arange(1, len(order) + 1)
    falling = np.maximum.accumulate(precision[::-1])[::-1]
    return float(np.sum(np.diff(np.concatenate([[0.0], recall])) * falling))
