"""The mapping from a network's class names to a room's, and the 80 classes of MS COCO (Lin et al., 2014)."""

from pathlib import Path
from typing import Final

import numpy as np

from ortilo_drake.model.input_files import read_text
from ortilo_drake.model.room import Room
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.detector.detector import Boxes
from ortilo_drake.onboard.detector.yolo_boxes import non_max_suppression

COCO_CLASSES = (
    "person", "bicycle", "car", "motorcycle", "airplane", "bus", "train", "truck", "boat", "traffic light",
    "fire hydrant", "stop sign", "parking meter", "bench", "bird", "cat", "dog", "horse", "sheep", "cow",
    "elephant", "bear", "zebra", "giraffe", "backpack", "umbrella", "handbag", "tie", "suitcase", "frisbee",
    "skis", "snowboard", "sports ball", "kite", "baseball bat", "baseball glove", "skateboard", "surfboard",
    "tennis racket", "bottle", "wine glass", "cup", "fork", "knife", "spoon", "bowl", "banana", "apple",
    "sandwich", "orange", "broccoli", "carrot", "hot dog", "pizza", "donut", "cake", "chair", "couch",
    "potted plant", "bed", "dining table", "toilet", "tv", "laptop", "mouse", "remote", "keyboard",
    "cell phone", "microwave", "oven", "toaster", "sink", "refrigerator", "book", "clock", "vase", "scissors",
    "teddy bear", "hair drier", "toothbrush",
)  # fmt: skip

# The other names of six of these classes in Darknet's own data/coco.names, after PASCAL VOC.
COCO_NAME = {
    "motorbike": "motorcycle",
    "aeroplane": "airplane",
    "sofa": "couch",
    "pottedplant": "potted plant",
    "diningtable": "dining table",
    "tvmonitor": "tv",
}


SHOWN: Final = 8  # number of a network's names that an error lists


def names_in_file(file: Path) -> list[str]:
    """Return the names in a file, one for each line, also for blank ones; blank lines at the end do not count."""
    names = [line.strip() for line in read_text(file).removeprefix("\ufeff").rstrip().split("\n")]
    return [] if names == [""] else names


def room_labels(names: list[str], room: Room, source: str) -> np.ndarray:
    """Return the room's label of each of the network's classes, -1 for a class without a landmark in the room.

    'pottedplant' and 'potted plant' are the same class, whichever of the two files uses which name. `source` is the
    file of the names, for errors. InputError if the network does not know a class of the room's landmarks.
    """
    label_of = {COCO_NAME.get(name, name): label for label, name in enumerate(room.classes)}
    label_of |= {name: label for label, name in enumerate(room.classes)}  # a room may use both names
    labels = [label_of.get(name, label_of.get(COCO_NAME.get(name, name), -1)) for name in names]
    unknown = [name for label, name in enumerate(room.classes) if label not in labels]
    if unknown:
        has = ", ".join(names[:SHOWN]) + (f" and {len(names) - SHOWN} more" if len(names) > SHOWN else "")
        wanted = f"the class '{unknown[0]}' of a landmark of room '{room.name}'"
        raise InputError(f"{source}: does not know {wanted}; knows {has or 'none'}")
    return np.array(labels)


def in_room(found: Boxes, labels_of: np.ndarray, overlap: float, size: tuple[int, int]) -> Boxes:
    """Return the boxes of the room's classes, one for each object, cut at the image's border.

    `found` has classes of the network (k), scores (k) and boxes (k, 4) [px]. Two boxes are one object if their
    intersection over union exceeds `overlap`. `size` is the picture's width and height [px].
    """
    labels, scores, boxes = labels_of[found[0]], found[1], found[2]
    known = (labels >= 0) & (boxes[:, 2:] > boxes[:, :2]).all(axis=1)
    labels, scores, boxes = labels[known], scores[known], boxes[known]
    kept = non_max_suppression(labels, scores, boxes, overlap)
    return labels[kept], scores[kept], np.clip(boxes[kept], -0.5, np.tile(size, 2) - 0.5)
