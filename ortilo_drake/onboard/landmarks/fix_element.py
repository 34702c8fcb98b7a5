"""The landmark fix as an element of the loop."""

from typing import Any

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.loop.element import Box, Element, Values
from ortilo_drake.model.elementary import power_of_two
from ortilo_drake.model.placing import fill, put
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import ARRIVED, N_XBAR, PAYLOAD, STAMP
from ortilo_drake.onboard.landmarks.box_fix import (
    BoxBelief,
    box_belief,
    box_fix_message,
    boxes_to_solve,
    prior_covariance,
    refused_after,
)
from ortilo_drake.onboard.landmarks.cosine_law import cosine_law
from ortilo_drake.onboard.landmarks.known_attitude import pose_from_boxes
from ortilo_drake.onboard.landmarks.landmark_bank import (
    PER_LANDMARK,
    Solved,
    learn,
    put_information,
    put_lasting,
)
from ortilo_drake.onboard.ranging.bank_element import NOTHING_YET, SCALE
from ortilo_drake.onboard.ranging.lasting_error import KEPT, LASTING, N_KEPT, N_LASTING, SHARE, keep
from ortilo_drake.onboard.ranging.survey_bank import kept_from, learned_first
from ortilo_drake.scenario import LandmarkFix as LandmarkFixSettings


@register_jitable
def covariance_of(belief: np.ndarray, prior: np.ndarray) -> np.ndarray:
    """Return P row by row (225) of the belief, or the prior covariance if there is one."""
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
    """Output the fix message of pose_from_boxes for the boxes that arrived; zeros if there is no fix."""
    fill(out, 0.0)
    if message[ARRIVED] != 1.0:
        return
    xhat, P = belief[:N_XBAR], covariance_of(belief, prior)
    boxes = boxes_to_solve(message, xhat, P, believed, power_of_two(int(refused[0])))
    solution = pose_from_boxes(*boxes[:3], xhat, P, believed.camera, boxes[3], believed.max_residual, n.rows)
    put(box_fix_message(*solution[:3], xhat, message[STAMP], n.rows), out)


def cosines_out(
    n: Any,
    message: np.ndarray,
    belief: np.ndarray,
    believed: BoxBelief,
    prior: np.ndarray,
    refused: np.ndarray,
    out: np.ndarray,
) -> None:
    """Output the fix message of cosine_law for the boxes that arrived; zeros if there is no fix."""
    fill(out, 0.0)
    if message[ARRIVED] != 1.0:
        return
    xhat, P = belief[:N_XBAR], covariance_of(belief, prior)
    boxes = boxes_to_solve(message, xhat, P, believed, power_of_two(int(refused[0])))
    solution = cosine_law(*boxes[:3], xhat, P, believed.camera, boxes[3], believed.max_residual)
    put(box_fix_message(*solution, xhat, message[STAMP], n.rows), out)


def learning_out(
    n: Any,
    message: np.ndarray,
    belief: np.ndarray,
    believed: BoxBelief,
    prior: np.ndarray,
    refused: np.ndarray,
    learned: np.ndarray,
    scale: np.ndarray,
    out: np.ndarray,
) -> None:
    """Output the fix message with the learned noise, its lasting error (6), and its information for the bank.

    The information is [Lambda_i, eta_i] (12 n), the sensitivities (9 n), the number of residuals and the sum of their
    squares; all are scaled to the noise of the settings. Without a fix, the lasting error is the one of the last fix,
    kept in full.
    """
    fill(out, 0.0)
    size, n_told = PAYLOAD + 42, PER_LANDMARK * believed.positions.shape[0]
    put(learned[LASTING:KEPT], out, size)
    put((1.0, 1.0, 1.0), out, size + N_KEPT)
    if message[ARRIVED] != 1.0:
        return
    now = with_share(believed, learned[SHARE], np.sqrt(scale[SCALE]))
    xhat, P = belief[:N_XBAR], covariance_of(belief, prior)
    boxes = boxes_to_solve(message, xhat, P, now, power_of_two(int(refused[0])))
    solution = pose_from_boxes(*boxes[:3], xhat, P, now.camera, boxes[3], now.max_residual, 6)
    fix = box_fix_message(*solution[:3], xhat, message[STAMP], 6)
    if fix[ARRIVED] != 1.0:
        return
    put(fix, out)
    told, here = out[size + N_LASTING :][:n_told], out[size + N_LASTING + n_told : out.size - 2]
    solved = Solved(boxes[0][solution[3]], boxes[4][solution[3]], solution[1])
    residuals, squares = put_information(told, here, solved, now)
    put_lasting(out[size : size + N_LASTING], now.survey_sd, here, learned)
    for i in range(n_told):
        told[i] *= scale[SCALE]
    out[out.size - 2], out[out.size - 1] = residuals, squares * scale[SCALE]


@register_jitable
def with_share(believed: BoxBelief, share: float, scale: float) -> BoxBelief:
    """Return the model of boxes with the survey's sd times `share` and the noise sd times `scale`."""
    return BoxBelief(
        believed.positions,
        believed.outlines,
        believed.labels,
        believed.camera,
        scale * believed.sd,
        believed.gate,
        believed.max_residual,
        believed.growth,
        believed.margin,
        believed.limits,
        believed.inside,
        share * believed.survey_sd,
    )


@register_jitable
def refused_step(message: np.ndarray, believed: BoxBelief, refused: np.ndarray, out: np.ndarray) -> None:
    """Update the number of refused images if there is a joint test, see refused_after."""
    if believed.limits.size > 0 and message[ARRIVED] == 1.0:
        refused[0] = refused_after(refused[0], out[ARRIVED] == 1.0, message, believed)


def learning_step(
    n: Any,
    message: np.ndarray,
    believed: BoxBelief,
    bank: np.ndarray,
    refused: np.ndarray,
    learned: np.ndarray,
    gathered: np.ndarray,
    scale: np.ndarray,
    Q: np.ndarray,
    S: np.ndarray,
    e: np.ndarray,
    out: np.ndarray,
) -> None:
    """Do refused_step, and update survey and noise of the boxes with this tick's fix, if there is one."""
    refused_step(message, believed, refused, out)
    if message[ARRIVED] == 1.0 and out[ARRIVED] == 1.0:
        at, n_told, end = PAYLOAD + 42, PER_LANDMARK * believed.positions.shape[0], out.size - 2
        told = out[at + N_LASTING : at + N_LASTING + n_told]
        learn(learned, gathered, scale, told, out[end:], n.keeps, n.worth, bank, believed.survey_sd, Q, S, e)
        keep(learned, out[at : at + N_LASTING], out[at + N_LASTING + n_told : end])


FIX_OF_BOXES = Element("fix_of_boxes", out=boxes_out, step=refused_step, allocates=True)
FIX_OF_COSINES = Element("fix_of_cosines", out=cosines_out, step=refused_step, allocates=True)
LEARNING = Element("learning_fix_of_boxes", out=learning_out, step=learning_step, allocates=True)
ELEMENTS = dict.fromkeys(("known_attitude", "known_tilt", "pose"), FIX_OF_BOXES) | {"cosine_law": FIX_OF_COSINES}


def camera_fix_box(settings: LandmarkFixSettings, room: Room, width: int, period: float = 0.1) -> Box:
    """Return the box that solves detections for a fix; it reads the camera's message and the belief of [x; i] (240).

    With a bank, or if the noise's scale is learned, the box also outputs the fix's lasting error `lasting` (6), see
    landmark_bank.py. `width` is the width of the images [px], `period` the time between messages [s]. ValueError if the
    method is OpenCV's, which has no element.
    """
    element, m = ELEMENTS.get(settings.method), len(settings.rows)
    if element is None:
        raise ValueError(f"landmark_fix.method: {settings.method}: has no compiled form")
    prior = prior_covariance(settings)
    tables = {"prior": np.zeros(0) if prior is None else prior}
    believed, start = box_belief(settings, room, width), {"refused": np.zeros(1)}
    size = PAYLOAD + m + m * m
    if settings.survey_bank is None and settings.noise_scale is None:
        return Box("camera_fix", element, size, Values({"rows": m}, start, tables)).with_groups(believed=believed)
    bank, n = np.array(settings.survey_bank or (1.0,)), len(room.landmark_positions)
    start |= {"learned": learned_first(bank, 9 * n), "gathered": np.zeros((3 * n, 4)), "scale": np.array(NOTHING_YET)}
    numbers = {"keeps": kept_from(period), "worth": settings.noise_scale or 0.0}
    given, work = Values(numbers, start, tables | {"bank": bank}), {"S": (3, 3), "e": (3,), "Q": (len(bank),)}
    parts = {"fix": (0, size), "lasting": (size, N_LASTING)}
    size += N_LASTING + (PER_LANDMARK + 9) * n + 2
    return Box("camera_fix", LEARNING, size, given, work, parts=parts).with_groups(believed=believed)
