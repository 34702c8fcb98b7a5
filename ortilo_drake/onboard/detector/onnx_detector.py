"""A detector of an ONNX file: YOLOv5, v8 or v11 as Ultralytics exports them, computed by onnxruntime on one core."""

import ast
from collections.abc import Callable
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
from ortilo_drake.onboard.detector.onnx_head import boxes_in, head_of, names_in
from ortilo_drake.scenario import Detector

cv2 = later("cv2")

GREY = 114  # of the borders


class Letterbox(NamedTuple):
    """The place of a picture in a network's input: in the middle, its shape kept, grey beside it.

    As Ultralytics' YOLOv5, v8 and v11 see a picture (their LetterBox): scaled by r = min(W / w, H / h), rounded to
    whole pixels, and put in the middle of the input (W, H).
    """

    picture: tuple[int, int]
    """width and height of the picture [px]."""
    scaled: tuple[int, int]
    """width and height of it in the input [px]."""
    corner: tuple[int, int]
    """left and top of it in the input [px]."""
    whole: tuple[int, int]
    """width and height of the input [px]."""

    def put(self, image: np.ndarray) -> np.ndarray:
        """Return the network's input (H, W, 3) with an image (h, w, 3) in it, uint8."""
        if self.scaled != self.picture:
            image = cv2.resize(image, self.scaled, interpolation=cv2.INTER_LINEAR)
        (left, top), (width, height) = self.corner, self.scaled
        whole = np.full((self.whole[1], self.whole[0], 3), GREY, dtype=np.uint8)
        whole[top : top + height, left : left + width] = image
        return whole

    def back(self, corners: np.ndarray) -> np.ndarray:
        """Return boxes (k, 4) of the input as they lie in the picture, u_min, v_min, u_max, v_max [px].

        The input's coordinates count from its corner, the picture's from the centre of its first pixel. The picture is
        rounded to whole pixels in each direction by itself, so each has its own scale.
        """
        scale = np.array(self.picture, dtype=float) / self.scaled
        return (corners - np.tile(self.corner, 2)) * np.tile(scale, 2) - 0.5


def letterbox(picture: tuple[int, int], whole: tuple[int, int]) -> Letterbox:
    """Return the place of a picture in a network's input, both given by width and height [px]."""
    r = min(whole[0] / picture[0], whole[1] / picture[1])
    scaled = max(round(picture[0] * r), 1), max(round(picture[1] * r), 1)
    # An odd rest goes to the right and below.
    corner = (whole[0] - scaled[0]) // 2, (whole[1] - scaled[1]) // 2
    return Letterbox(picture, scaled, corner, whole)


_USUAL: Final = 640  # width and height of an input that leaves them open and does not say them
_LARGEST: Final = 4096  # [px]
_KINDS: Final = {"tensor(float)": np.float32, "tensor(float16)": np.float16}
_RELATIVE: Final = 2.0  # [px]; in pixels the largest of all boxes' coordinates is far above it
_PROBABLE: Final = 1e-3  # a score may leave 0 to 1 by rounding


def _input_size(shape: list[Any], metadata: dict[str, str], source: str) -> tuple[int, int]:
    """Return width and height of a network's input [px]; where the file leaves them open, its imgsz, or 640."""
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
    """Return the function from a picture to labels (k), scores (k) and boxes (k, 4) [px]; see load_detector.

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
    if corners.max() <= _RELATIVE:  # a place's box is near it, so those of an input reach across it
        raise InputError(f"{source}: its boxes are shares of the picture, up to {corners.max():.3g}: must be in pixels")
    if not np.all((scores >= -_PROBABLE) & (scores <= 1.0 + _PROBABLE)):
        raise InputError(f"{source}: scores from {scores.min():.3g} to {scores.max():.3g}: must be between 0 and 1")
    labels_of = room_labels(names, room, named_by)
    lies = letterbox(size, whole)

    def detect(image: np.ndarray) -> Boxes:
        labels, scores, corners = boxes_in(outputs_of(lies.put(image))[0], head, settings.threshold)
        return in_room((labels, scores, lies.back(corners)), labels_of, settings.overlap, size)

    return detect
