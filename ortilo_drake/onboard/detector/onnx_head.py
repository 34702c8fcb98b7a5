"""The outputs of YOLOv5, v8 and v11 as Ultralytics exports them to ONNX, and boxes of them.

Each place of the network's grids, of strides 8, 16 and 32 (or more), says a box by its centre and size in pixels of the
input, and scores that are already between 0 and 1:

    YOLOv5        (1, 3 n, 5 + c)   x, y, w, h, object, class 1 ... c   score = object * class
    YOLOv8, v11   (1, 4 + c, n)     x, y, w, h, class 1 ... c           score = class

with n the sum of the grids' cells. The two are told apart by these numbers. Either may lie the other way round, if the
file has names, which say c.
"""

import ast
from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from ortilo_drake.model.typed_yaml import InputError

STRIDES = (4, 8, 16, 32, 64)
ANCHORS = 3  # of a cell in YOLOv5
MOST_CLASSES = 10_000
_TASKS = {"segment": "-seg", "pose": "-pose", "classify": "-cls", "obb": "-obb"}
_WANTED = "must be a detection network of YOLOv5, v8 or v11"


class Head(NamedTuple):
    """The format of a network's boxes."""

    classes: int
    """c."""
    has_object: bool
    """whether a place has the score of an object beside those of its classes, as in YOLOv5."""
    in_rows: bool
    """whether a place is a row of the output, or a column."""


def names_in(metadata: Mapping[str, str], source: str) -> list[str] | None:
    """Return the class names in a file's metadata, None where it has none.

    InputError if they are no list of names, nor names numbered from 0.
    """
    text = metadata.get("names")
    if text is None:
        return None
    try:
        found = ast.literal_eval(text) if len(text) <= 100 * MOST_CLASSES else None
    except (ValueError, SyntaxError, MemoryError, RecursionError):
        found = None
    if isinstance(found, dict) and [str(key) for key in found] == [str(i) for i in range(len(found))]:
        found = [*found.values()]
    if not isinstance(found, list) or not found or not all(isinstance(name, str) for name in found):
        raise InputError(f"{source}: metadata 'names': {text[:60]!r}: must be names, numbered from 0")
    return [name.strip() for name in found]


def _places(width: int, height: int) -> set[int]:
    """Return the possible numbers of grid cells of an input, over two strides or more."""
    cells = [(width // stride) * (height // stride) for stride in STRIDES]
    return {sum(cells[i:j]) for i, j in combinations(range(len(STRIDES) + 1), 2) if j - i > 1}


def _shown(shape: Sequence[int]) -> str:
    return " x ".join(map(str, shape))


def head_of(
    shapes: Sequence[tuple[int, ...]],
    size: tuple[int, int],
    metadata: Mapping[str, str],
    names: list[str] | None,
    source: str,
) -> Head:
    """Return the format of a network's boxes, found by the shapes of all its outputs, for an input of that size [px].

    Names are its classes, None where they are not known; the source is the file, for errors. InputError if it is no
    detection network of YOLOv5, v8 or v11, or has not as many classes as names.
    """
    task = metadata.get("task", "detect")
    if task != "detect":
        raise InputError(f"{source}: is a network of the task '{task}' ({_TASKS.get(task, 'another')}): {_WANTED}")
    if not shapes:
        raise InputError(f"{source}: has no outputs: {_WANTED}")
    first, rest = shapes[0], shapes[1:]
    if len(first) == 2:
        raise InputError(f"{source}: gives {_shown(first)} scores of the whole picture, a classifier (-cls): {_WANTED}")
    if any(len(shape) == 4 for shape in rest):
        raise InputError(f"{source}: gives masks beside its boxes, a segmentation network (-seg): {_WANTED}")
    if len(first) == 5:
        raise InputError(f"{source}: gives raw grids, {_shown(first)}, not boxes: write it as ONNX without train=True")
    if len(first) != 3 or first[0] != 1:
        raise InputError(f"{source}: its first output is {_shown(first)}: {_WANTED}")
    rows, columns = first[1:]
    cells = _places(*size)
    triples, c = {ANCHORS * n for n in cells}, None if names is None else len(names)
    # Corners, score and class of boxes that are left, as of YOLOv10 or with nms=True.
    if columns == 6 and (rows not in triples or c not in (None, 1)):
        raise InputError(f"{source}: gives boxes that it has suppressed itself: write it as ONNX with nms=False")
    if columns in cells and rows > 4:
        head = Head(rows - 4, False, False)
    elif rows in triples and columns > 5:
        head = Head(columns - 5, True, True)
    elif rows in cells and c == columns - 4:
        head = Head(c, False, True)
    elif columns in triples and c == rows - 5:
        head = Head(c, True, False)
    else:
        n = sum((size[0] // stride) * (size[1] // stride) for stride in (8, 16, 32))
        raise InputError(
            f"{source}: its first output is {_shown(first)}: must be 1 x (4 + classes) x {n} (YOLOv8, v11) or "
            f"1 x {ANCHORS * n} x (5 + classes) (YOLOv5) of its input, {size[0]} x {size[1]}"
        )
    if head.classes > MOST_CLASSES:
        raise InputError(f"{source}: has {head.classes} classes, at most {MOST_CLASSES} are read")
    if names is not None and len(names) != head.classes:
        raise InputError(
            f"{source}: says {columns if head.has_object else rows} numbers of a box, which are {head.classes} "
            f"classes, and has {len(names)} names: is it of another task (-seg, -pose, -obb)?"
        )
    return head


def boxes_in(output: np.ndarray, head: Head, threshold: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return classes (k), scores (k) and corners (k, 4) [px of the input] of the places with that score or more.

    A place says its best class alone. The output is the network's first, of one picture.
    """
    rows = output[0] if head.in_rows else output[0].T
    first = 5 if head.has_object else 4
    labels = rows[:, first:].argmax(axis=1)
    scores = rows[np.arange(len(rows)), first + labels].astype(float)
    if head.has_object:
        scores *= rows[:, 4]
    kept = (scores >= threshold) & np.isfinite(rows[:, :4]).all(axis=1)
    center, half = rows[kept, 0:2].astype(float), 0.5 * rows[kept, 2:4].astype(float)
    return labels[kept], scores[kept], np.hstack([center - half, center + half])
