"""From the boxes of an image to a fix, but for the method between: compiled functions.

All boxes together must agree with the estimate by which they were associated. Each pairing within its gate may be wrong
though all of them pass, for the errors of the estimate are common to all boxes. With e the stacked differences from the
predicted centres and J their Jacobian by the pose, of covariance P,

    d^2 = e^T (J P J^T + R)^-1 e,   R = diag(sd^2),

is chi-square with 2 n degrees of freedom of n right pairings (J. Neira and J. D. Tardos, "Data association in
stochastic mapping using the joint compatibility test", IEEE Trans. Robotics and Automation 17, 2001). While it is too
large, the box goes whose absence makes it smallest.
"""

from typing import NamedTuple

import numpy as np

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.model.cholesky import squared_norm_in_place
from ortilo_drake.model.pinhole import Camera
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import ARRIVED, MAX_DETECTIONS, N_XBAR, PAYLOAD, STAMP
from ortilo_drake.onboard.gate import squared_gate
from ortilo_drake.onboard.landmarks.landmark_association import associate, is_among, pose_covariance, whole_boxes
from ortilo_drake.scenario import LandmarkFix as LandmarkFixSettings


def joint_limits(probability: float, most: int) -> np.ndarray:
    """Return the largest d^2 of 0 to `most` boxes with which right pairings are compatible with a probability."""
    return np.array([0.0, *(squared_gate(probability, 2 * n) for n in range(1, most + 1))])


@cached_njit
def joint_distance(e: np.ndarray, J: np.ndarray, P: np.ndarray, sd: np.ndarray) -> float:
    """Return d^2 of the differences e (2 n), of Jacobian J (2 n, 6), P (6 x 6) and the boxes' errors sd (2 n).

    NaN where P is no covariance.
    """
    n, J_P, S = e.size, np.empty(6), np.empty((e.size, e.size))
    for i in range(n):  # J P J^T + R, summed in order: BLAS takes another order on another processor
        for a in range(6):
            J_P[a] = 0.0
            for b in range(6):
                J_P[a] += J[i, b] * P[b, a]
        for j in range(i + 1):  # the lower half is what is used
            S[i, j] = 0.0
            for a in range(6):
                S[i, j] += J_P[a] * J[j, a]
        S[i, i] += sd[i] ** 2
    return squared_norm_in_place(S, e.copy())


@cached_njit
def jointly_compatible(e: np.ndarray, J: np.ndarray, P: np.ndarray, sd: np.ndarray, limits: np.ndarray) -> np.ndarray:
    """Return the boxes that are compatible, as indices in rising order.

    Their centres differ by e (n, 2) [px] from the predicted ones, of Jacobians J by position and attitude (n, 2, 6),
    whose covariance is P (6 x 6); sd is the error of each centre (n, 2) [px]. The limits are joint_limits of n boxes or
    more.
    """
    kept = np.arange(len(e))
    distance = distance_of(kept, e, J, P, sd)
    while kept.size > 0 and not distance <= limits[kept.size]:  # nor where it is NaN
        best, distance = kept[:0], np.inf
        for a in range(kept.size):
            rest = np.concatenate((kept[:a], kept[a + 1 :]))
            its = distance_of(rest, e, J, P, sd)
            if a == 0 or its < distance:
                best, distance = rest, its
        kept = best
    return kept


@cached_njit
def distance_of(kept: np.ndarray, e: np.ndarray, J: np.ndarray, P: np.ndarray, sd: np.ndarray) -> float:
    """Return joint_distance of the boxes kept alone, of e (n, 2), J (n, 2, 6) and sd (n, 2) of all."""
    if kept.size == 0:
        return 0.0
    return joint_distance(e[kept].ravel(), J[kept].reshape((2 * kept.size, 6)), P, sd[kept].ravel())


MAX_SD = 1.0  # a fix less certain than this is none: errors so large leave the linear range of its covariance [m]
MAX_CORRECTION = 3.0  # nor is a fix farther than this from the estimate that its boxes were associated by [m]
DOUBLINGS = 4  # of the believed error after refused images, at most
LOST = 1.0e6  # an estimate as large as this associates nothing


class BoxBelief(NamedTuple):
    """The model of the boxes, as compiled functions take it."""

    positions: np.ndarray
    """p_W of the landmarks (n, 3)."""
    outlines: np.ndarray
    """their outlines (n, m, 3)."""
    labels: np.ndarray
    """their classes (n)."""
    camera: Camera
    """the camera."""
    sd: float
    """error of a small box's centre [px]."""
    gate: float
    """largest squared Mahalanobis distance of an association."""
    max_residual: float
    """largest disagreement of a box with the others [sd]."""
    growth: float
    """of the error with the box's size [1/px]."""
    margin: float
    """of the association, see landmark_association.py."""
    limits: np.ndarray
    """of the joint test, see box_fix.py; empty to leave it out."""
    inside: float
    """how far from the border a landmark's predicted box must end [px]."""
    survey_sd: float
    """of the landmarks' positions [m]."""


def box_belief(settings: LandmarkFixSettings, room: Room, width: int) -> BoxBelief:
    """Return the settings' model of boxes, for images of that width [px]."""
    joint = settings.joint
    return BoxBelief(
        room.landmark_positions,
        room.landmark_outlines,
        room.landmark_labels,
        room.camera.scaled_to(width).constants,
        settings.center_sd,
        squared_gate(settings.gate, 2),
        settings.max_residual,
        settings.center_growth,
        settings.margin,
        np.zeros(0) if joint is None else joint_limits(joint, MAX_DETECTIONS),
        -np.inf if settings.inside is None else settings.inside,
        settings.survey_sd,
    )


def prior_covariance(settings: LandmarkFixSettings) -> np.ndarray | None:
    """Return the covariance used instead of P, row by row (225), where the settings give a prior_sd."""
    if settings.prior_sd is None:
        return None
    position, angle = np.square(settings.prior_sd)
    return np.diag([position] * 3 + [angle] * 3 + [0.0] * (N_XBAR - 6)).ravel()


@cached_njit
def boxes_to_solve(
    detections: np.ndarray, xhat: np.ndarray, P: np.ndarray, believed: BoxBelief, widened: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the boxes whose landmarks are found: centres (k, 2), p_W (k, 3), outlines (k, m, 3), errors (k, 2), which.

    They are associated by an estimate (15) and its covariance, row by row (225), whose error is taken to be `widened`
    times as large. A detections message is there.
    """
    positions, outlines = believed.positions, believed.outlines
    if not (np.all(np.abs(xhat) < LOST) and np.all(np.isfinite(P))):  # nothing can be associated by it
        return np.empty((0, 2)), positions[:0].copy(), outlines[:0].copy(), np.empty((0, 2)), np.empty(0, np.int64)
    known = positions, outlines, believed.labels, believed.camera, believed.sd, believed.gate
    judged = believed.growth, believed.margin, believed.inside, believed.survey_sd
    chosen, centers, predicted = associate(detections, xhat, widened**2 * P, *known, *judged)
    sds = predicted.sd
    if believed.limits.size > 0:
        P_pose = widened**2 * pose_covariance(P)
        kept = jointly_compatible(centers - predicted.centers, predicted.J, P_pose, sds, believed.limits)
        chosen, centers, sds = chosen[kept], centers[kept], sds[kept]
    return centers, positions[chosen], outlines[chosen], sds, chosen


@cached_njit
def box_fix_message(
    found: bool, value: np.ndarray, covariance: np.ndarray, xhat: np.ndarray, stamp: float, rows: int
) -> np.ndarray:
    """Return the fix message of a method's value (m) and its covariance (m, m), or zeros where it found no fix.

    xhat is the estimate that its boxes were associated by (15), the stamp that of the boxes [s].
    """
    message = np.zeros(PAYLOAD + rows + rows * rows)
    if not found or not covariance[0, 0] + covariance[1, 1] + covariance[2, 2] <= MAX_SD**2:
        return message
    correction = value[:3] - xhat[0:3]
    if np.sqrt(np.sum(correction**2)) > MAX_CORRECTION:
        return message
    message[ARRIVED], message[STAMP] = 1.0, stamp
    message[PAYLOAD : PAYLOAD + rows], message[PAYLOAD + rows :] = value, covariance.ravel()
    return message


@cached_njit
def refused_after(refused: float, is_fix: bool, detections: np.ndarray, believed: BoxBelief) -> float:
    """Return the number of refused images after one more: it rises if that could have given a fix and gave none."""
    if is_fix:
        return max(refused - 1.0, 0.0)
    labels, known = whole_boxes(detections, believed.camera.image)[0], 0
    for label in labels:
        if is_among(believed.labels, label):
            known += 1
    return min(refused + 1.0, DOUBLINGS) if known >= 2 else refused
