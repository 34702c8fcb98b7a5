"""Association of detected boxes with landmarks by the predicted projection, because classes repeat in the room.

The filter predicts the centre of each landmark's box, z_i = h_i(xhat), and the covariance of the innovation,

    S_i = J_i P J_i^T + R_i,   J_i = d h_i / d(p_WB, rpy),   P of position and attitude (6 x 6).

A box of the same class and of about the predicted size may be landmark i if d^2 = e^T S_i^-1 e, e = z - z_i, is within
the gate. The assignment minimises the sum of d^2; a landmark without a box costs as much as the gate (global nearest
neighbour: Blackman, "Multiple-Target Tracking with Radar Applications", 1986, chapter 4).

The best assignment may be hardly better than the next one. A pairing is ambiguous if the best assignment that pairs its
landmark or its box otherwise costs less than a margin more; ambiguous pairings are left out.
"""

from typing import NamedTuple

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.model.equations import rotation_matrix
from ortilo_drake.model.pinhole import NEAR, Camera, box_and_jacobian, in_body_frame, sines
from ortilo_drake.model.signals import DETECTION_SIZE, MAX_DETECTIONS, PAYLOAD
from ortilo_drake.onboard.landmarks.assignment import assign

BORDER = 1.5  # a box nearer to the image's border than this counts as cut by the border [px]
MAX_SCALE = 1.6  # a box larger or smaller than predicted by this factor belongs to another landmark
_FORBIDDEN = 1.0e6


class Predicted(NamedTuple):
    """The predicted boxes of k landmarks."""

    centers: np.ndarray
    """predicted centres z_i [px] (k, 2)."""
    J: np.ndarray
    """Jacobians J_i with respect to (p_WB, rpy) (k, 2, 6)."""
    sd: np.ndarray
    """error sds of the centres of boxes of the predicted size, see center_sd [px] (k, 2)."""


@cached_njit
def whole_boxes(detections: np.ndarray, image: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return class (k), centre (k, 2) and width + height (k) of the detected boxes that the border does not cut.

    `detections` is the message; `image` is the image's width and height (2) [px].
    """
    labels, centers, spans = np.empty(MAX_DETECTIONS), np.empty((MAX_DETECTIONS, 2)), np.empty(MAX_DETECTIONS)
    k = 0
    for row in range(MAX_DETECTIONS):
        box = detections[PAYLOAD + row * DETECTION_SIZE : PAYLOAD + (row + 1) * DETECTION_SIZE]
        low, high = BORDER - 0.5, -BORDER - 0.5
        if box[0] >= 0.0 and box[2] > low and box[3] > low and box[4] < image[0] + high and box[5] < image[1] + high:
            labels[k] = box[0]
            centers[k, 0], centers[k, 1] = 0.5 * (box[2] + box[4]), 0.5 * (box[3] + box[5])
            spans[k] = box[4] - box[2] + box[5] - box[3]
            k += 1
    return labels[:k], centers[:k], spans[:k]


@cached_njit
def pose_covariance(P: np.ndarray) -> np.ndarray:
    """Return the block of position and attitude (6, 6) of the filter's P (225, row by row)."""
    return np.ascontiguousarray(P.reshape((15, 15))[:6, :6])


@cached_njit
def innovation_covariance(J: np.ndarray, P: np.ndarray, sd: np.ndarray) -> tuple[float, float, float]:
    """Return S_uu, S_uv, S_vv of S = J P J^T + diag(sd^2), with J (2, 6), P (6, 6) and sd (2) [px]."""
    S_uu, S_uv, S_vv = sd[0] ** 2, 0.0, sd[1] ** 2
    for a in range(6):
        for b in range(6):
            S_uu += J[0, a] * P[a, b] * J[0, b]
            S_uv += J[0, a] * P[a, b] * J[1, b]
            S_vv += J[1, a] * P[a, b] * J[1, b]
    return S_uu, S_uv, S_vv


@cached_njit
def squared_distance(e_u: float, e_v: float, S_uu: float, S_uv: float, S_vv: float) -> float:
    """Return the squared Mahalanobis distance e^T S^-1 e of an innovation e = (e_u, e_v)."""
    return (S_vv * e_u**2 - 2.0 * S_uv * e_u * e_v + S_uu * e_v**2) / (S_uu * S_vv - S_uv**2)


@cached_njit
def center_sd(size: float, sd: float, growth: float) -> float:
    """Return the error sd of a box's centre along an axis [px], given the box's size along this axis [px].

    It is `sd` [px] for small boxes, and sd * growth * size for large ones; growth is in [1/px].
    """
    return float(sd * np.sqrt(1.0 + (growth * size) ** 2))


@register_jitable
def with_survey(sd: float, J: np.ndarray, survey_sd: float) -> float:
    """Return the error sd of a box's centre along an axis [px]: its own `sd` [px] and the landmark's survey error.

    J is d z / d(p_WB, rpy) of this axis (6): to move the landmark moves the box as to move p_WB the other way does.
    """
    if survey_sd == 0.0:
        return sd
    return float(np.sqrt(sd**2 + survey_sd**2 * (J[0] ** 2 + J[1] ** 2 + J[2] ** 2)))


@register_jitable(_nrt=False)
def is_among(labels: np.ndarray, label: float) -> bool:
    """Return whether `label` is one of `labels` (n)."""
    found = False
    for i in range(labels.size):
        found = found or labels[i] == label
    return found


@register_jitable
def without(costs: np.ndarray, row: int, column: int) -> np.ndarray:
    """Return the costs without one row and one column."""
    rest = np.empty((costs.shape[0] - 1, costs.shape[1] - 1))
    for i in range(rest.shape[0]):
        for j in range(rest.shape[1]):
            rest[i, j] = costs[i + (i >= row), j + (j >= column)]
    return rest


@register_jitable
def cost_of(costs: np.ndarray, column: np.ndarray) -> float:
    """Return the cost of an assignment, given the column of each row."""
    total = 0.0
    for i in range(column.size):
        total += costs[i, column[i]]
    return total


@cached_njit
def ambiguous(costs: np.ndarray, column: np.ndarray, n_boxes: int, margin: float) -> np.ndarray:
    """Return a mask (k) of the landmarks with an ambiguous pairing: another pairing costs less than `margin` more.

    `costs` (k, m + k) are the ones of `associate`; `column` is the best assignment, the column of each landmark (k).
    """
    n = len(costs)
    best, doubtful = cost_of(costs, column), np.zeros(n, dtype=np.bool_)
    for i in range(n):
        for j in range(n_boxes):
            if not costs[i, j] < _FORBIDDEN or column[i] == j:
                continue
            new = False
            for row in range(n):
                new |= ((row == i and column[row] < n_boxes) or column[row] == j) and not doubtful[row]
            if not new:
                continue
            rest = without(costs, i, j)
            if costs[i, j] + cost_of(rest, assign(rest)) - best < margin:
                for row in range(n):
                    doubtful[row] |= (row == i and column[row] < n_boxes) or column[row] == j
    return doubtful


@cached_njit
def associate(
    detections: np.ndarray,
    xhat: np.ndarray,
    P: np.ndarray,
    positions: np.ndarray,
    outlines: np.ndarray,
    labels: np.ndarray,
    camera: Camera,
    sd: float,
    gate: float,
    growth: float = 0.0,
    margin: float = 0.0,
    inside: float = -np.inf,
    survey_sd: float = 0.0,
) -> tuple[np.ndarray, np.ndarray, Predicted]:
    """Return the landmarks found, in rising order (k), their boxes' centres (k, 2) and the predicted boxes.

    The order of the message's rows does not matter. Position and attitude come first in the estimate xhat (15) with the
    covariance P (225). The landmarks are at p_WL (n, 3), with outlines (n, m, 3), see pinhole.py, and classes (n). sd
    [px] and growth [1/px] as in center_sd, survey_sd [m] as in with_survey. `gate` is the largest d^2; `margin` is the
    one of `ambiguous`, 0 keeps all pairings.

    A landmark's predicted box must end `inside` [px] from the border. A box that the border cuts may seem whole, as the
    detector's edges have errors, tens of pixels for a large box; the error of the centre is then half of that.
    """
    width, height = camera.image[0], camera.image[1]
    # Bounds of the image plus half an image on each side, as slopes of the line of sight.
    f_u, f_v, aside, above = camera.f, camera.f * camera.lens.aspect, width, height
    if camera.lens.bend.size > 0:
        f_u, f_v, aside, above = 1.0, 1.0, 2.0 * camera.lens.reach[0], 2.0 * camera.lens.reach[1]
    box_labels, centers, spans = whole_boxes(detections, camera.image)
    m, n = box_labels.size, positions.shape[0]
    p_WB, rpy, P_pose = xhat[0:3], xhat[3:6], pose_covariance(P)
    R_WB, of_rpy, box = rotation_matrix(rpy), sines(rpy), np.empty(4)
    z, J, sds = np.empty((n, 2)), np.empty((n, 2, 6)), np.empty((n, 2))
    candidates, k = np.empty(n, dtype=np.int64), 0
    d2 = np.full((n, m), _FORBIDDEN)
    for i in range(n):
        # Cheap tests first: a detected class, and a position in front of the camera, at most half an image outside.
        if not is_among(box_labels, labels[i]):
            continue
        q = in_body_frame(positions[i, 0], positions[i, 1], positions[i, 2], p_WB, R_WB)
        depth = q[0] - camera.p_BC[0]
        if depth < NEAR or f_u * abs(q[1]) > aside * depth or f_v * abs(q[2]) > above * depth:
            continue
        if not box_and_jacobian(positions[i], outlines[i], p_WB, of_rpy, R_WB, camera, box, J[k]):
            continue
        low, high = inside - 0.5, -inside - 0.5
        if box[0] < low or box[1] < low or box[2] > width + high or box[3] > height + high:
            continue
        span = box[2] - box[0] + box[3] - box[1]
        for axis in range(2):
            z[k, axis] = 0.5 * (box[axis] + box[2 + axis])
            sds[k, axis] = with_survey(center_sd(box[2 + axis] - box[axis], sd, growth), J[k, axis], survey_sd)
        S_uu, S_uv, S_vv = innovation_covariance(J[k], P_pose, sds[k])
        for j in range(m):
            if box_labels[j] == labels[i] and span < MAX_SCALE * spans[j] and spans[j] < MAX_SCALE * span:
                squared = squared_distance(centers[j, 0] - z[k, 0], centers[j, 1] - z[k, 1], S_uu, S_uv, S_vv)
                if squared <= gate:
                    d2[k, j] = squared
        candidates[k] = i
        k += 1
    costs = np.full((k, m + k), _FORBIDDEN)  # column m + i, with the gate's cost, leaves landmark i without a box
    for i in range(k):
        for j in range(m):
            costs[i, j] = d2[i, j]
        costs[i, m + i] = gate
    column = assign(costs)
    paired = column < m
    if margin > 0.0:
        paired &= ~ambiguous(costs, column, m, margin)
    found = Predicted(z[:k][paired], J[:k][paired], sds[:k][paired])
    return candidates[:k][paired], centers[column[paired]], found
