"""A landmark camera without an image: boxes as a detector would return them for the rendered picture.

It draws them from the measured rates and errors (camera_calibration.py) or from a few given numbers.
"""

import math
from typing import Any

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.loop.element import Box, Element, Values
from ortilo_drake.model.clock import tick_of
from ortilo_drake.model.equations import rotation_matrix
from ortilo_drake.model.pinhole import Camera
from ortilo_drake.model.placing import fill, put
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import DETECTION_SIZE, DETECTIONS_SIZE, MAX_DETECTIONS, PAYLOAD
from ortilo_drake.scenario import Camera as CameraSettings
from ortilo_drake.scenario.faults import AnyFault
from ortilo_drake.world.faults.table import FaultTable, scene_at, scene_table
from ortilo_drake.world.noise import persistent_normals, seeds_of_nodes, stream_id, uniforms
from ortilo_drake.world.sensors.camera_tables import Tables, look_up, tables_of
from ortilo_drake.world.sensors.landmark_view import Surroundings, cut, surroundings, view_box, visible_share

_MAX_FALSE = 16  # a Poisson number of mean 5, the largest mean allowed, exceeds it once in 70,000 images
STREAMS = ("camera misses", "camera misses, slow", "camera errors", "camera errors, slow")


@register_jitable
def _write_row(message: np.ndarray, row: int, label: float, score: float, box: np.ndarray) -> None:
    start = PAYLOAD + row * DETECTION_SIZE
    message[start], message[start + 1] = label, score
    put(box, message, start + 2)


@cached_njit
def poisson(u: float, mean: float, largest: int) -> int:
    """Return the Poisson number of this mean for u in [0, 1), by inversion; at most `largest`."""
    term = np.exp(-mean)
    total, k = term, 0
    while u >= total and k < largest:
        k += 1
        term *= mean / k
        total += term
    return k


@cached_njit
def detections_message(
    x: np.ndarray,
    room: Surroundings,
    labels: np.ndarray,
    camera: Camera,
    tables: Tables,
    seed: int,
    of_nodes: np.ndarray,
    streams: np.ndarray,
    false_stream: np.uint64,
    time: float,
    h: float,
) -> np.ndarray:
    """Return the detections message at state x: the landmarks found, in the map's order, then false boxes.

    room holds the landmarks and the obstacles, `labels` (n) the landmarks' classes. `seed` is that of the tick's noise;
    of_nodes (2, 2) holds the seeds of the nodes before and after, of errors and of misses, see persistent_normals.
    streams (n, 4) are each landmark's STREAMS, so its noise is the same whatever else is seen. The time is t_k [s].
    """
    message = np.zeros(DETECTIONS_SIZE)
    message[0], message[1] = 1.0, time
    message[PAYLOAD::DETECTION_SIZE] = -1.0
    tick, image, row = tick_of(time, h), camera.image, 0
    p_WB, R_WB = x[0:3], rotation_matrix(x[3:6])
    p_WC = p_WB + R_WB @ camera.p_BC
    box, whole = np.empty(4), np.empty(4)
    for i in range(labels.size):
        distance, inside = view_box(i, p_WB, R_WB, room, camera, tables.limits, whole)
        if inside == 0.0 or row == MAX_DETECTIONS:
            continue
        rate = look_up(tables.found, 1 + int(labels[i]), distance) * look_up(tables.inside, 1, inside)
        if rate == 0.0:
            continue
        share, spacing = tables.slow[1, 0], int(tables.slow[1, 1])
        z_miss = persistent_normals(seed, of_nodes[1], streams[i, 0], streams[i, 1], tick, share, spacing)[0]
        chance = 0.5 * math.erfc(-z_miss / math.sqrt(2.0))
        if chance >= rate:
            continue
        visible = visible_share(p_WC, i, room)
        rate *= look_up(tables.visible, 1, visible)
        if chance >= rate or visible < tables.limits[2]:
            continue
        share, spacing = tables.slow[0, 0], int(tables.slow[0, 1])
        z = persistent_normals(seed, of_nodes[0], streams[i, 2], streams[i, 3], tick, share, spacing)
        at_border = look_up(tables.inside, 3, inside)
        growth = look_up(tables.visible, 2, visible) * look_up(tables.inside, 2, inside)
        for axis in range(2):
            low, high = cut(whole[axis], image[axis]), cut(whole[2 + axis], image[axis])
            center = growth * look_up(tables.errors, 1, high - low) * look_up(tables.quantiles, 1 + axis, z[axis])
            extent = growth * look_up(tables.errors, 2, high - low) * look_up(tables.quantiles, 3 + axis, z[2 + axis])
            for side, edge, error in ((0, low, center - 0.5 * extent), (2, high, center + 0.5 * extent)):
                # An edge at the border has errors of its own.
                factor = 1.0 if edge == whole[side + axis] else at_border
                box[side + axis] = cut(edge + factor * error, image[axis])
        if box[0] < box[2] and box[1] < box[3]:
            _write_row(message, row, labels[i], 1.0 - 0.5 * chance / rate, box)
            row += 1
    n_false = poisson(uniforms(seed, false_stream, tick, 1)[0], tables.false_classes[0], _MAX_FALSE)
    if n_false > 0:
        u = uniforms(seed, false_stream, tick, 1 + 6 * n_false)[1:].reshape((n_false, 6))
        for k in range(min(n_false, MAX_DETECTIONS - row)):
            for axis in range(2):
                center = u[k, 1 + axis] * image[axis] - 0.5
                half = 0.5 * look_up(tables.false_sizes, 1 + axis, u[k, 3 + axis])
                box[axis], box[2 + axis] = cut(center - half, image[axis]), cut(center + half, image[axis])
            label = np.searchsorted(tables.false_classes[1:-1], u[k, 0], side="right")
            _write_row(message, row, float(label), 0.25 + 0.5 * u[k, 5], box)
            row += 1
    return message


@cached_njit
def body_that_looks_ahead(x: np.ndarray, p_BC: np.ndarray, rpy: np.ndarray) -> np.ndarray:
    """Return the state (12) of a body whose camera, at the same p_BC, looks ahead as this body's turned camera does.

    The turned camera is rotated from looking ahead by rpy (3) [rad] about its own centre.
    """
    R_WB = rotation_matrix(x[3:6])
    R_WA = R_WB @ rotation_matrix(rpy)
    ahead = x.copy()
    moved = (R_WB - R_WA) @ p_BC
    for i in range(3):
        ahead[i] += moved[i]
    ahead[3] = np.arctan2(R_WA[2, 1], R_WA[2, 2])
    ahead[4] = np.arctan2(-R_WA[2, 0], np.sqrt(R_WA[0, 0] ** 2 + R_WA[1, 0] ** 2))
    ahead[5] = np.arctan2(R_WA[1, 0], R_WA[0, 0])
    return ahead


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
    """Output the detections message of the present landmarks, in a tick in which it is sent, else zeros."""
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


PROJECTED_CAMERA = Element("projected_camera", out=camera_out, allocates=True)


def camera_box(settings: CameraSettings, room: Room, faults: tuple[AnyFault, ...], h: float) -> Box:
    """Return the camera with its detector: it reads `sent` (1), not negative where it is sent, and the true state (12).

    It applies the scenario's faults of the scene. InputError if the file of measured errors is missing or wrong.
    """
    streams = [[stream_id(f"{name} {i}") for name in STREAMS] for i in range(len(room.landmarks))]
    numbers = {"turned": np.zeros(3), "false_stream": stream_id("camera false boxes"), "h": h}
    tables = {"streams": np.array(streams, dtype=np.uint64).reshape(-1, len(STREAMS))}
    given = Values(numbers, tables=tables | {"labels": room.landmark_labels.astype(np.int64)})
    return Box("camera", PROJECTED_CAMERA, DETECTIONS_SIZE, given).with_groups(
        room=surroundings(room),
        camera=room.camera.scaled_to(settings.width).constants,
        tables=tables_of(settings, room, h),
        faults=scene_table(faults),
    )
