"""Recorded detections: one labelled box in each row, with the landmarks and the camera of the pictures.

The centre of a pixel has integer coordinates; the centre of the first pixel is (0, 0). The camera looks along the x
axis of the body, see model/pinhole.py.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from ortilo_drake.interop.recorded.columns import files_of, read_stream
from ortilo_drake.interop.recorded.rejected import Rejections
from ortilo_drake.interop.recorded.sources import BoxSource
from ortilo_drake.model.inputs.calibration_file import read_calibration
from ortilo_drake.model.pinhole import Camera
from ortilo_drake.model.room import Room, load_room
from ortilo_drake.model.signals import ARRIVED, DETECTION_SIZE, MAX_DETECTIONS, PAYLOAD, STAMP
from ortilo_drake.model.typed_yaml import InputError, validate
from ortilo_drake.scenario.camera import Calibration


class Scene(NamedTuple):
    """The landmarks: p_WL (n, 3) [m], outlines (n, m, 3), classes (n), see model/room.py; and the camera."""

    positions: np.ndarray
    outlines: np.ndarray
    labels: np.ndarray
    camera: Camera


def _scene(folder: Path, source: BoxSource) -> tuple[Room, Scene]:
    room = load_room(files_of(folder, source.room)[0])
    camera = room.camera
    if source.camera is not None:
        path = files_of(folder, source.camera)[0]
        camera = validate(Calibration, read_calibration(path), str(path)).on(camera)
    if source.at is not None:
        camera = camera.model_copy(update={"position": source.at})
    if not room.landmarks:
        raise InputError(f"boxes.room: {source.room}: has no landmarks")
    return room, Scene(room.landmark_positions, room.landmark_outlines, room.landmark_labels, camera.constants)


def read_boxes(folder: Path, source: BoxSource, told: list[Rejections]) -> tuple[np.ndarray, np.ndarray, Scene]:
    """Return the stamps of pictures (k) [s], their detections messages (k, DETECTIONS_SIZE), and the scene.

    Rows with the same stamp belong to one picture. InputError if a file cannot be read, or if no box has a class of the
    room.
    """
    room, scene = _scene(folder, source)
    stream = read_stream(files_of(folder, source.file), source, source.box, "boxes", source.topic, (source.label,))
    told += stream.told
    assert stream.names is not None
    names = stream.names[:, 0]
    of_class = {name.casefold(): k for k, name in enumerate(room.classes)}
    label = np.array([of_class.get(name.strip().casefold(), -1) for name in names])
    unknown = ~np.isin(label, scene.labels)
    if unknown.all():
        said, has = ", ".join(np.unique(names)[:8]), ", ".join(sorted({one.label for one in room.landmarks}))
        raise InputError(f"{stream.rejected.source}: no box is of a class that the room has: {said}, not {has}")
    none = ~np.isfinite(stream.values).all(axis=1)
    empty = ~none & ~(stream.values[:, 2:] > stream.values[:, :2]).all(axis=1)
    stream.rejected.add_rows("boxes of classes that the room has no landmark of", unknown, stream.rows, names)
    stream.rejected.add_rows("boxes with NaN or an empty cell", none & ~unknown, stream.rows)
    stream.rejected.add_rows("boxes without a size", empty & ~unknown, stream.rows)
    good = ~(unknown | none | empty)
    stream, label = stream.only(good), label[good]
    stamps, picture = np.unique(stream.t, return_inverse=True)
    place = np.arange(len(stream.t)) - np.searchsorted(stream.t, stamps)[picture]
    fits = place < MAX_DETECTIONS
    stream.rejected.add_rows(f"boxes beyond the first {MAX_DETECTIONS} of a picture", ~fits, stream.rows)
    rows = np.full((len(stamps), MAX_DETECTIONS, DETECTION_SIZE), -1.0)
    seen = np.column_stack([label, np.ones(len(label)), stream.values])
    rows[picture[fits], place[fits]] = seen[fits]
    head = np.zeros((len(stamps), PAYLOAD))
    head[:, ARRIVED], head[:, STAMP] = 1.0, stamps
    return stamps, np.hstack([head, rows.reshape(len(stamps), -1)]), scene
