"""Position from the camera's landmark boxes, by one of five methods; two give the yaw, or the attitude, as well."""

from collections.abc import Callable
from typing import Final

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import ARRIVED, DETECTIONS_SIZE, N_XBAR, PAYLOAD, STAMP
from ortilo_drake.onboard.landmarks.box_fix import (
    box_belief,
    box_fix_message,
    boxes_to_solve,
    prior_covariance,
    refused_after,
)
from ortilo_drake.onboard.landmarks.cosine_law import cosine_law
from ortilo_drake.onboard.landmarks.known_attitude import pose_from_boxes
from ortilo_drake.onboard.landmarks.pnp import pnp
from ortilo_drake.scenario import LandmarkFix as LandmarkFixSettings

Solution = tuple[bool, np.ndarray, np.ndarray]
METHODS: Final[dict[str, Callable[..., Solution]]] = {
    "known_attitude": lambda *boxes: pose_from_boxes(*boxes, 3)[:3],
    "known_tilt": lambda *boxes: pose_from_boxes(*boxes, 4)[:3],
    "pose": lambda *boxes: pose_from_boxes(*boxes, 6)[:3],
    "cosine_law": cosine_law,
    "pnp": pnp,
}


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
        self._method, self._rows = METHODS[settings.method], len(settings.rows)
        self._believed, self._prior = box_belief(settings, room, width), prior_covariance(settings)
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
        widened = 1.0 if self._refused is None else float(2.0 ** context.get_discrete_state(self._refused).value()[0])
        P = self._covariance.Eval(context) if self._prior is None else self._prior
        output.set_value(self.fix_at(detections, self._estimate.Eval(context), P, widened))

    def fix_at(self, detections: np.ndarray, xhat: np.ndarray, P: np.ndarray, widened: float = 1.0) -> np.ndarray:
        """Return the fix message of a detections message by an estimate (15) and its covariance row by row (225)."""
        believed, P = self._believed, P if self._prior is None else self._prior
        *boxes, sds, _ = boxes_to_solve(detections, xhat, P, believed, widened)
        solution = self._method(*boxes, xhat, P, believed.camera, sds, believed.max_residual)
        return box_fix_message(*solution, xhat, detections[STAMP], self._rows)

    def _update(self, context: Context, values: DiscreteValues) -> None:
        detections, refused = self._detections.Eval(context), context.get_discrete_state(self._refused).value()[0]
        if detections[ARRIVED] != 1.0:
            return
        is_fix = self.get_output_port().Eval(context)[ARRIVED] == 1.0
        values.set_value(self._refused, [refused_after(refused, is_fix, detections, self._believed)])
