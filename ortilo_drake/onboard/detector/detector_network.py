"""The network of the detector: from a picture to boxes of the room's classes."""

import importlib.util
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ortilo_drake.model.input_files import exists, read_text
from ortilo_drake.model.optional import later
from ortilo_drake.model.parts import find_part
from ortilo_drake.model.room import Room
from ortilo_drake.model.typed_yaml import Frozen, InputError
from ortilo_drake.onboard.detector.class_names import COCO_CLASSES, in_room, names_in_file, room_labels
from ortilo_drake.onboard.detector.darknet_cfg import parse_cfg, read_cfg
from ortilo_drake.onboard.detector.darknet_layers import DarknetCfg
from ortilo_drake.onboard.detector.detector import Boxes
from ortilo_drake.onboard.detector.detector import Detector as DetectorSystem
from ortilo_drake.onboard.detector.network_backends import Compute, onnxruntime_network, opencv_network, torch_network
from ortilo_drake.onboard.detector.onnx_detector import load_onnx
from ortilo_drake.onboard.detector.yolo_boxes import decode
from ortilo_drake.scenario import Belief, Detector

cv2 = later("cv2")

WEIGHTS = Path(__file__).with_name("weights")
OWN_CFG, OWN_NETWORK, OWN_ONNX = (WEIGHTS / f"ortilo.{kind}" for kind in ("cfg", "safetensors", "onnx"))
OWN_CLASSES = tuple(OWN_CFG.with_suffix(".names").read_text(encoding="utf-8").splitlines())


def own_backend(backend: str) -> str:
    """Return the given backend, or for 'auto' the fastest one that is installed."""
    if backend == "auto":
        return "onnxruntime" if importlib.util.find_spec("onnxruntime") else "opencv"
    return backend


def class_names(settings: Detector, cfg: DarknetCfg) -> tuple[list[str], str]:
    """Return the class names of the user's network, in the network's order, and the file that they come from.

    As in Darknet each line is a class, also a blank one: the line number is the class number. Blank lines at the end do
    not count. InputError if there are no names, or not as many as the network has classes.
    """
    count = cfg.heads[0].classes
    assert settings.cfg is not None
    file = Path(settings.names) if settings.names else Path(settings.cfg).with_suffix(".names")
    if settings.names is None and not exists(file):
        if count == len(COCO_CLASSES):
            return list(COCO_CLASSES), f"{settings.cfg}, of COCO's {count} classes"
        raise InputError(f"{file}: missing: {settings.cfg} has {count} classes, give their names, one a line")
    names = names_in_file(file)
    if len(names) != count:
        odd = [line for line, name in enumerate(names, start=1) if not name or name[0] == "#"]
        why = f"; line {odd[0]}, {names[odd[0] - 1][:40]!r}, counts as a name, as in Darknet" if odd else ""
        raise InputError(f"{file}: holds {len(names)} names, {settings.cfg} has {count} classes{why}")
    return names, str(file)


def load_detector(settings: Frozen, room: Room, size: tuple[int, int]) -> Callable[[np.ndarray], Boxes]:
    """Return the function from a picture to labels (k), scores (k) and boxes (k, 4) [px].

    A picture is RGB (height, width, 3), uint8; `size` is its width and height [px]. A label is the index of a class of
    the room. Boxes are cut at the image's border. The settings give the network and the thresholds of its boxes, or
    belong to a registered detector. InputError if a file is wrong, or the network does not know a class of the room.
    """
    if not isinstance(settings, Detector):
        return load_own(settings, room, size)
    if settings.onnx is not None:
        return load_onnx(settings, room, size)
    compute: Compute
    if settings.cfg is not None:
        assert settings.weights is not None
        cfg = read_cfg(Path(settings.cfg))
        names, source = class_names(settings, cfg)
        compute = torch_network(Path(settings.weights), cfg)
    else:
        cfg = parse_cfg(read_text(OWN_CFG), str(OWN_CFG))
        names, source = list(OWN_CLASSES), OWN_CFG.with_suffix(".names").name
        match own_backend(settings.backend):
            case "onnxruntime":
                compute = onnxruntime_network(OWN_ONNX)
            case "opencv":
                compute = opencv_network(OWN_ONNX)
            case _:
                compute = torch_network(OWN_NETWORK, cfg)
    labels_of = room_labels(names, room, source)
    anchors = [np.array(head.anchors, dtype=float) for head in cfg.heads]
    scales = [head.scale_x_y for head in cfg.heads]
    input_size = np.array([cfg.net.width, cfg.net.height], dtype=float)
    image_size = np.array(size, dtype=float)
    scale = np.float32(1.0 / 255.0)

    def detect(image: np.ndarray) -> Boxes:
        if (image.shape[1], image.shape[0]) != (cfg.net.width, cfg.net.height):
            image = cv2.resize(image, (cfg.net.width, cfg.net.height), interpolation=cv2.INTER_LINEAR)
        pixels = np.ascontiguousarray(image.transpose(2, 0, 1)[np.newaxis], dtype=np.float32) * scale
        found = decode(compute(pixels), anchors, input_size, image_size, settings.threshold, scales)
        return in_room(found, labels_of, settings.overlap, size)

    return detect


def load_own(settings: Any, room: Room, size: tuple[int, int]) -> Callable[[np.ndarray], Boxes]:
    """Return the function of a registered detector from a picture to labels, scores and boxes, see load_detector.

    The function checks each result and cuts the boxes at the image's border. It raises InputError if a result has a
    wrong shape or a label that is no class of the room.
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


def make_detector(scenario: Belief, room: Room) -> DetectorSystem:
    """Return the detector system for a rendered camera's pictures; InputError if its files are wrong."""
    camera = room.camera.scaled_to(scenario.camera.width)
    size = camera.width, camera.height
    detect = load_detector(scenario.detector, room, size)
    return DetectorSystem(detect, size, scenario.camera.latency, scenario.h)
