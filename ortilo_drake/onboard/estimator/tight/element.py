"""The tight filter as elements of the loop: the filter, and the box of the measurements that it uses in a tick.

The messages of a tick, imu, ranges and boxes, are each used at its stamp.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.loop.element import Box, Element, Values, parts_of
from ortilo_drake.model.measurement import Measurement
from ortilo_drake.model.placing import fill, put
from ortilo_drake.model.signals import ARRIVED, IMU_SIZE, N_X, N_XBAR, PAYLOAD, STAMP
from ortilo_drake.onboard.estimator.tight.attitude_rows import take_angles, take_fix
from ortilo_drake.onboard.estimator.tight.layout import ADDITIVE, Layout
from ortilo_drake.onboard.estimator.tight.model import Aids, first_states
from ortilo_drake.onboard.estimator.tight.pixels import pose_belief, take_boxes
from ortilo_drake.onboard.estimator.tight.ranges import take_differences, take_ranges
from ortilo_drake.onboard.estimator.tight.tick import (
    N_AHEAD,
    RATES,
    Motion,
    keep_pose,
    predict_next_tick,
    propagate_to_now,
)
from ortilo_drake.onboard.estimator.tight.watch import LAST, says_again, watch_angles, watch_ranges
from ortilo_drake.onboard.landmarks.landmark_association import associate

PRESENT, NOT_TAKEN = -1, -2  # values in place of a clone's index


@cached_njit
def clone_of(message: np.ndarray, now: float, h: float, clones: int) -> int:
    """Return the index of the clone at a message's stamp: PRESENT for t_k, NOT_TAKEN if the message cannot be used.

    A message cannot be used if it did not arrive, is not finite, or is older than the `clones` past poses or newer than
    t_k. t_k is `now` [s], h the tick [s].
    """
    if message[ARRIVED] == 0.0 or not np.isfinite(message).all():
        return NOT_TAKEN
    late = round((now - message[STAMP]) / h)
    return late - 1 if 0 <= late <= clones else NOT_TAKEN


@register_jitable
def _is_news(message: np.ndarray, last: np.ndarray, watches: bool) -> bool:
    return not watches or not says_again(message, last)


@cached_njit
def take_messages(
    x: np.ndarray,
    C: np.ndarray,
    kept: np.ndarray,
    watched: np.ndarray,
    samples: np.ndarray,
    uwb: np.ndarray,
    detections: np.ndarray,
    now: float,
    layout: Layout,
    motion: Motion,
    aids: Aids,
) -> None:
    """Propagate through the imu's samples (m, 11) to t_k, `now` [s], and update with the ranges and boxes that arrived.

    Besides x and C this changes `kept` (imu and control, tick.py) and `watched` (watch.py), which holds the watch's
    means and the last payloads of uwb and detections. A sensor that does not fly has the message [0, 0].
    """
    residual, normalized = np.empty(3), np.zeros(3)
    count = propagate_to_now(x, C, kept, samples, now, motion, residual)
    if count > 0 and aids.angle_sd > 0.0:
        variance = aids.angle_sd**2 / count
        take_angles(x, C, layout, residual, variance, aids.gates[0], aids.huber, normalized)
        if motion.watches:
            watch_angles(C, watched, normalized, aids.watch)
    boxes_at = LAST + uwb.size - 2
    clone = clone_of(uwb, now, motion.h, layout.clones)
    if clone != NOT_TAKEN and _is_news(uwb, watched[LAST:boxes_at], motion.watches):
        if aids.in_pairs:
            take_differences(x, C, layout, uwb, aids, clone)
        else:
            used, refused, longer = take_ranges(x, C, layout, uwb, aids, clone)
            if motion.watches:
                watch_ranges(C, watched, layout, used, refused, longer, aids.watch)
    clone = clone_of(detections, now, motion.h, layout.clones)
    if clone != NOT_TAKEN and _is_news(detections, watched[boxes_at:], motion.watches):
        xhat, P_pose = pose_belief(x, C, layout, clone)
        boxes, noise = aids.boxes, aids.pixel_noise
        known = boxes.positions, boxes.outlines, boxes.labels, boxes.camera
        chosen, centers, _ = associate(
            detections, xhat, P_pose, *known, noise[0], aids.gates[2], noise[1], boxes.margin, boxes.inside
        )
        rates = kept[RATES : RATES + 3] - x[ADDITIVE : ADDITIVE + 3]
        take_boxes(x, C, layout, chosen, centers, aids, rates, clone)


@register_jitable
def samples_of(imu: np.ndarray, n: int) -> np.ndarray:
    """Return the samples in the imu's message (n, 11); n is above 1 if the imu is faster than the tick."""
    if n == 1:
        return imu.reshape((1, IMU_SIZE))
    return imu[PAYLOAD:].reshape((n, IMU_SIZE))


@register_jitable
def fix_in(fixes: np.ndarray, own: np.ndarray, i: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the message of own sensor i in `fixes`: the whole message, the value (m) and the covariance (m, m)."""
    m, at = own[i + 1] - own[i], 0
    for j in range(i):
        at += fix_size(own[j + 1] - own[j])
    fix = fixes[at : at + fix_size(m)]
    return fix, fix[PAYLOAD : PAYLOAD + m].copy(), fix[PAYLOAD + m :].copy().reshape((m, m))


@register_jitable
def fix_size(m: int) -> int:
    """Return the size of the message of a fix with m rows."""
    return PAYLOAD + m + m * m


@register_jitable
def put_ahead(ahead: np.ndarray, belief: np.ndarray) -> None:
    """Write a prediction of x (156) to a belief of [x; i] (240); the integral, which is known, does not change."""
    put(ahead[:N_X], belief)
    for row in range(N_X):
        put(ahead[N_X * (row + 1) : N_X * (row + 2)], belief, N_XBAR * (row + 1))


def tight_step(
    n: Any,
    k: int,
    imu: np.ndarray,
    uwb: np.ndarray,
    camera: np.ndarray,
    fixes: np.ndarray,
    control: np.ndarray,
    reference: np.ndarray,
    x: np.ndarray,
    C: np.ndarray,
    kept: np.ndarray,
    watched: np.ndarray,
    belief: np.ndarray,
    ahead: np.ndarray,
    layout: Layout,
    motion: Motion,
    aids: Aids,
    own: np.ndarray,
    rows: np.ndarray,
) -> None:
    """Update with the messages that arrived in tick k, each at its stamp, and predict tick k + 1."""
    for i in range(3):
        belief[N_X + i] += reference[i] - belief[i]
    take_messages(x, C, kept, watched, samples_of(imu, n.samples), uwb, camera, k * motion.h, layout, motion, aids)
    for i in range(own.size - 1):
        fix, value, V = fix_in(fixes, own, i)
        if clone_of(fix, k * motion.h, motion.h, layout.clones) == PRESENT:
            C_own = rows[own[i] : own[i + 1]]
            take_fix(x, C, layout, value, V, C_own, kept[RATES : RATES + 3], aids.gates[0], aids.huber)
    predict_next_tick(x, C, kept, control, motion, ahead)
    keep_pose(x, C, layout)
    put_ahead(ahead, belief)


def tight_handler_out(
    n: Any,
    k: int,
    imu: np.ndarray,
    uwb: np.ndarray,
    camera: np.ndarray,
    fixes: np.ndarray,
    first: np.ndarray,
    block: np.ndarray,
    own: np.ndarray,
    number: np.ndarray,
    out: np.ndarray,
) -> None:
    """Output [y, delta, V2] of tick k: the messages that can be used; the y of ranges and boxes is NaN."""
    fill(out, 0.0)
    p, s = first[-1], first.size - 1
    for j, message in ((n.numbers[0], uwb), (n.numbers[2], camera)):
        if j >= 0 and clone_of(message, k * n.h, n.h, n.clones) != NOT_TAKEN:
            fill(out[first[j] : first[j + 1]], np.nan)
            out[p + j] = 1.0
    j = n.numbers[1]
    if j >= 0:
        if imu[ARRIVED] != 0.0:
            put(samples_of(imu, n.samples)[-1, PAYLOAD : PAYLOAD + 3], out, first[j])
            out[p + j] = 1.0
        m = first[j + 1] - first[j]
        for i in range(m):
            out[p + s + block[j] + i * (m + 1)] = n.angle_sd**2
    for i in range(own.size - 1):
        fix, value, V = fix_in(fixes, own, i)
        j = number[i]
        put(value, out, first[j])
        put(V.ravel(), out, p + s + block[j])
        if clone_of(fix, k * n.h, n.h, 0) != NOT_TAKEN:
            out[p + j] = 1.0


TIGHT = Element("tight", step=tight_step, shows="belief", allocates=True)
HEARD = Element("tight_handler", out=tight_handler_out, allocates=True)


NO_ROWS: Mapping[str, np.ndarray] = {}


def starts_of(own: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return the index of each own sensor's first row among all their rows, and the number of rows at the end."""
    return np.cumsum([0, *map(len, own.values())], dtype=np.int64)


def tight_box(
    layout: Layout,
    motion: Motion,
    aids: Aids,
    samples: int,
    payloads: int,
    C_0: np.ndarray,
    xbar_0: np.ndarray,
    own: Mapping[str, np.ndarray] = NO_ROWS,
) -> Box:
    """Return the tight filter's box `filter`; it reads the messages of imu, uwb, camera, `fixes`, control, reference.

    The box outputs the belief of [x; i] (240) predicted for this tick. A sensor that does not fly has a message of
    zeros: 11 for the imu, two for uwb and camera.

    The imu's message has `samples` samples; `payloads` is the total payload size of uwb and camera, as far as they fly.
    The filter starts with the covariance C_0 (n, n) and the estimate xbar_0 (15). `own` gives, for each own sensor in
    `fixes`, C over the twelve states (m, 12).
    """
    x, kept, ahead = first_states(layout, motion, C_0, xbar_0)
    belief = np.zeros(N_XBAR + N_XBAR * N_XBAR)
    put_ahead(ahead, belief)
    tables = {"own": starts_of(own), "rows": np.vstack((np.empty((0, N_X)), *own.values()))}
    start = {"x": x, "C": C_0, "kept": kept, "watched": np.zeros(LAST + payloads), "belief": belief}
    box = Box("filter", TIGHT, belief.size, Values({"samples": samples}, start, tables), {"ahead": (N_AHEAD,)})
    return box.with_groups(layout=layout, motion=motion, aids=aids)


def tight_handler_box(
    measurement: Measurement,
    numbers: list[int],
    samples: int,
    clones: int,
    angle_sd: float,
    h: float,
    own: Mapping[str, np.ndarray] = NO_ROWS,
) -> Box:
    """Return the box `handler` of y, delta, V2 of a tick; it reads the messages of imu, uwb, camera and `fixes`.

    `measurement` is the layout of the output; `numbers` are the indices of uwb, imu and camera among its sensors, -1 if
    one does not fly. The imu's message has `samples` samples, each with angle noise of sd angle_sd [rad]; `clones` is
    the number of past poses that the filter keeps; h is the tick [s]; `own` as in tight_box.
    """
    heard = {"numbers": np.array(numbers), "samples": samples, "clones": clones, "angle_sd": angle_sd, "h": h}
    number = np.array([measurement.sensors.index(name) for name in own], dtype=np.int64)
    tables = {"first": measurement.layout.first, "block": measurement.layout.block}
    given = Values(heard, tables=tables | {"own": starts_of(own), "number": number})
    sizes = measurement.sizes
    return Box("handler", HEARD, sum(sizes.values()), given, parts=parts_of(sizes))
