"""Evaluation of a detector on labelled pictures: PASCAL VOC's average precision (since 2010), errors of the centres."""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.detector.detector import Boxes
from ortilo_drake.onboard.landmarks.landmark_association import BORDER
from ortilo_drake.training.pictures.labels import BOX, CLASS, LEAST, Frames, is_to_be_found

IOU = 0.5  # least overlap of a detection and its object


def iou_matrix(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the intersection over union of boxes (n, 4) and (m, 4), each (u_min, v_min, u_max, v_max)."""
    low, high = np.maximum(a[:, None, :2], b[None, :, :2]), np.minimum(a[:, None, 2:], b[None, :, 2:])
    both = np.prod(np.maximum(high - low, 0.0), axis=2)
    area = [np.prod(x[:, 2:] - x[:, :2], axis=1) for x in (a, b)]
    return both / np.maximum(area[0][:, None] + area[1][None] - both, 1e-9)


def match_detections(
    labels: np.ndarray, scores: np.ndarray, boxes: np.ndarray, truth: np.ndarray, least: tuple[float, float] = LEAST
) -> np.ndarray:
    """Return for each detection of a picture the row of the truth it finds, -1 if false, -2 if it does not count.

    Detections, classes, scores (k) and boxes (k, 4), choose in the order of their scores, the highest first. Each takes
    the object that it overlaps most, among the free objects of its class with an IoU above IOU. So a detection that
    covers two objects may find the second; PASCAL's own program calls it false. A detection on an object that need not
    be found, by the limits of is_to_be_found, does not count. The truth are the labels of the picture (m, 8), see
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
    """Return the area under precision, made monotone, over recall, of so many objects to find; NaN without any.

    The detections of a class have scores (k), and each finds an object or not, true (k).
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
    """Median and 95th percentile of the centres' errors [px]; None if no object is found whole."""

    median: float | None
    p95: float | None


@dataclass(frozen=True)
class Evaluation:
    """A detector on so many labelled pictures, images, with so many objects to be found.

    map50 is the mean of the classes' average precisions at an overlap of 0.5, ap50 by class; None for a class without
    objects. The centres' errors are of objects found whole. Recall, objects found over all, and false boxes per image
    are at the threshold of flights. The worst are the pictures with most faults, by number.
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
    """Return a mask (n) of the boxes (n, 4) that the image's border does not cut."""
    low, high = BORDER - 0.5, np.array([width, height]) - BORDER - 0.5
    return np.all(boxes[:, :2] > low, axis=1) & np.all(boxes[:, 2:] < high, axis=1)


def evaluate(
    detect: Detect, frames: Frames, classes: tuple[str, ...], threshold: float, least: tuple[float, float] = LEAST
) -> Evaluation:
    """Return mAP50, AP of each class, errors of the centres, recall and false boxes, and the worst pictures.

    The detector has a threshold far below that of flights, so that precision is known at all recalls; the threshold
    given is that of flights, for centres, recall and false boxes. What must be found is by the limits of
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
    """Return the detector's median time for a picture, scaling and boxes included [ms]."""
    detect(images[0])
    times = []
    for k in range(repeats):
        started = time.perf_counter()
        detect(images[k % len(images)])
        times.append(time.perf_counter() - started)
    return 1e3 * float(np.median(times))
