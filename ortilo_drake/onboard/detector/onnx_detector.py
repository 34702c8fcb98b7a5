"""A detector of an ONNX file: YOLOv5, v8 or v11 as Ultralytics exports them, computed by onnxruntime on one core.

The network has grids with strides 8, 16 and 32 (or more). Each place of a grid gives a box by its centre and size in
pixels of the input, and scores between 0 and 1:

    YOLOv5        (1, 3 n, 5 + c)   x, y, w, h, object, class 1 ... c   score = object * class
    YOLOv8, v11   (1, 4 + c, n)     x, y, w, h, class 1 ... c           score = class

with n the number of cells of all grids. These numbers distinguish the two formats. Either format may be transposed if
the file has class names, which give c.
"""

import ast
from collections.abc import Callable, Mapping, Sequence
from itertools import combinations
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from ortilo_drake.model.optional import later
from ortilo_drake.model.room import Room
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.detector.class_names import COCO_CLASSES, in_room, names_in_file, room_labels
from ortilo_drake.onboard.detector.detector import Boxes
from ortilo_drake.onboard.detector.foreign_file import check_onnx_file
from ortilo_drake.onboard.detector.network_backends import onnxruntime_session
from ortilo_drake.scenario import Detector

STRIDES = (4, 8, 16, 32, 64)
ANCHORS = 3  # number of anchors in a cell of YOLOv5
MOST_CLASSES = 10_000
_TASKS = {"segment": "-seg", "pose": "-pose", "classify": "-cls", "obb": "-obb"}
_WANTED = "must be a detection network of YOLOv5, v8 or v11"


class Head(NamedTuple):
    """The format of a network's boxes."""

    classes: int
    """number of classes c."""
    has_object: bool
    """whether a place has an object score beside the scores of its classes, as in YOLOv5."""
    in_rows: bool
    """whether a place is a row of the output; otherwise it is a column."""


def names_in(metadata: Mapping[str, str], source: str) -> list[str] | None:
    """Return the class names in a file's metadata, None if it has none.

    InputError if they are neither a list of names nor names numbered from 0.
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
    """Return the format of a network's boxes, found by the shapes of its outputs, for an input of this size [px].

    `names` are the classes, None if unknown; `source` is the file, for errors. InputError if the network is not a
    detection network of YOLOv5, v8 or v11, or does not have as many classes as names.
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
    # Corners, score and class of boxes after suppression, as from YOLOv10 or with nms=True.
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
    """Return classes (k), scores (k) and corners (k, 4) [px of the input] of the places with a score >= `threshold`.

    A place gives only its best class. `output` is the network's first output, for one picture.
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


cv2 = later("cv2")

GREY = 114  # grey value of the borders


class Letterbox(NamedTuple):
    """The place of a picture in a network's input: in the middle, with its aspect ratio kept, between grey borders.

    Same as the LetterBox of Ultralytics' YOLOv5, v8 and v11: the picture is scaled by r = min(W / w, H / h), rounded to
    whole pixels, and put in the middle of the input (W, H).
    """

    picture: tuple[int, int]
    """width and height of the picture [px]."""
    scaled: tuple[int, int]
    """width and height of the picture in the input [px]."""
    corner: tuple[int, int]
    """left and top of the picture in the input [px]."""
    whole: tuple[int, int]
    """width and height of the input [px]."""

    def put(self, image: np.ndarray) -> np.ndarray:
        """Return the network's input (H, W, 3), uint8, with an image (h, w, 3) in it."""
        if self.scaled != self.picture:
            image = cv2.resize(image, self.scaled, interpolation=cv2.INTER_LINEAR)
        (left, top), (width, height) = self.corner, self.scaled
        whole = np.full((self.whole[1], self.whole[0], 3), GREY, dtype=np.uint8)
        whole[top : top + height, left : left + width] = image
        return whole

    def back(self, corners: np.ndarray) -> np.ndarray:
        """Return boxes (k, 4) of the input in coordinates of the picture, u_min, v_min, u_max, v_max [px].

        The input's coordinates start at its corner, the picture's at the centre of its first pixel. Each direction is
        rounded to whole pixels separately, so each has its own scale.
        """
        scale = np.array(self.picture, dtype=float) / self.scaled
        return (corners - np.tile(self.corner, 2)) * np.tile(scale, 2) - 0.5


def letterbox(picture: tuple[int, int], whole: tuple[int, int]) -> Letterbox:
    """Return the place of a picture in a network's input, both given by width and height [px]."""
    r = min(whole[0] / picture[0], whole[1] / picture[1])
    scaled = max(round(picture[0] * r), 1), max(round(picture[1] * r), 1)
    # If the border is odd, the extra pixel is on the right or below.
    corner = (whole[0] - scaled[0]) // 2, (whole[1] - scaled[1]) // 2
    return Letterbox(picture, scaled, corner, whole)


_USUAL: Final = 640  # width and height of an input for which the file gives none
_LARGEST: Final = 4096  # largest width and height of an input [px]
_KINDS: Final = {"tensor(float)": np.float32, "tensor(float16)": np.float16}
_RELATIVE: Final = 2.0  # [px]; the largest coordinate of boxes in pixels is far above this number
_PROBABLE: Final = 1e-3  # amount by which rounding may bring a score outside 0 to 1


def _input_size(shape: list[Any], metadata: dict[str, str], source: str) -> tuple[int, int]:
    """Return width and height of a network's input [px]; if the file leaves them open, its imgsz, or 640."""
    if len(shape) != 4:
        raise InputError(f"{source}: its input has {len(shape)} dimensions, must be (1, 3, height, width)")
    batch, channels, height, width = shape
    if isinstance(batch, int) and batch != 1:
        raise InputError(f"{source}: its input is of {batch} pictures at once, must be of 1: write it with batch=1")
    if isinstance(channels, int) and channels != 3:
        raise InputError(f"{source}: its input has {channels} channels, must have 3: red, green, blue")
    try:
        said = ast.literal_eval(metadata.get("imgsz", f"[{_USUAL}, {_USUAL}]")[:100])
        open_height, open_width = (int(side) for side in said)
    except (ValueError, SyntaxError, TypeError, OverflowError, MemoryError, RecursionError):
        raise InputError(f"{source}: metadata 'imgsz': {metadata['imgsz'][:60]!r}: must be [height, width]") from None
    size = width if isinstance(width, int) else open_width, height if isinstance(height, int) else open_height
    if not all(32 <= side <= _LARGEST for side in size):
        raise InputError(f"{source}: its input is {size[0]} x {size[1]} px, must be 32 to {_LARGEST} each")
    return size


def load_onnx(settings: Detector, room: Room, size: tuple[int, int]) -> Callable[[np.ndarray], Boxes]:
    """Return the function of an ONNX network from a picture to labels, scores and boxes, see load_detector.

    InputError if onnxruntime is not installed, the file is wrong, or a class of the room is not among its names.
    """
    assert settings.onnx is not None
    source = settings.onnx
    check_onnx_file(Path(source))
    session = onnxruntime_session(Path(source))
    metadata = dict(session.get_modelmeta().custom_metadata_map)
    if len(session.get_inputs()) != 1:
        raise InputError(f"{source}: has {len(session.get_inputs())} inputs, must have one, the picture")
    (its,) = session.get_inputs()
    if its.type not in _KINDS:
        raise InputError(
            f"{source}: its input is of {its.type}, must be of float or float16 (write it with int8=False)"
        )
    whole = _input_size(list(its.shape), metadata, source)

    def outputs_of(picture: np.ndarray) -> list[np.ndarray]:
        pixels = np.ascontiguousarray(picture.transpose(2, 0, 1)[np.newaxis], dtype=np.float32) * np.float32(1.0 / 255)
        return session.run(None, {its.name: pixels.astype(_KINDS[its.type], copy=False)})

    try:
        outputs = outputs_of(np.full((whole[1], whole[0], 3), GREY, dtype=np.uint8))
    except Exception as error:  # onnxruntime has no base class for its errors
        raise InputError(f"{source}: cannot be computed: {' '.join(str(error).split())[:160]}") from None
    names, named_by = names_in(metadata, source), f"{source}: metadata 'names'"
    if settings.names is not None:
        names, named_by = names_in_file(Path(settings.names)), settings.names
    head = head_of([output.shape for output in outputs], whole, metadata, names, source)
    if names is None:
        if head.classes != len(COCO_CLASSES):
            raise InputError(
                f"{source}: has {head.classes} classes and no names: give them, one a line, detector.names"
            )
        names, named_by = list(COCO_CLASSES), f"{source}, of COCO's {head.classes} classes"
    if not np.isfinite(outputs[0]).all():
        raise InputError(f"{source}: gives NaN or infinity for a grey picture, where it must give numbers")
    _, scores, corners = boxes_in(outputs[0], head, -np.inf)
    if corners.max() <= _RELATIVE:  # each place's box is near the place, so boxes in pixels extend over the whole input
        raise InputError(f"{source}: its boxes are shares of the picture, up to {corners.max():.3g}: must be in pixels")
    if not np.all((scores >= -_PROBABLE) & (scores <= 1.0 + _PROBABLE)):
        raise InputError(f"{source}: scores from {scores.min():.3g} to {scores.max():.3g}: must be between 0 and 1")
    labels_of = room_labels(names, room, named_by)
    lies = letterbox(size, whole)

    def detect(image: np.ndarray) -> Boxes:
        labels, scores, corners = boxes_in(outputs_of(lies.put(image))[0], head, settings.threshold)
        return in_room((labels, scores, lies.back(corners)), labels_of, settings.overlap, size)

    return detect
