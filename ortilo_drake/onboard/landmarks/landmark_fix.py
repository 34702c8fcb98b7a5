"""Position from the camera's landmark boxes, by one of five methods; two give the yaw, or the attitude, as well."""

from collections.abc import Callable
from typing import Final

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from ortilo_drake.model.pinhole import Camera
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import ARRIVED, DETECTIONS_SIZE, N_XBAR, PAYLOAD, STAMP
from ortilo_drake.onboard.gate import squared_gate
from ortilo_drake.onboard.landmarks.cosine_law import cosine_law
from ortilo_drake.onboard.landmarks.joint_compatibility import jointly_compatible
from ortilo_drake.onboard.landmarks.known_attitude import known_attitude, known_tilt, pose
from ortilo_drake.onboard.landmarks.landmark_association import associate, center_sds, pose_covariance, whole_boxes
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
DOUBLINGS = 4  # of the believed error after refused images, at most
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
    margin: float = 0.0,
    joint: float | None = None,
    inside: float = -np.inf,
    widened: float = 1.0,
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
        margin: of the association, see landmark_association.py.
        joint: probability of the joint test, see joint_compatibility.py; None leaves it out.
        inside: how far from the border a landmark's predicted box must end [px].
        widened: by how much the estimate's error is taken for larger than P has it, when boxes are associated [1].
    """
    message = np.zeros(PAYLOAD + rows + rows * rows)
    if detections[ARRIVED] != 1.0 or not (np.all(np.abs(xhat) < LOST) and np.all(np.isfinite(P))):
        return message
    positions, outlines, labels = landmarks
    chosen, centers = associate(
        detections, xhat, widened**2 * P, positions, outlines, labels, camera, sd, gate, growth, margin, inside
    )
    seen = positions[chosen], outlines[chosen]
    sds = center_sds(*seen, xhat, camera, sd, growth)
    if joint is not None:
        P_pose = widened**2 * pose_covariance(P)
        kept = jointly_compatible(centers, *seen, xhat, P_pose, camera, sds, joint)
        centers, seen, sds = centers[kept], (seen[0][kept], seen[1][kept]), sds[kept]
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

    With the joint test (settings.joint) an estimate that is worse than P has it would refuse right boxes for ever. So
    every image that could have given a fix and gave none doubles the error by which the next one's boxes are
    associated, up to DOUBLINGS times, and every fix halves it again: their number is a discrete state.

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
        h: tick [s].
    """

    def __init__(self, settings: LandmarkFixSettings, room: Room, width: int, h: float):
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
            settings.margin,
            settings.joint,
            -np.inf if settings.inside is None else settings.inside,
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
        self._refused = None
        if settings.joint is not None:
            self._refused = self.DeclareDiscreteState(1)
            self.DeclarePeriodicDiscreteUpdateEvent(h, 0.0, self._update)
            ports.add(self.discrete_state_ticket(self._refused))
        self.DeclareVectorOutputPort("fix", size, self._calc_fix, prerequisites_of_calc=ports)

    def _calc_fix(self, context: Context, output: BasicVector) -> None:
        detections = self._detections.Eval(context)
        if detections[ARRIVED] != 1.0:  # most ticks: spare the other ports
            output.set_value(self._nothing)
            return
        xhat = self._estimate.Eval(context)
        P = self._covariance.Eval(context) if self._prior is None else self._prior
        output.set_value(landmark_fix_message(detections, xhat, P, *self._constants, self._widened(context)))

    def _widened(self, context: Context) -> float:
        return 1.0 if self._refused is None else float(2.0 ** context.get_discrete_state(self._refused).value()[0])

    def _update(self, context: Context, values: DiscreteValues) -> None:
        detections, refused = self._detections.Eval(context), context.get_discrete_state(self._refused).value()[0]
        if detections[ARRIVED] != 1.0:
            return
        if self.get_output_port().Eval(context)[ARRIVED] == 1.0:
            refused = max(refused - 1.0, 0.0)
        elif np.isin(whole_boxes(detections, self._constants[2].image)[0], self._constants[1][2]).sum() >= 2:
            refused = min(refused + 1.0, DOUBLINGS)
        values.set_value(self._refused, [refused])
