"""The projected camera as an element of the loop."""

from typing import Any

import numpy as np

from ortilo_drake.loop.element import Array, Box, Element, Given, Number
from ortilo_drake.model.pinhole import Camera
from ortilo_drake.model.placing import fill, put
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import DETECTIONS_SIZE
from ortilo_drake.scenario import Camera as CameraSettings
from ortilo_drake.scenario.faults import AnyFault
from ortilo_drake.world.faults.scene_faults import scene_at, scene_table
from ortilo_drake.world.faults.table import FaultTable
from ortilo_drake.world.persistent_noise import seeds_of_nodes
from ortilo_drake.world.sensors.camera_tables import Tables
from ortilo_drake.world.sensors.landmark_view import Surroundings, surroundings
from ortilo_drake.world.sensors.projected_camera import (
    body_that_looks_ahead,
    detections_message,
    noise_streams,
    tables_of,
)


def camera_out(
    n: Any,
    k: int,
    seed: int,
    seeds: np.ndarray,
    sent: np.ndarray,
    state: np.ndarray,
    positions: np.ndarray,
    outlines: np.ndarray,
    sizes: np.ndarray,
    boxes: np.ndarray,
    cylinders: np.ndarray,
    labels: np.ndarray,
    streams: np.ndarray,
    found: np.ndarray,
    inside: np.ndarray,
    visible: np.ndarray,
    errors: np.ndarray,
    quantiles: np.ndarray,
    slow: np.ndarray,
    limits: np.ndarray,
    false_classes: np.ndarray,
    false_sizes: np.ndarray,
    fault_kinds: np.ndarray,
    fault_starts: np.ndarray,
    fault_ends: np.ndarray,
    fault_streams: np.ndarray,
    fault_first: np.ndarray,
    fault_values: np.ndarray,
    out: np.ndarray,
) -> None:
    """Say the detections message of the landmarks that are there, in a tick in which it is sent, else zeros."""
    fill(out, 0.0)
    if sent[0] < 0.0:
        return
    time = k * n.h
    room = Surroundings(positions, outlines, sizes, boxes, cylinders)
    faults = FaultTable(fault_kinds, fault_starts, fault_ends, fault_streams, fault_first, fault_values)
    scene = scene_at(room, faults, time)
    camera = Camera(n.p_BC, n.f, n.c, n.image)
    tables = Tables(found, inside, visible, errors, quantiles, slow, limits, false_classes, false_sizes)
    x = state
    if np.any(n.turned):
        x = body_that_looks_ahead(state, n.p_BC, n.turned)
    of_nodes, there = seeds_of_nodes(slow, seeds, k), scene.there
    seen = x, scene.room, labels[there], camera, tables
    put(detections_message(*seen, seed, of_nodes, streams[there], n.false_stream, time, n.h), out)


FAULTS = (
    Array("fault_kinds", kind="i8"),
    Array("fault_starts"),
    Array("fault_ends"),
    Array("fault_streams", kind="u8"),
    Array("fault_first", kind="i8"),
    Array("fault_values"),
)
PROJECTED_CAMERA = Element(
    "projected_camera",
    allocates=True,
    out=camera_out,
    numbers=(
        Number("p_BC", (3,)),
        Number("turned", (3,)),
        Number("f"),
        Number("c", (2,)),
        Number("image", (2,)),
        Number("false_stream", kind="u8"),
        Number("h"),
    ),
    tables=(
        Array("positions", 2),
        Array("outlines", 3),
        Array("sizes", 2),
        Array("boxes", 2),
        Array("cylinders", 2),
        Array("labels", kind="i8"),
        Array("streams", 2, "u8"),
        Array("found", 2),
        Array("inside", 2),
        Array("visible", 2),
        Array("errors", 2),
        Array("quantiles", 2),
        Array("slow", 2),
        Array("limits"),
        Array("false_classes"),
        Array("false_sizes", 2),
        *FAULTS,
    ),
)


def camera_box(settings: CameraSettings, room: Room, faults: tuple[AnyFault, ...], h: float) -> Box:
    """Return the camera with its detector: it reads `sent` (1), not negative where it is sent, and the true state (12).

    Args:
        settings: image width and errors.
        room: landmarks, walls, stands and the camera.
        faults: of the scenario; those of the scene act here.
        h: tick [s].

    Raises:
        InputError: if the file of measured errors is missing or wrong.
    """
    streams, false_stream = noise_streams(room)
    numbers = room.camera.scaled_to(settings.width).constants._asdict()
    numbers |= {"turned": np.zeros(3), "false_stream": false_stream, "h": h}
    tables = surroundings(room)._asdict() | tables_of(settings, room, h)._asdict()
    tables |= {"labels": room.landmark_labels, "streams": streams}
    tables |= {f"fault_{name}": values for name, values in scene_table(faults)._asdict().items()}
    return Box("camera", PROJECTED_CAMERA, DETECTIONS_SIZE, Given(numbers, tables=tables))
