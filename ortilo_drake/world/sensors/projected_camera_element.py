"""The projected camera as an element of the loop."""

from typing import Any

import numpy as np

from ortilo_drake.loop.element import Array, Box, Element, Number, Values
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
    room: Surroundings,
    camera: Camera,
    tables: Tables,
    faults: FaultTable,
    labels: np.ndarray,
    streams: np.ndarray,
    out: np.ndarray,
) -> None:
    """Output the detections message of the landmarks that are there, in a tick in which it is sent, else zeros."""
    fill(out, 0.0)
    if sent[0] < 0.0:
        return
    time = k * n.h
    scene = scene_at(room, faults, time)
    x = state
    if np.any(n.turned):
        x = body_that_looks_ahead(state, camera.p_BC, n.turned)
    of_nodes, there = seeds_of_nodes(tables.slow, seeds, k), scene.there
    seen = x, scene.room, labels[there], camera, tables
    put(detections_message(*seen, seed, of_nodes, streams[there], n.false_stream, time, n.h), out)


PROJECTED_CAMERA = Element(
    "projected_camera",
    out=camera_out,
    numbers=(Number("turned", (3,)), Number("false_stream", kind="u8"), Number("h")),
    tables=(Array("labels", kind="i8"), Array("streams", 2, "u8")),
    allocates=True,
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
    numbers = {"turned": np.zeros(3), "false_stream": false_stream, "h": h}
    given = Values(numbers, tables={"labels": room.landmark_labels, "streams": streams})
    return Box("camera", PROJECTED_CAMERA, DETECTIONS_SIZE, given).with_groups(
        room=surroundings(room),
        camera=room.camera.scaled_to(settings.width).constants,
        tables=tables_of(settings, room, h),
        faults=scene_table(faults),
    )
