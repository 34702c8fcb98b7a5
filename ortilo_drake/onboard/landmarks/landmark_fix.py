"""Position from the camera's landmark boxes, by one of five methods; one also gives the yaw, one the attitude."""

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


def as_known(settings: LandmarkFixSettings, room: Room) -> Room:
    """Return the room as known onboard: with the landmarks' outlines, or only with their sizes."""
    return room if settings.shapes == "outlines" else room.model_copy(update={"landmark_outline": {}})


class LandmarkFix(LeafSystem):
    """A system that solves boxes for a fix, with the estimate of the same tick, xhat(k|k-1).

    If the settings give a prior_sd, it replaces P in the association and as the covariance of the attitude. Late boxes
    are associated with the present estimate or, with estimator.delay 'replay', with the estimate at their stamp. The
    fix has the stamp of the boxes.

    With the joint test (settings.joint), an estimate worse than its P would refuse correct boxes for ever. So every
    image that could have given a fix but did not doubles the estimate's sd in the association of the next image, up to
    DOUBLINGS times, and every fix halves it again. The number of doublings is a discrete state.

    Ports:
        detections (DETECTIONS_SIZE): the detections message, see model/signals.py.
        estimate (15): xhat.
        covariance (225): P row by row.
        fix (14, output): the fix message; longer for methods that give [p_WB, psi] and a covariance 4 x 4, or [p_WB,
            rpy] and 6 x 6.

    Args:
        settings: method and model of the boxes.
        room: landmarks and the camera.
        width: width of the images in which the boxes are detected [px].
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
        if detections[ARRIVED] != 1.0:  # in most ticks: do not evaluate the other ports
            output.set_value(self._nothing)
            return
        widened = 1.0 if self._refused is None else float(2.0 ** context.get_discrete_state(self._refused).value()[0])
        P = self._covariance.Eval(context) if self._prior is None else self._prior
        output.set_value(self.fix_at(detections, self._estimate.Eval(context), P, widened))

    def fix_at(self, detections: np.ndarray, xhat: np.ndarray, P: np.ndarray, widened: float = 1.0) -> np.ndarray:
        """Return the fix message of a detections message, given xhat (15) and its covariance P row by row (225)."""
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
