"""Boxes in a compiled flight: the camera's message of a tick and the fix that is made of it."""

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.flight.compiled.constants import CameraConstants
from ortilo_drake.flight.compiled.faults import is_read_anyway, of_those, scene_of_tick, spoil
from ortilo_drake.flight.compiled.kept import SensorMemory
from ortilo_drake.flight.compiled.links import delay_through, deliver, step_chain
from ortilo_drake.flight.compiled.slow import seen_by
from ortilo_drake.model.pinhole import Camera
from ortilo_drake.model.placing import fill, put
from ortilo_drake.model.signals import ARRIVED, PAYLOAD, STAMP
from ortilo_drake.onboard.landmarks.box_fix import boxes_to_solve, fix_of, refused_after
from ortilo_drake.onboard.landmarks.cosine_law import cosine_law
from ortilo_drake.onboard.landmarks.known_attitude import pose_from_boxes
from ortilo_drake.world.persistent_noise import seeds_of_nodes
from ortilo_drake.world.radio.link import NOT_SENT
from ortilo_drake.world.sensors.projected_camera import body_that_looks_ahead, detections_message

METHODS = ("known_attitude", "known_tilt", "pose", "cosine_law")  # pnp is OpenCV's


@register_jitable
def solve_boxes(
    by_cosines: bool | None,
    rows: int,
    centers: np.ndarray,
    positions: np.ndarray,
    outlines: np.ndarray,
    xhat: np.ndarray,
    P: np.ndarray,
    camera: Camera,
    sd: np.ndarray,
    max_residual: float,
) -> tuple[bool, np.ndarray, np.ndarray]:
    """Return what a method makes of boxes; the first two arguments are of CameraConstants, the others the method's."""
    if by_cosines is None:
        return pose_from_boxes(centers, positions, outlines, xhat, P, camera, sd, max_residual, rows)
    return cosine_law(centers, positions, outlines, xhat, P, camera, sd, max_residual)


@register_jitable(forceinline=True, error_model="numpy")
def detections_of_tick(
    camera: CameraConstants | None,
    kept: SensorMemory,
    x: np.ndarray,
    k: int,
    h: float,
    seeds: np.ndarray,
    anchors: np.ndarray,
) -> None:
    """Set the detections message that lands at tick k, zeros if none does; arguments as uwb_of_tick's."""
    if camera is None:
        return
    seed, message = seeds[k], kept.message
    fill(message, 0.0)
    delay = delay_through(camera.link, k, x, kept.bad[0], seed)
    if delay != NOT_SENT or is_read_anyway(camera.faults, k * h):
        scene = scene_of_tick(camera.room, camera.scene, k * h)
        streams, false_stream = of_those(camera.streams, camera.scene, scene.there), camera.false_stream
        looks = of_those(camera.labels, camera.scene, scene.there), camera.camera, camera.tables
        seen = seen_by(camera.clock, x, k * h)
        if np.any(camera.turned):
            seen = body_that_looks_ahead(seen, camera.camera.p_BC, camera.turned)
        of_nodes = seeds_of_nodes(camera.tables.slow, seeds, k)
        put(detections_message(seen, scene.room, *looks, seed, of_nodes, streams, false_stream, k * h, h), message)
        spoil(message, camera.faults, kept.held, x, k * h, anchors, seed, h)
    deliver(message, delay, kept.flying, k)


@register_jitable
def fix_of_boxes(
    camera: CameraConstants | None, detections: np.ndarray, xhat: np.ndarray, P: np.ndarray, refused: float
) -> tuple[np.ndarray, float]:
    """Return the fix of the boxes that landed, zeros if there is none, and how many images are refused after it.

    Args:
        camera: the camera.
        detections: the message.
        xhat: estimate that they are looked at with (15).
        P: its covariance row by row (225).
        refused: images before, see LandmarkFix.
    """
    if camera is None:
        return np.zeros(PAYLOAD), refused
    rows = camera.rows
    if detections[ARRIVED] != 1.0:
        return np.zeros(PAYLOAD + rows + rows * rows), refused
    believed = camera.believed
    if camera.prior.size > 0:
        P = camera.prior
    boxes = boxes_to_solve(detections, xhat, P, believed, 2.0**refused)
    found, value, covariance = solve_boxes(
        camera.by_cosines, rows, *boxes[:3], xhat, P, believed.camera, boxes[3], believed.max_residual
    )
    fix = fix_of(found, value, covariance, xhat, detections[STAMP], rows)
    if camera.joint:
        refused = refused_after(refused, fix[ARRIVED] == 1.0, detections, believed)
    return fix, refused


@register_jitable(forceinline=True, error_model="numpy")
def step_camera(camera: CameraConstants | None, kept: SensorMemory, k: int, seed: int) -> None:
    """Go on to the next tick: the chain of the camera's link."""
    if camera is None:
        return
    step_chain(camera.link, k, kept.bad, seed)
