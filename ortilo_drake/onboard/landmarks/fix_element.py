"""The landmark fix as an element of the loop."""

from typing import Any

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.loop.element import Array, Box, Element, Given, Number
from ortilo_drake.model.elementary import power_of_two
from ortilo_drake.model.placing import fill, put
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import ARRIVED, N_XBAR, PAYLOAD, STAMP
from ortilo_drake.onboard.landmarks.box_fix import (
    BoxBelief,
    box_belief,
    boxes_to_solve,
    fix_of,
    prior_covariance,
    refused_after,
)
from ortilo_drake.onboard.landmarks.cosine_law import cosine_law
from ortilo_drake.onboard.landmarks.known_attitude import pose_from_boxes
from ortilo_drake.scenario import LandmarkFix as LandmarkFixSettings


@register_jitable
def covariance_of(belief: np.ndarray, prior: np.ndarray) -> np.ndarray:
    """Return P row by row (225), or what stands in for it."""
    if prior.size > 0:
        return prior
    return belief[N_XBAR:]


def boxes_out(
    n: Any,
    message: np.ndarray,
    belief: np.ndarray,
    believed: BoxBelief,
    prior: np.ndarray,
    refused: np.ndarray,
    out: np.ndarray,
) -> None:
    """Say the fix message of pose_from_boxes, of the boxes that landed; zeros if there is none."""
    fill(out, 0.0)
    if message[ARRIVED] != 1.0:
        return
    xhat, P = belief[:N_XBAR], covariance_of(belief, prior)
    boxes = boxes_to_solve(message, xhat, P, believed, power_of_two(int(refused[0])))
    solution = pose_from_boxes(*boxes[:3], xhat, P, believed.camera, boxes[3], believed.max_residual, n.rows)
    put(fix_of(*solution, xhat, message[STAMP], n.rows), out)


def cosines_out(
    n: Any,
    message: np.ndarray,
    belief: np.ndarray,
    believed: BoxBelief,
    prior: np.ndarray,
    refused: np.ndarray,
    out: np.ndarray,
) -> None:
    """Say the fix message of cosine_law, of the boxes that landed; zeros if there is none."""
    fill(out, 0.0)
    if message[ARRIVED] != 1.0:
        return
    xhat, P = belief[:N_XBAR], covariance_of(belief, prior)
    boxes = boxes_to_solve(message, xhat, P, believed, power_of_two(int(refused[0])))
    solution = cosine_law(*boxes[:3], xhat, P, believed.camera, boxes[3], believed.max_residual)
    put(fix_of(*solution, xhat, message[STAMP], n.rows), out)


def refused_step(
    message: np.ndarray,
    believed: BoxBelief,
    refused: np.ndarray,
    out: np.ndarray,
) -> None:
    """Count the images that were refused in a row, where there is a joint test: see refused_after."""
    if believed.limits.size > 0 and message[ARRIVED] == 1.0:
        refused[0] = refused_after(refused[0], out[ARRIVED] == 1.0, message, believed)


FIX_OF_BOXES, FIX_OF_COSINES = (
    Element(
        name,
        allocates=True,
        out=out,
        step=refused_step,
        numbers=(Number("rows", kind="i8"),),
        tables=(Array("prior"),),
        state=(Array("refused"),),
    )
    for name, out in (("fix_of_boxes", boxes_out), ("fix_of_cosines", cosines_out))
)
ELEMENTS = {
    "known_attitude": FIX_OF_BOXES,
    "known_tilt": FIX_OF_BOXES,
    "pose": FIX_OF_BOXES,
    "cosine_law": FIX_OF_COSINES,
}


def camera_fix_box(settings: LandmarkFixSettings, room: Room, width: int) -> Box:
    """Return what makes a fix of boxes: it reads the camera's message and a belief of [x; i] (240).

    Args:
        settings: method and what it believes of the boxes.
        room: landmarks, as they are known, and the camera.
        width: image width [px] that the boxes are in.

    Raises:
        ValueError: if the method is OpenCV's, which is no element.
    """
    element, m = ELEMENTS.get(settings.method), len(settings.rows)
    if element is None:
        raise ValueError(f"landmark_fix.method: {settings.method}: has no compiled form")
    prior = prior_covariance(settings)
    tables = {"prior": np.zeros(0) if prior is None else prior}
    box = Box("camera_fix", element, PAYLOAD + m + m * m, Given({"rows": m}, {"refused": np.zeros(1)}, tables))
    return box.taking(believed=box_belief(settings, room, width))
