"""The sets of pictures for training and tests of the detector, in files with one scene each."""

import io
import json
import logging
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ortilo_drake.flight.files import write_bytes, write_text
from ortilo_drake.flight.processes.workers import run_all
from ortilo_drake.model.input_files import arrays_of, exists, open_file, read_text
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.training.pictures.labels import LABEL_SIZE, MAX_OBJECTS, Frames
from ortilo_drake.training.pictures.renders import render_scene
from ortilo_drake.world.scenery.rendering import check_egl

KINDS = ("paper_room", "random_rooms")
SCENES = {"train": {"paper_room": 160, "random_rooms": 480}, "test": {"paper_room": 20, "random_rooms": 40}}
PICTURES = {"train": {"paper_room": 30, "random_rooms": 24}, "test": {"paper_room": 25, "random_rooms": 12}}
SEED_OF = {"train": 0, "test": 1000}  # added to the seed: no test scene is a training scene


def set_folder(folder: Path, part: str, kind: str) -> Path:
    """Return the folder of a set, given the folder of all sets, the part and the kind."""
    return folder / part / kind


def render_set(
    folder: Path,
    part: str,
    kind: str,
    seed: int,
    scenes: int,
    width: int,
    workers: int,
    progress: Callable[[], None] = lambda: None,
) -> None:
    """Render the missing scenes of a set; the result does not depend on the number of workers.

    `folder` is the folder of all sets, `part` is 'train' or 'test', `kind` is 'paper_room' or 'random_rooms'. The set
    has `scenes` scenes with an image width [px]; the seed decides rooms, looks and poses. `progress` is called for each
    scene. InputError if there is no EGL, a file cannot be written, or the folder's set has another seed or width.
    """
    target = set_folder(folder, part, kind)
    pictures = PICTURES[part][kind]
    _claim(target, {"seed": seed, "width": width, "pictures": pictures})
    jobs = [
        (kind, seed + SEED_OF[part], scene, pictures, width, str(target / f"{scene:05d}.npz"))
        for scene in range(scenes)
    ]
    missing = [job for job in jobs if not is_rendered(Path(job[-1]))]
    if missing:
        check_egl()
    for _ in range(len(jobs) - len(missing)):
        progress()
    run_all(render_shard, missing, workers, lambda number, result: progress())


def _claim(target: Path, made_with: dict[str, int]) -> None:
    """Write the settings of a set into its folder; InputError if the folder holds a set with other settings."""
    note = target / "set.json"
    text = json.dumps(made_with) + "\n"
    if not note.exists():
        write_text(note, text)
    elif (there := read_text(note)) != text:
        raise InputError(f"{target}: holds pictures of {there[:80].strip()}, not {text.strip()}: take another folder")


def load_set(folder: Path, part: str) -> Frames:
    """Return the pictures of both kinds in a part; errors as in load_frames."""
    frames = [load_frames(set_folder(folder, part, kind)) for kind in KINDS]
    return Frames(np.concatenate([f.images for f in frames]), np.concatenate([f.labels for f in frames]))


_LOG = logging.getLogger(__name__)


def render_shard(kind: str, seed: int, scene: int, frames: int, width: int, path: str) -> str:
    """Render one scene to a .npz file, unless an undamaged file exists; return the path. Runs in a worker."""
    file = Path(path)
    if not is_rendered(file):
        made = render_scene(kind, seed, scene, frames, width)
        packed = io.BytesIO()
        np.savez(packed, images=made.images, labels=made.labels)
        write_bytes(file, packed.getvalue())
    return path


def is_rendered(path: Path) -> bool:
    """Return whether the file of a scene exists and is undamaged (by the ZIP's checksums); warn if it is damaged."""
    try:
        if exists(path):
            _read_shard(path)
            return True
    except InputError as error:
        _LOG.warning("%s: rendered again", error)
    return False


def load_frames(folder: Path) -> Frames:
    """Return all pictures of a rendered set, in the order of the scenes.

    InputError if there are none, a file is damaged, or the pictures have different sizes.
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
    except Exception as error:  # zipfile and NumPy raise a dozen kinds of errors for damaged files
        reason = f"{type(error).__name__}: {' '.join(str(error).split())}"[:120]
        raise InputError(f"{path}: not a shard of rendered pictures: {reason}") from None
    if image.dtype != np.uint8 or image.ndim != 4 or image.shape[3] != 3 or 0 in image.shape:
        raise InputError(f"{path}: pictures {image.dtype} {image.shape}: must be uint8 (n, height, width, 3)")
    rows = (len(image), MAX_OBJECTS, LABEL_SIZE)
    if label.dtype != np.float32 or label.shape != rows or not np.isfinite(label).all():
        raise InputError(f"{path}: labels {label.dtype} {label.shape}: must be float32 {rows}, finite")
    return image, label
