"""Evaluation of a detector on labelled pictures: PASCAL VOC's average precision (since 2010), errors of box centres."""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.detector.detector import Boxes
from ortilo_drake.onboard.landmarks.landmark_association import BORDER
from ortilo_drake.training.pictures.labels import BOX, CLASS, LEAST, Frames, is_to_be_found

IOU = 0.5  # a detection and its object overlap by more than this IoU


def iou_matrix(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the intersection over union (n x m) of boxes (n x 4) and (m x 4), rows u_min, v_min, u_max, v_max."""
    low, high = np.maximum(a[:, None, :2], b[None, :, :2]), np.minimum(a[:, None, 2:], b[None, :, 2:])
    both = np.prod(np.maximum(high - low, 0.0), axis=2)
    area = [np.prod(x[:, 2:] - x[:, :2], axis=1) for x in (a, b)]
    return both / np.maximum(area[0][:, None] + area[1][None] - both, 1e-9)


def match_detections(
    labels: np.ndarray, scores: np.ndarray, boxes: np.ndarray, truth: np.ndarray, least: tuple[float, float] = LEAST
) -> np.ndarray:
    """Return, for each detection in a picture, the row of `truth` that it finds; -1 if false, -2 if it does not count.

    Detections have classes and scores (k) and boxes (k x 4); those with higher scores choose first. Each detection
    takes the object with the greatest IoU among the free objects of its class with an IoU above IOU. So a detection
    that covers two objects may find the second; PASCAL's own program counts it as false. A detection of an object that
    need not be found, by the limits of is_to_be_found, does not count. `truth` has the picture's labels (m x 8), see
    labels.py.
    """
    found = np.full(len(labels), -1)
    needed = is_to_be_found(truth, least)
    overlaps = iou_matrix(boxes, truth[:, BOX].astype(float))
    taken = np.zeros(len(truth), dtype=bool)
    for k in np.argsort(-scores, kind="stable"):
        same = (truth[:, CLASS] == labels[k]) & (overlaps[k] > IOU)
        free = same & needed & ~taken
        if free.any():
            i = int(np.argmax(np.where(free, overlaps[k], -1.0)))
            taken[i], found[k] = True, i
        elif (same & ~needed).any():
            found[k] = -2
    return found


def average_precision(scores: np.ndarray, true: np.ndarray, objects: int) -> float:
    """Return the area under the curve of precision, made monotone, over recall; NaN without objects to find.

    `scores` (k) and `true` (k), whether a detection finds an object, are for the detections of a class; `objects` is
    the number of objects to find.
    """
    if objects == 0:
        return float("nan")
    order = np.argsort(-scores, kind="stable")
    hits = np.cumsum(true[order])
    recall, precision = hits / objects, hits / np.arange(1, len(order) + 1)
    falling = np.maximum.accumulate(precision[::-1])[::-1]
    return float(np.sum(np.diff(np.concatenate([[0.0], recall])) * falling))


Detect = Callable[[np.ndarray], Boxes]


@dataclass(frozen=True)
class CenterError:
    """Median and 95th percentile of the errors of box centres [px]; None if no object is found whole."""

    median: float | None
    p95: float | None


@dataclass(frozen=True)
class Evaluation:
    """The result of a detector on a number `images` of labelled pictures with `objects` objects to be found.

    ap50 is the average precision by class at an IoU of 0.5, None for a class without objects; map50 is the mean over
    classes. The errors of centres are of objects found whole. Recall (found over all objects) and false boxes per image
    are for the threshold of flights. `worst` has the numbers of the pictures with most faults.
    """

    map50: float
    ap50: dict[str, float | None]
    center_error_px: CenterError
    recall: float
    false_boxes_per_image: float
    objects: int
    images: int
    worst: list[int]


def is_whole(boxes: np.ndarray, width: int, height: int) -> np.ndarray:
    """Return the mask (n) of boxes (n x 4) [px] that the image's border does not cut."""
    low, high = BORDER - 0.5, np.array([width, height]) - BORDER - 0.5
    return np.all(boxes[:, :2] > low, axis=1) & np.all(boxes[:, 2:] < high, axis=1)


def evaluate(
    detect: Detect, frames: Frames, classes: tuple[str, ...], threshold: float, least: tuple[float, float] = LEAST
) -> Evaluation:
    """Return mAP50, AP of each class, errors of centres, recall, false boxes, and the worst pictures of a detector.

    The detector's own threshold must be far below the threshold of flights, so that precision is known at all recalls.
    `threshold` is the threshold of flights, for centres, recall and false boxes. `least` are the limits of
    is_to_be_found. InputError if the pictures show no object to be found.
    """
    _, height, width, _ = frames.images.shape
    found_all, errors, faults = [], [], []
    objects = np.zeros(len(classes), dtype=int)
    hits = false = 0
    for image, truth in zip(frames.images, frames.labels, strict=True):
        labels, scores, boxes = detect(image)
        found = match_detections(labels, scores, boxes, truth, least=least)
        found_all += [(int(c), float(s), i) for c, s, i in zip(labels, scores, found, strict=True) if i != -2]
        needed = is_to_be_found(truth, least)
        for c in truth[needed, CLASS]:
            objects[int(c)] += 1
        flown = scores >= threshold
        good = flown & (found >= 0)
        hits += int(good.sum())
        wrong = int((flown & (found == -1)).sum())
        false += wrong
        faults.append(wrong + int(needed.sum()) - int(good.sum()))
        seen, true = boxes[good], truth[found[good], BOX].astype(float)
        clear = is_whole(seen, width, height) & is_whole(true, width, height)
        errors += list(np.linalg.norm((seen[:, :2] + seen[:, 2:] - true[:, :2] - true[:, 2:])[clear] / 2, axis=1))
    if not objects.any():
        raise InputError(f"pictures: {len(frames.images)} given, none shows an object to be found")
    ap = {}
    for c, name in enumerate(classes):
        rows = [(s, i >= 0) for k, s, i in found_all if k == c]
        scores, true = np.array([s for s, _ in rows]), np.array([t for _, t in rows], dtype=bool)
        ap[name] = average_precision(scores, true, int(objects[c]))
    return Evaluation(
        map50=float(np.nanmean(list(ap.values()))),
        ap50={name: None if np.isnan(value) else value for name, value in ap.items()},
        center_error_px=CenterError(*(float(np.quantile(errors, q)) if errors else None for q in (0.5, 0.95))),
        recall=hits / max(int(objects.sum()), 1),
        false_boxes_per_image=false / len(frames.images),
        objects=int(objects.sum()),
        images=len(frames.images),
        worst=[int(i) for i in np.argsort(-np.array(faults), kind="stable")[:12]],
    )


def milliseconds_per_frame(detect: Detect, images: np.ndarray, repeats: int = 100) -> float:
    """Return the detector's median time for a picture, including scaling and boxes [ms]."""
    detect(images[0])
    times = []
    for k in range(repeats):
        started = time.perf_counter()
        detect(images[k % len(images)])
        times.append(time.perf_counter() - started)
    return 1e3 * float(np.median(times))
