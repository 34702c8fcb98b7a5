"""Measurement rows of single ranges and of differences of ranges; one range or difference alone can be used.

    r_i = |p_WB + R_WB l_B - a_i| + b_i + s_i + c - (u . v) tau + noise

with the antenna's lever arm l, the constant and the slow error b_i and s_i of an anchor's ranges, a common error c of
all ranges (0 until watch.py opens it), u the direction from the anchor, and tau the message's age beyond its stamp. If
only differences of ranges count (TDoA), the clock offset of the tick is one more unknown, common to all ranges of a
message; the result equals the one with differences to any one range.

A message of differences holds packets, each with its own time:

    r_ab = |q - a_b| + b_b + s_b - (|q - a_a| + b_a + s_a) + noise,   q = p_WB - (t + tau) v_WB + R_WB l_B

with l, b_i, s_i and tau as for single ranges, and t the packet's age at the message's stamp. A row has the noise of two
ranges; rows count as independent. Neglected are the lever's rotation since the packet, and changes of the velocity
between the stamp of a late message and now. The vehicle's clock does not enter a difference.
"""

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.model.range_pairs import AGE, ROW, THERE, VALUE, A, B
from ortilo_drake.model.signals import PAYLOAD
from ortilo_drake.onboard.estimator.tight.inertial import matrix_of
from ortilo_drake.onboard.estimator.tight.layout import ADDITIVE, GYRO, Layout, V, pose_of, put_places
from ortilo_drake.onboard.estimator.tight.model import Aids
from ortilo_drake.onboard.estimator.tight.update import (
    inject,
    innovation_variance,
    keep_row,
    none_taken,
    settle,
    update,
)

MIN_SD = 1e-3  # smallest noise sd of a range [m]
CLOCK_SD = 100.0  # sd of an unknown clock offset [m]


@register_jitable
def predicted_range(p_WB: np.ndarray, R_WB: np.ndarray, lever: np.ndarray, anchor: np.ndarray) -> float:
    """Return the predicted range |p_WB + R_WB l_B - a| [m]."""
    total = 0.0
    for i in range(3):
        d = p_WB[i] + R_WB[i, 0] * lever[0] + R_WB[i, 1] * lever[1] + R_WB[i, 2] * lever[2] - anchor[i]
        total = total + d * d
    return np.sqrt(total)


@register_jitable
def range_row(p_WB: np.ndarray, R_WB: np.ndarray, lever: np.ndarray, anchor: np.ndarray, row: np.ndarray) -> float:
    """Return the predicted range [m] and write its gradient by (dp, theta) to row (6)."""
    d = predicted_range(p_WB, R_WB, lever, anchor)
    for i in range(3):
        lever_W = R_WB[i, 0] * lever[0] + R_WB[i, 1] * lever[1] + R_WB[i, 2] * lever[2]
        row[i] = (p_WB[i] + lever_W - anchor[i]) / max(d, 1e-9)
    # u^T R [-l]x theta
    x = row[0] * R_WB[0, 0] + row[1] * R_WB[1, 0] + row[2] * R_WB[2, 0]
    y = row[0] * R_WB[0, 1] + row[1] * R_WB[1, 1] + row[2] * R_WB[2, 1]
    z = row[0] * R_WB[0, 2] + row[1] * R_WB[1, 2] + row[2] * R_WB[2, 2]
    row[3], row[4], row[5] = z * lever[1] - y * lever[2], x * lever[2] - z * lever[0], y * lever[0] - x * lever[1]
    return d


@register_jitable
def signed_range(
    x: np.ndarray,
    p: np.ndarray,
    R: np.ndarray,
    lever: np.ndarray,
    anchors: np.ndarray,
    i: int,
    sign: float,
    lasting: int,
    slow: int,
    m: int,
    where: np.ndarray,
    row: np.ndarray,
) -> tuple[float, int]:
    """Add sign (1, -1) times the row of anchor i's range; return the predicted range and the new number of entries.

    p is p_WB and R is R_WB at the range's time, `lever` is l_B, `anchors` are a_i in W (n, 3) [m]. `lasting` and `slow`
    are the first indices of the anchors' constant and slow errors in the error state, -1 for none. `where` holds the
    indices and `row` the values of the m entries so far; the first six belong to (dp, theta).
    """
    gradient = np.empty(6)
    d = range_row(p, R, lever, anchors[i], gradient)
    for k in range(6):
        row[k] += sign * gradient[k]
    for group in (lasting, slow):
        if group >= 0:
            where[m], row[m] = group + i, sign
            d += x[ADDITIVE + group + i - GYRO]
            m += 1
    return d, m


@cached_njit
def take_ranges(
    x: np.ndarray, C: np.ndarray, layout: Layout, message: np.ndarray, aids: Aids, clone: int
) -> tuple[int, int, int]:
    """Update with the ranges of a uwb message, one by one.

    Returns the numbers of used and of refused ranges, and the number of refused ranges that were too long less the
    number of those too short. With aids.differences all ranges of a message share a clock offset. `clone` is the pose
    at the message's stamp, -1 for the present pose.
    """
    n, core, gate = aids.anchors.shape[0], layout.core, aids.gates[0]
    where, row = np.zeros(12, np.int64), np.zeros(12)
    PHt, taken = np.empty(C.shape[0]), none_taken(n, C.shape[0])
    used = refused = longer = 0
    # The common offset is a state of this message only: mean, variance, and covariance with the error state.
    offset, offset_variance = 0.0, CLOCK_SD**2 if aids.differences else 0.0
    with_offset = np.zeros(C.shape[0])
    put_places(layout, clone, where)
    for i in range(n):
        if message[PAYLOAD + n + i] == 0.0:
            continue
        measured = message[PAYLOAD + i]
        p, q = pose_of(x, layout, clone)
        row[:6] = 0.0
        bias, slow = layout.range_bias, layout.range_slow
        d, m = signed_range(x, p, matrix_of(q), aids.lever, aids.anchors, i, 1.0, bias, slow, 6, where, row)
        if layout.range_offset >= 0:
            where[m], row[m] = layout.range_offset, 1.0
            d += x[ADDITIVE + layout.range_offset - GYRO]
            m += 1
        if layout.clock >= 0:
            along = row[0] * x[V] + row[1] * x[V + 1] + row[2] * x[V + 2]
            where[m], row[m] = layout.clock, -along
            d -= along * x[ADDITIVE + layout.clock - GYRO]
            m += 1
        r = max(aids.range_noise[0] + aids.range_noise[1] * measured, MIN_SD) ** 2
        if not aids.differences:
            squared = update(x, C, taken, where, row, m, measured - d, r, gate, aids.huber, core, PHt)
        else:
            own = innovation_variance(C, taken, where, row, m, PHt)
            cross = 0.0
            for k in range(m):
                cross += row[k] * with_offset[where[k]]
            S = own + 2.0 * cross + offset_variance + r
            e = measured - d - offset
            squared = e * e / S
            if squared <= gate:
                gain = PHt + with_offset
                seen = cross + offset_variance
                keep_row(taken, gain, S)
                with_offset -= gain * (seen / S)
                offset_variance -= seen * seen / S
                offset += seen * e / S
                inject(x, gain * (e / S), core)
            else:
                squared = -squared
        if squared >= 0.0:
            used += 1
        else:
            refused += 1
            longer += 1 if measured > d else -1
    settle(C, taken)
    return used, refused, longer


@cached_njit
def take_differences(
    x: np.ndarray, C: np.ndarray, layout: Layout, message: np.ndarray, aids: Aids, clone: int
) -> tuple[int, int]:
    """Update with the differences of a uwb message, one by one; return the numbers of used and of refused ones.

    Arguments as in take_ranges; the message has the rows of model/range_pairs.py.
    """
    rows, anchors, lever, noise = (message.size - PAYLOAD) // ROW, aids.anchors, aids.lever, aids.range_noise
    where, row = np.zeros(14, np.int64), np.zeros(14)
    PHt, taken = np.empty(C.shape[0]), none_taken(rows, C.shape[0])
    put_places(layout, clone, where)
    for k in range(3):
        where[6 + k] = V + k
    used = refused = 0
    for j in range(rows):
        its = message[PAYLOAD + ROW * j : PAYLOAD + ROW * (j + 1)]
        if its[THERE] == 0.0 or not (0.0 <= its[A] < anchors.shape[0] and 0.0 <= its[B] < anchors.shape[0]):
            continue  # checked before the conversion to int, because int(NaN) depends on the processor
        a, b = int(its[A]), int(its[B])
        age = its[AGE]
        if layout.clock >= 0:
            age += x[ADDITIVE + layout.clock - GYRO]
        p_stamp, q = pose_of(x, layout, clone)
        p, R = p_stamp - age * x[V : V + 3], matrix_of(q)
        row[:9] = 0.0
        r_b, m = signed_range(x, p, R, lever, anchors, b, 1.0, layout.range_bias, layout.range_slow, 9, where, row)
        r_a, m = signed_range(x, p, R, lever, anchors, a, -1.0, layout.range_bias, layout.range_slow, m, where, row)
        for k in range(3):
            row[6 + k] = -age * row[k]
        if layout.clock >= 0:
            where[m] = layout.clock
            row[m] = -(row[0] * x[V] + row[1] * x[V + 1] + row[2] * x[V + 2])
            m += 1
        r = max((noise[0] + noise[1] * r_a) ** 2 + (noise[0] + noise[1] * r_b) ** 2, MIN_SD**2)
        e = its[VALUE] - (r_b - r_a)
        if update(x, C, taken, where, row, m, e, r, aids.gates[0], aids.huber, layout.core, PHt) >= 0.0:
            used += 1
        else:
            refused += 1
    settle(C, taken)
    return used, refused
