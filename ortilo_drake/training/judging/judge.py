"""The judgement of a detector: its results on both test sets, its speed, and the pictures with most faults."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ortilo_drake.flight.files import write_bytes
from ortilo_drake.model.optional import later
from ortilo_drake.model.room import Room
from ortilo_drake.model.typed_yaml import InputError, validate
from ortilo_drake.onboard.detector.detector_network import load_detector, own_backend
from ortilo_drake.scenario import Detector
from ortilo_drake.training.judging.evaluate import Detect, Evaluation, evaluate, milliseconds_per_frame
from ortilo_drake.training.pictures.labels import BOX, LEAST_CLEAR, Frames, is_to_be_found
from ortilo_drake.training.pictures.sets import KINDS, load_frames, set_folder

cv2 = later("cv2")


@dataclass(frozen=True)
class Judgement:
    """The results of a detector on both test sets, as `ortilo detector evaluate --json` writes them.

    For each set there are map50, map50 of only the objects in clearer view, the median error of centres [px] and all
    figures. ms_per_frame is the time for a picture on one core with `backend`; `threshold` is the score of flights.
    """

    map50: dict[str, float]
    map50_clear: dict[str, float]
    center_error_px: dict[str, float | None]
    ms_per_frame: float
    backend: str
    threshold: float
    sets: dict[str, Evaluation]


def draw_boxes(
    image: np.ndarray, found: tuple[np.ndarray, ...], truth: np.ndarray, classes: tuple[str, ...]
) -> np.ndarray:
    """Return the BGR picture, twice as large, with detections (yellow) and objects to be found (green)."""
    drawn = cv2.resize(image[..., ::-1], None, fx=2, fy=2, interpolation=cv2.INTER_NEAREST)

    def box(edges: np.ndarray, color: tuple[int, int, int], text: str) -> None:
        u_min, v_min, u_max, v_max = (int(v) for v in np.round(2.0 * (edges + 0.5)))
        cv2.rectangle(drawn, (u_min, v_min), (u_max, v_max), color, 1)
        cv2.putText(drawn, text, (u_min + 2, v_min + 10), cv2.FONT_HERSHEY_SIMPLEX, 0.35, color, 1, cv2.LINE_AA)

    for row in truth[is_to_be_found(truth)]:
        box(row[BOX], (60, 220, 60), "")
    for label, score, edges in zip(*found, strict=True):
        box(edges, (0, 230, 255), f"{classes[int(label)]} {score:.2f}")
    return drawn


def _worst_figure(
    detect: Detect, sets: dict[str, tuple[Frames, list[int]]], classes: tuple[str, ...], path: Path
) -> None:
    rows = []
    for frames, worst in sets.values():
        drawn = [draw_boxes(frames.images[i], detect(frames.images[i]), frames.labels[i], classes) for i in worst[:8]]
        drawn += [np.zeros_like(drawn[0])] * (-len(drawn) % 4)
        rows += [np.hstack(drawn[k : k + 4]) for k in range(0, len(drawn), 4)]
    write_bytes(path, cv2.imencode(".png", np.vstack(rows))[1].tobytes())


def judge(settings: Detector, room: Room, pictures: Path, lowest: float, worst: Path | None = None) -> Judgement:
    """Return the judgement of a detector on the test sets in a folder; `settings` has its network and threshold.

    The room gives the classes. Detections with a score of `lowest` or more count in the precision-recall curve. The
    pictures with most faults are drawn to the PNG file `worst`, if given. InputError if the pictures or the network's
    files are wrong, or the two sets have different image sizes.
    """
    sets = {kind: load_frames(set_folder(pictures, "test", kind)) for kind in KINDS}
    sizes = {frames.images.shape[1:3] for frames in sets.values()}
    if len(sizes) > 1:
        raise InputError(f"{pictures}: pictures of different sizes (height, width): {sorted(sizes)}")
    height, width = sizes.pop()
    cv2.setNumThreads(1)
    all_boxes = validate(Detector, settings.model_dump() | {"threshold": lowest}, "detector")
    detect = load_detector(all_boxes, room, (width, height))
    results = {kind: evaluate(detect, frames, room.classes, settings.threshold) for kind, frames in sets.items()}
    clear = {
        kind: evaluate(detect, frames, room.classes, settings.threshold, LEAST_CLEAR).map50
        for kind, frames in sets.items()
    }
    flown = load_detector(settings, room, (width, height))
    if worst is not None:
        _worst_figure(flown, {kind: (sets[kind], results[kind].worst) for kind in KINDS}, room.classes, worst)
    return Judgement(
        map50={kind: result.map50 for kind, result in results.items()},
        map50_clear=clear,
        center_error_px={kind: result.center_error_px.median for kind, result in results.items()},
        ms_per_frame=milliseconds_per_frame(flown, sets["paper_room"].images),
        backend="torch" if settings.cfg else own_backend(settings.backend),
        threshold=settings.threshold,
        sets=results,
    )
