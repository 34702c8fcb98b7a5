"""A detector of one's own: a function that a plugin registers (register_detector)."""

from collections.abc import Callable
from typing import Any

import numpy as np

from ortilo_drake.model.parts import find_part
from ortilo_drake.model.room import Room
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.detector.detector import Boxes


def load_own(settings: Any, room: Room, size: tuple[int, int]) -> Callable[[np.ndarray], Boxes]:
    """Return the function from a picture to labels (k), scores (k) and boxes (k, 4) [px]; see load_detector.

    What it finds is checked in every picture, and cut at the image's border.

    Args:
        settings: of a registered kind.
        room: the landmarks.
        size: width and height of the picture [px].

    Raises:
        InputError: from the function, if what it finds has another shape or is of no class of the room.
    """
    part = find_part("detector", settings.kind)
    assert part is not None
    assert part.make is not None
    kind, classes, border = settings.kind, room.classes, np.tile(size, 2) - 0.5
    own = part.make(settings, classes, size)

    def detect(image: np.ndarray) -> Boxes:
        found = own(image)
        if not isinstance(found, tuple) or len(found) != 3:
            raise InputError(f"detector.kind: {kind}: must return labels, scores and boxes, not {type(found).__name__}")
        try:
            labels, scores, boxes = np.asarray(found[0]), np.asarray(found[1], float), np.asarray(found[2], float)
        except (TypeError, ValueError):
            raise InputError(f"detector.kind: {kind}: must return arrays of numbers") from None
        k = len(labels) if labels.ndim == 1 else -1
        boxes = boxes.reshape(0, 4) if boxes.size == 0 else boxes
        if scores.shape != (k,) or boxes.shape != (k, 4):
            shapes = ", ".join(str(part.shape) for part in (labels, scores, boxes))
            raise InputError(f"detector.kind: {kind}: shapes {shapes}: must be (k), (k) and (k, 4)")
        if not np.isin(labels, np.arange(len(classes))).all():
            raise InputError(
                f"detector.kind: {kind}: labels {labels[:8]}: must be 0 to {len(classes) - 1}, the classes"
            )
        if not (np.isfinite(boxes).all() and np.all((scores > 0.0) & (scores <= 1.0))):
            raise InputError(f"detector.kind: {kind}: boxes must be finite, scores above 0 and at most 1")
        return labels.astype(np.int64), scores, np.clip(boxes, -0.5, border)

    return detect
