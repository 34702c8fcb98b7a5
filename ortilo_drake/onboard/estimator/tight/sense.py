"""The tight filter's updates with the messages of a tick: imu, ranges and boxes, each at its stamp."""

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.model.signals import ARRIVED, STAMP
from ortilo_drake.onboard.estimator.tight.aids import Aids
from ortilo_drake.onboard.estimator.tight.attitude_rows import take_angles
from ortilo_drake.onboard.estimator.tight.layout import ADDITIVE, Layout
from ortilo_drake.onboard.estimator.tight.pixels import pose_belief, take_boxes
from ortilo_drake.onboard.estimator.tight.ranges import take_differences, take_ranges
from ortilo_drake.onboard.estimator.tight.tick import RATES, Motion, propagate_to_now
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
