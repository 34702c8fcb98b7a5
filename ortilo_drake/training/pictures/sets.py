"""The sets of pictures with which the detector is trained and judged."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ortilo_drake.flight.files import write_text
from ortilo_drake.flight.processes.workers import run_all
from ortilo_drake.model.input_files import read_text
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.training.pictures.labels import Frames
from ortilo_drake.training.pictures.shards import is_rendered, load_frames, render_shard
from ortilo_drake.world.scenery.rendering import check_egl

KINDS = ("paper_room", "random_rooms")
SCENES = {"train": {"paper_room": 160, "random_rooms": 480}, "test": {"paper_room": 20, "random_rooms": 40}}
PICTURES = {"train": {"paper_room": 30, "random_rooms": 24}, "test": {"paper_room": 25, "random_rooms": 12}}
SEED_OF = {"train": 0, "test": 1000}  # added to the seed: no test scene is a training scene


def set_folder(folder: Path, part: str, kind: str) -> Path:
    """Return the folder of a set."""
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

    Args:
        folder: folder of all sets.
        part: 'train' or 'test'.
        kind: 'paper_room' or 'random_rooms'.
        seed: of the rooms, looks and poses.
        scenes: number of scenes.
        width: image width [px].
        workers: processes.
        progress: called for each scene.

    Raises:
        InputError: if there is no EGL, a file cannot be written, or the folder holds a set of another seed or width.
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
    """Write the settings of a set into its folder; InputError if it holds a set of other settings."""
    note = target / "set.json"
    text = json.dumps(made_with) + "\n"
    if not note.exists():
        write_text(note, text)
    elif read_text(note) != text:
        raise InputError(
            f"{target}: holds pictures of {read_text(note)[:80].strip()}, not {text.strip()}: take another folder"
        )


def load_set(folder: Path, part: str) -> Frames:
    """Return the pictures of both kinds; InputError if there are none."""
    frames = [load_frames(set_folder(folder, part, kind)) for kind in KINDS]
    return Frames(np.concatenate([f.images for f in frames]), np.concatenate([f.labels for f in frames]))
