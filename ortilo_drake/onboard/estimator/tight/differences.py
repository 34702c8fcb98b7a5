"""Differences of ranges, one packet after the other, each at its own time.

    r_ab = |q - a_b| + b_b + s_b - (|q - a_a| + b_a + s_a) + noise,   q = p_WB - (t + tau) v_WB + R_WB l_B

with lever arm l, constant and slow errors b_i and s_i as of single ranges (ranges.py), t the packet's age at the
message's stamp and tau the time by which the message is older than that. The noise of a row is that of two ranges; the
noises of rows are taken to be independent. How far the lever turned since, and the velocity from a late message's stamp
to now, are left out. No clock of the vehicle is in a difference.
"""

import numpy as np
from numba import njit

from ortilo_drake.model.range_pairs import AGE, ROW, THERE, VALUE, A, B
from ortilo_drake.model.signals import PAYLOAD
from ortilo_drake.onboard.estimator.tight.aids import Aids
from ortilo_drake.onboard.estimator.tight.inertial import matrix_of
from ortilo_drake.onboard.estimator.tight.layout import ADDITIVE, GYRO, Layout, V, pose_of, put_places
from ortilo_drake.onboard.estimator.tight.ranges import MIN_SD, signed_range
from ortilo_drake.onboard.estimator.tight.update import none_taken, settle, update


@njit(cache=True)
def take_differences(
    x: np.ndarray, C: np.ndarray, layout: Layout, message: np.ndarray, aids: Aids, clone: int
) -> tuple[int, int]:
    """Take a uwb message difference by difference; return how many were used and how many refused.

    Arguments as take_ranges in ranges.py; the message has rows as in model/range_pairs.py.
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
            continue  # asked before they are made whole: of NaN each processor makes another number
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
