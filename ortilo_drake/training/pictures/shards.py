"""Files of rendered pictures, one a scene."""

import io
import logging
from pathlib import Path

import numpy as np

from ortilo_drake.flight.files import write_bytes
from ortilo_drake.model.input_files import exists, open_file
from ortilo_drake.model.npz import arrays_of
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.training.pictures.labels import LABEL_SIZE, MAX_OBJECTS, Frames
from ortilo_drake.training.pictures.renders import render_scene

_LOG = logging.getLogger(__name__)


def render_shard(kind: str, seed: int, scene: int, frames: int, width: int, path: str) -> str:
    """Render one scene to a .npz file, unless it is there undamaged; return its path. Runs in a worker."""
    file = Path(path)
    if not is_rendered(file):
        made = render_scene(kind, seed, scene, frames, width)
        packed = io.BytesIO()
        np.savez(packed, images=made.images, labels=made.labels)
        write_bytes(file, packed.getvalue())
    return path


def is_rendered(path: Path) -> bool:
    """Return whether a scene is there; a warning if it is damaged, of which a ZIP's own checksums tell."""
    try:
        if exists(path):
            _read_shard(path)
            return True
    except InputError as error:
        _LOG.warning("%s: rendered again", error)
    return False


def load_frames(folder: Path) -> Frames:
    """Return all pictures of a rendered set, in the order of the scenes.

    Raises:
        InputError: if there are none or a file is damaged.
    """
    shards = sorted(folder.glob("[0-9]*.npz"))
    if not shards:
        raise InputError(f"{folder}: holds no rendered pictures (ortilo detector render)")
    images: list[np.ndarray] = []
    labels: list[np.ndarray] = []
    for path in shards:
        image, label = _read_shard(path)
        if images and image.shape[1:] != images[0].shape[1:]:
            raise InputError(
                f"{path}: pictures {image.shape}: must be (n, {str(images[0].shape[1:])[1:]} as in the others"
            )
        images.append(image)
        labels.append(label)
    return Frames(np.concatenate(images), np.concatenate(labels))


def _read_shard(path: Path) -> tuple[np.ndarray, np.ndarray]:
    try:
        with open_file(path) as file, arrays_of(file) as shard:
            image, label = shard["images"], shard["labels"]
    except Exception as error:  # zipfile and NumPy raise a dozen kinds for damaged files
        reason = f"{type(error).__name__}: {' '.join(str(error).split())}"[:120]
        raise InputError(f"{path}: not a shard of rendered pictures: {reason}") from None
    if image.dtype != np.uint8 or image.ndim != 4 or image.shape[3] != 3 or 0 in image.shape:
        raise InputError(f"{path}: pictures {image.dtype} {image.shape}: must be uint8 (n, height, width, 3)")
    rows = (len(image), MAX_OBJECTS, LABEL_SIZE)
    if label.dtype != np.float32 or label.shape != rows or not np.isfinite(label).all():
        raise InputError(f"{path}: labels {label.dtype} {label.shape}: must be float32 {rows}, finite")
    return image, label
