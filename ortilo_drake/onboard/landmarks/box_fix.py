"""The compiled steps before and after the solver of a landmark fix: choice of the boxes, and check of the fix.

All boxes together must agree with the estimate that associated them. Pairings may be wrong although each one passes its
gate, because the errors of the estimate are common to all boxes. With e the stacked differences from the predicted
centres, J their Jacobian with respect to the pose, and P the pose's covariance,

    d^2 = e^T (J P J^T + R)^-1 e,   R = diag(sd^2),

is chi-square with 2 n degrees of freedom for n correct pairings (J. Neira and J. D. Tardos, "Data association in
stochastic mapping using the joint compatibility test", IEEE Trans. Robotics and Automation 17, 2001). While d^2 is too
large, the test drops the box whose removal makes d^2 smallest.
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
    """Return the largest d^2 of 0 to `most` boxes, which correct pairings keep with this probability."""
    return np.array([0.0, *(squared_gate(probability, 2 * n) for n in range(1, most + 1))])


@cached_njit
def joint_distance(e: np.ndarray, J: np.ndarray, P: np.ndarray, sd: np.ndarray) -> float:
    """Return d^2 of the differences e (2 n) [px], given J (2 n, 6), P (6 x 6) and the sds of the centres (2 n) [px].

    The result is NaN if P is not a covariance.
    """
    n, J_P, S = e.size, np.empty(6), np.empty((e.size, e.size))
    for i in range(n):  # J P J^T + R, summed in a fixed order: BLAS's order depends on the processor
        for a in range(6):
            J_P[a] = 0.0
            for b in range(6):
                J_P[a] += J[i, b] * P[b, a]
        for j in range(i + 1):  # only the lower half is used
            S[i, j] = 0.0
            for a in range(6):
                S[i, j] += J_P[a] * J[j, a]
        S[i, i] += sd[i] ** 2
    return squared_norm_in_place(S, e.copy())


@cached_njit
def jointly_compatible(e: np.ndarray, J: np.ndarray, P: np.ndarray, sd: np.ndarray, limits: np.ndarray) -> np.ndarray:
    """Return the indices of the jointly compatible boxes, in rising order.

    e is the difference of each box's centre from the predicted one (n, 2) [px], J its Jacobian with respect to position
    and attitude (n, 2, 6), P their covariance (6 x 6), sd the error of each centre (n, 2) [px]. `limits` come from
    joint_limits, for n boxes or more.
    """
    kept = np.arange(len(e))
    distance = distance_of(kept, e, J, P, sd)
    while kept.size > 0 and not distance <= limits[kept.size]:  # also for NaN
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
    """Return d^2 of the boxes in `kept` only, given e (n, 2), J (n, 2, 6) and sd (n, 2) of all boxes."""
    if kept.size == 0:
        return 0.0
    return joint_distance(e[kept].ravel(), J[kept].reshape((2 * kept.size, 6)), P, sd[kept].ravel())


MAX_SD = 1.0  # largest sqrt(tr C) of a fix [m]: larger errors leave the linear range of the covariance
MAX_CORRECTION = 3.0  # largest distance of a fix from the estimate that associated its boxes [m]
DOUBLINGS = 4  # largest number of doublings of the estimate's error after refused images
LOST = 1.0e6  # an estimate with a number this large associates nothing


class BoxBelief(NamedTuple):
    """The onboard model of the boxes, in arrays for compiled functions."""

    positions: np.ndarray
    """p_WL of the landmarks (n, 3) [m]."""
    outlines: np.ndarray
    """outlines of the landmarks (n, m, 3) [m]."""
    labels: np.ndarray
    """classes of the landmarks (n)."""
    camera: Camera
    """the camera."""
    sd: float
    """error sd of a small box's centre [px]."""
    gate: float
    """largest squared Mahalanobis distance of an association."""
    max_residual: float
    """largest disagreement of a box with the others [sd]."""
    growth: float
    """growth of the centre's error with the box's size [1/px]."""
    margin: float
    """ambiguity margin of the association, see landmark_association.py."""
    limits: np.ndarray
    """largest d^2 of the joint test for each number of boxes; empty without the test."""
    inside: float
    """distance by which a landmark's predicted box must stay inside the image's border [px]."""
    survey_sd: float
    """sd of the landmarks' surveyed positions [m]."""


def box_belief(settings: LandmarkFixSettings, room: Room, width: int) -> BoxBelief:
    """Return the model of boxes for these settings and images of this width [px]."""
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
    """Return the covariance used instead of P, row by row (225), if the settings give a prior_sd; else None."""
    if settings.prior_sd is None:
        return None
    position, angle = np.square(settings.prior_sd)
    return np.diag([position] * 3 + [angle] * 3 + [0.0] * (N_XBAR - 6)).ravel()


@cached_njit
def boxes_to_solve(
    detections: np.ndarray, xhat: np.ndarray, P: np.ndarray, believed: BoxBelief, widened: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the associated boxes: centres (k, 2), p_WL (k, 3), outlines (k, m, 3), sds (k, 2), landmarks' indices (k).

    The association uses an estimate xhat (15) and its covariance P, row by row (225), with its sds times `widened`. The
    detections message must have arrived.
    """
    positions, outlines = believed.positions, believed.outlines
    if not (np.all(np.abs(xhat) < LOST) and np.all(np.isfinite(P))):  # such an estimate cannot associate boxes
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
    """Return the fix message of a method's value (m) and covariance (m, m), or zeros if there is no fix.

    xhat (15) is the estimate that associated the boxes, `stamp` the stamp of the boxes [s], `rows` is m.
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
    """Return the number of refused images after one more image; it rises if this could have given a fix but did not."""
    if is_fix:
        return max(refused - 1.0, 0.0)
    labels, known = whole_boxes(detections, believed.camera.image)[0], 0
    for label in labels:
        if is_among(believed.labels, label):
            known += 1
    return min(refused + 1.0, DOUBLINGS) if known >= 2 else refused
