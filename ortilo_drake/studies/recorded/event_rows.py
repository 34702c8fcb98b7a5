"""Measurement rows of the filter on recorded events: of its start, of a known height, of boxes, of events.

A row is an innovation with its gradient. A function that makes a row writes to a blank row and returns the innovation,
and the number of entries where it varies. x is the nominal state, R the body's attitude R_WB (3, 3), lever l the
antenna in body axes (3).
"""

from typing import NamedTuple

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.onboard.estimator.tight.floor_rows import finder_row, flow_row
from ortilo_drake.onboard.estimator.tight.inertial import matrix_of
from ortilo_drake.onboard.estimator.tight.layout import THETA, Layout, P, Q, V
from ortilo_drake.onboard.estimator.tight.pixels import box_misfit, box_rows, pose_belief
from ortilo_drake.onboard.estimator.tight.ranges import signed_range
from ortilo_drake.onboard.estimator.tight.update import Taken, correct, inject, innovation_variance, settle
from ortilo_drake.onboard.landmarks.landmark_association import associate
from ortilo_drake.studies.recorded.filter_types import (
    BIASES,
    ENTRIES,
    FINDER,
    FORCE,
    LANDED,
    RANGE,
    Aids,
    Events,
    EventValues,
    Level,
    Noise,
    Restart,
    Setup,
    SparseRow,
    Tape,
    nominal,
)
from ortilo_drake.studies.recorded.imu_watch import AVERAGED, HELD, force_row
from ortilo_drake.studies.recorded.run_tape import write_row

ROOM = 16  # rows that wait before they are settled into the covariance
NEAREST, LARGEST = 0.02, 10.0  # least height of an antenna [m]; largest factor of range noise near the floor
NEAR, UPRIGHT = 0.1, 0.5  # range finder and flow need at least this height [m] and this R_33
LANDED_SD = (0.02, 0.03)  # standard deviations of velocity and height after a landing [m/s], [m]
MAY = 2.0  # standard deviations by which the true height may exceed the estimated one


@register_jitable
def state_row(at: int, row: SparseRow) -> None:
    """Write the row that measures the error state of index `at`, and nothing else."""
    row.where[:], row.of[:] = 0, 0.0
    row.where[0], row.of[0] = at, 1.0


@register_jitable
def distance_row(
    x: np.ndarray,
    R: np.ndarray,
    lever: np.ndarray,
    anchors: np.ndarray,
    b: int,
    a: int,
    measured: float,
    row: SparseRow,
) -> tuple[float, int]:
    """Write the row of a range r_b, or of r_b - r_a if a >= 0; return the innovation [m] and the number of entries."""
    for i in range(3):
        row.where[i], row.where[3 + i] = P + i, THETA + i
    p, slow = x[P : P + 3], BIASES + len(anchors)
    r_b, m = signed_range(x, p, R, lever, anchors, b, 1.0, BIASES, slow, 6, row.where, row.of)
    if a < 0:
        return measured - r_b, m
    r_a, m = signed_range(x, p, R, lever, anchors, a, -1.0, BIASES, slow, m, row.where, row.of)
    return measured - r_b + r_a, m


@register_jitable
def height_row(x: np.ndarray, R: np.ndarray, lever: np.ndarray, height: float, row: SparseRow) -> float:
    """Write the row of the antenna's height (four entries), and return its innovation [m]."""
    state_row(P + 2, row)
    e = height - x[P + 2]
    for i in range(3):
        a, b = (i + 1) % 3, (i + 2) % 3
        row.where[1 + i], row.of[1 + i] = THETA + i, lever[a] * R[2, b] - lever[b] * R[2, a]
        e -= R[2, i] * lever[i]
    return e


@register_jitable
def held_back(S: float, deviation: float) -> float:
    """Return the noise variance of a row that lowers its prior variance S to deviation², and no further.

    A known height is one piece of knowledge: taken as new at each epoch, it would soon make the filter overconfident.
    """
    return 1.0 / (1.0 / deviation**2 - 1.0 / S)


@register_jitable
def grown_at(x: np.ndarray, variance: float, lever: np.ndarray, noise: Noise, aids: Aids) -> float:
    """Return the factor of range noise near the floor, at most LARGEST: a lost filter must still accept some ranges.

    The factor is that at the largest height the antenna may have, given the height's variance [m²]. Otherwise a filter
    that is too low by mistake would accept no range that corrects it.
    """
    if noise.near_floor == 0.0:
        return 1.0
    down = matrix_of(x[Q : Q + 4])[2]
    z = x[P + 2] + down[0] * lever[0] + down[1] * lever[1] + down[2] * lever[2] - aids.floor
    z += MAY * np.sqrt(variance)
    return min(1.0 + (noise.near_floor / max(z, NEAREST)) ** 4, LARGEST)


class Now(NamedTuple):
    """The filter at an event: nominal state, covariance and waiting rows (all changed), a row, tape and `watched`."""

    x: np.ndarray
    C: np.ndarray
    waiting: Taken
    row: SparseRow
    tape: Tape
    written: np.ndarray
    watched: np.ndarray


@register_jitable
def take(now: Now, row: SparseRow, e: float, S: float) -> None:
    """Correct the filter by a row of innovation e and variance S, and write it to the tape; S < 0 widens C."""
    write_row(now.tape, now.written, row, e, S)
    if S < 0.0:
        settle(now.C, now.waiting)
        for i in range(len(row.PHt)):
            for j in range(len(row.PHt)):
                now.C[i, j] += row.PHt[i] * row.PHt[j] / -S
        row.PHt[:] *= e / S
        inject(now.x, row.PHt, now.C.shape[0])
        return
    correct(now.x, now.waiting, row.PHt, S, e, now.C.shape[0])
    if now.waiting.number[0] == ROOM:
        settle(now.C, now.waiting)


@register_jitable
def variance_of(now: Now, row: SparseRow, m: int) -> float:
    """Return H C H^T of a row H with m entries; H's C H^T is kept in the row."""
    return innovation_variance(now.C, now.waiting, row.where, row.of, m, row.PHt)


@register_jitable
def take_start(now: Now, anew: Restart) -> None:
    """Take the position and velocity of a restart as measurements."""
    for i in range(6):
        state_row(i, now.row)
        S = variance_of(now, now.row, 1) + anew.variances[i]
        take(now, now.row, anew.x[i] - now.x[i], S)


@register_jitable
def take_level(now: Now, lever: np.ndarray, level: Level) -> None:
    """Take the known climb rate and height as measurements, if they are more certain than the filter."""
    x, row = now.x, now.row
    if level.climb < np.inf:
        state_row(V + 2, row)
        S = variance_of(now, row, 1)
        if level.climb**2 < S:
            take(now, row, -x[V + 2], S + held_back(S, level.climb))
    if level.deviation < np.inf:
        e = height_row(x, matrix_of(x[Q : Q + 4]), lever, level.height, row)
        S = variance_of(now, row, 4)
        if level.deviation**2 < S:
            take(now, row, e, S + held_back(S, level.deviation))


@register_jitable
def own_row(
    k: int, axis: int, events: Events, heard_all: EventValues, now: Now, rates: np.ndarray, setup: Setup, grown: float
) -> tuple[float, float, int]:
    """Write the row of event k; return innovation, noise variance and the number of entries, 0 without a row.

    `axis` selects the row: of flow and force, axis 0 or 1; of a landing, the velocity's axes 0 to 2, or 3 for the
    height. Range finder and flow give no row near the floor or where the body is far from upright.
    """
    x, row, aids = now.x, now.row, setup.aids
    row.where[:], row.of[:] = 0, 0.0
    R, kind, seen = matrix_of(x[Q : Q + 4]), events.kind[k], events.r[k]
    if kind == RANGE:
        lever = setup.levers[1 + events.tag[k]]
        e, m = distance_row(x, R, lever, setup.anchors, events.which[k], events.other[k], seen, row)
        return e, (setup.noise.range_white * grown) ** 2, m
    if kind == LANDED:
        at = V + axis if axis < 3 else P + 2
        state_row(at, row)
        return (0.0 if axis < 3 else seen) - x[at], LANDED_SD[axis // 3] ** 2, 1
    if kind == FORCE:
        if now.watched[HELD + axis] < AVERAGED / 2.0:
            return 0.0, 0.0, 0
        variance = aids.drag_sd**2 / now.watched[HELD + axis]
        return force_row(x, R, axis, now.watched, row.where, row.of), variance, 8
    if R[2, 2] < UPRIGHT or x[P + 2] - aids.floor < NEAR:
        return 0.0, 0.0, 0
    if kind == FINDER:
        return seen - finder_row(x[P : P + 3], R, aids.finder, aids.floor, row.where, row.of), aids.finder_sd**2, 4
    p, v, w, at = x[P : P + 3], x[V : V + 3], rates - x[Q + 4 : Q + 7], len(row.PHt) - 2
    scale = x[nominal(at)]
    flow = flow_row(axis, p, v, R, w, aids.floor, aids.pixels, scale, at, row.where, row.of)
    return heard_all.flow[events.which[k], axis] - flow, aids.flow_sd**2, 9


@register_jitable
def take_boxes(message: np.ndarray, now: Now, rates: np.ndarray, setup: Setup) -> None:
    """Associate the boxes of a detections message with landmarks, and take the boxes' centres as measurements."""
    x, C, sight = now.x, now.C, setup.aids.sight
    N, sd = C.shape[0], sight.noise
    layout = Layout(-1, -1, -1, -1, -1, -1, -1, N, 0, N)
    settle(C, now.waiting)
    xhat, P_pose = pose_belief(x, C, layout, -1)
    chosen, centers, _ = associate(
        message, xhat, P_pose, sight.positions, sight.outlines, sight.labels, sight.camera, sd[0], sight.gates[1], sd[1]
    )
    where, rows = np.zeros((2, ENTRIES), np.int64), np.zeros((2, ENTRIES))
    u, v = SparseRow(where[0], rows[0], np.empty(N)), SparseRow(where[1], rows[1], np.empty(N))
    for b in range(chosen.size):
        i, e, of_center = chosen[b], np.empty(2), np.zeros(2)
        at, outline, camera, seen = sight.positions[i], sight.outlines[i], sight.camera, centers[b]
        m = box_rows(x, layout, i, seen, at, outline, camera, sd, rates, -1, where, rows, e, of_center)
        if m == 0:
            continue
        r_u, r_v = of_center[0] ** 2, of_center[1] ** 2
        squared, S_u = box_misfit(C, now.waiting, where, rows, m, e, r_u, r_v, u.PHt, v.PHt)
        if not squared <= sight.gates[0]:
            continue
        weight = max(1.0, np.sqrt(squared) / setup.noise.huber)
        take(now, u, e[0], S_u + (weight - 1.0) * r_u)
        m = box_rows(x, layout, i, seen, at, outline, camera, sd, rates, -1, where, rows, e, of_center)
        if m > 0:
            take(now, v, e[1], variance_of(now, v, m) + weight * r_v)
