"""Position from the camera's landmark boxes, by one of five methods; two give the yaw, or the attitude, as well."""

from collections.abc import Callable
from typing import Final

import numpy as np
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from ortilo_drake.model.pinhole import Camera
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import ARRIVED, DETECTIONS_SIZE, N_XBAR, PAYLOAD, STAMP
from ortilo_drake.onboard.gate import squared_gate
from ortilo_drake.onboard.landmarks.cosine_law import cosine_law
from ortilo_drake.onboard.landmarks.known_attitude import known_attitude, known_tilt, pose
from ortilo_drake.onboard.landmarks.landmark_association import associate, center_sds
from ortilo_drake.onboard.landmarks.pnp import pnp
from ortilo_drake.scenario import LandmarkFix as LandmarkFixSettings

Solution = tuple[bool, np.ndarray, np.ndarray]
METHODS: Final[dict[str, Callable[..., Solution]]] = {
    "known_attitude": known_attitude,
    "known_tilt": known_tilt,
    "pose": pose,
    "cosine_law": cosine_law,
    "pnp": pnp,
}

MAX_SD = 1.0  # a fix less certain than this is none: errors so large leave the linear range of its covariance [m]
MAX_CORRECTION = 3.0  # nor is a fix farther than this from the estimate that its boxes were associated by [m]
LOST = 1.0e6  # an estimate as large as this associates nothing


def landmark_fix_message(
    detections: np.ndarray,
    xhat: np.ndarray,
    P: np.ndarray,
    method: Callable[..., Solution],
    landmarks: tuple[np.ndarray, np.ndarray, np.ndarray],
    camera: Camera,
    sd: float,
    gate: float,
    max_residual: float,
    growth: float,
    rows: int,
) -> np.ndarray:
    """Return the fix message: value (m) and its covariance, or zeros if nothing arrived or it yields no fix.

    Args:
        detections: the detections message.
        xhat: estimate (15).
        P: its covariance row by row (225).
        method: one of METHODS.
        landmarks: positions p_W (n, 3), outlines (n, m, 3), classes (n).
        camera: the camera.
        sd: error of a small box's centre [px].
        gate: largest squared Mahalanobis distance of an association.
        max_residual: largest disagreement of a box with the others [sd].
        growth: of the error with the box's size [1/px].
        rows: m, of the value.
    """
    message = np.zeros(PAYLOAD + rows + rows * rows)
    if detections[ARRIVED] != 1.0 or not (np.all(np.abs(xhat) < LOST) and np.all(np.isfinite(P))):
        return message
    positions, outlines, labels = landmarks
    chosen, centers = associate(detections, xhat, P, positions, outlines, labels, camera, sd, gate, growth)
    seen = positions[chosen], outlines[chosen]
    sds = center_sds(*seen, xhat, camera, sd, growth)
    found, value, covariance = method(centers, *seen, xhat, P, camera, sds, max_residual)
    if not found or not np.trace(covariance[:3, :3]) <= MAX_SD**2:
        return message
    if np.linalg.norm(value[:3] - xhat[0:3]) > MAX_CORRECTION:
        return message
    message[ARRIVED], message[STAMP] = 1.0, detections[STAMP]
    message[PAYLOAD : PAYLOAD + rows], message[PAYLOAD + rows :] = value, covariance.ravel()
    return message


class LandmarkFix(LeafSystem):
    """Memoryless: boxes to a position, by the estimate of the same tick, xhat(k|k-1).

    Where the settings give a prior_sd, it stands in for P throughout: in the association and as what is believed
    of the attitude. Boxes that come late are judged by the present estimate or, with estimator.delay
    'replay', by that of their stamp, which the fix keeps.

    Ports:
        detections (DETECTIONS_SIZE): the detections message, see model/signals.py.
        estimate (15): xhat.
        covariance (225): P row by row.
        fix (14, output): the fix message; longer where the method gives more: [p_WB, psi] and 4 x 4,
            or [p_WB, rpy] and 6 x 6.

    Args:
        settings: method and what it believes of the boxes.
        room: landmarks and the camera.
        width: image width [px] that the detections are in.
    """

    def __init__(self, settings: LandmarkFixSettings, room: Room, width: int):
        super().__init__()
        self.set_name("landmark_fix")
        self._constants = (
            METHODS[settings.method],
            (room.landmark_positions, room.landmark_outlines, room.landmark_labels),
            room.camera.scaled_to(width).constants,
            settings.center_sd,
            squared_gate(settings.gate, 2),
            settings.max_residual,
            settings.center_growth,
            len(settings.rows),
        )
        self._prior = None
        if settings.prior_sd is not None:
            position, angle = np.square(settings.prior_sd)
            self._prior = np.diag([position] * 3 + [angle] * 3 + [0.0] * (N_XBAR - 6)).ravel()
        self._detections = self.DeclareVectorInputPort("detections", DETECTIONS_SIZE)
        self._estimate = self.DeclareVectorInputPort("estimate", N_XBAR)
        self._covariance = self.DeclareVectorInputPort("covariance", N_XBAR**2)
        size = PAYLOAD + len(settings.rows) + len(settings.rows) ** 2
        self._nothing = np.zeros(size)
        ports = {self._detections.ticket(), self._estimate.ticket(), self._covariance.ticket()}
        self.DeclareVectorOutputPort("fix", size, self._calc_fix, prerequisites_of_calc=ports)

    def _calc_fix(self, context: Context, output: BasicVector) -> None:
        detections = self._detections.Eval(context)
        if detections[ARRIVED] != 1.0:  # most ticks: spare the other ports
            output.set_value(self._nothing)
            return
        xhat = self._estimate.Eval(context)
        P = self._covariance.Eval(context) if self._prior is None else self._prior
        output.set_value(landmark_fix_message(detections, xhat, P, *self._constants))
