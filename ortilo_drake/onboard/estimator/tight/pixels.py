"""Landmark bearings in pixels: the centre of each landmark's box gives two measurements.

    z_i = h(p_WB, R_WB, p_WL_i + c_i) + sd_i s_i - (dh/dt) tau + noise

with h the centre of the landmark's box (model/pinhole.py), c_i the landmark's true less its surveyed position, sd_i s_i
the part of the box's error that lasts from picture to picture, and tau the message's age beyond its stamp. dh/dt is the
rate of h due to velocity and body rates. The association of onboard/landmarks assigns boxes to landmarks, with the
covariance of the pose at the stamp.
"""

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.model.pinhole import Camera, box_and_jacobian, sines
from ortilo_drake.model.placing import put
from ortilo_drake.onboard.estimator.tight.attitude_rows import inverse_rate_matrix
from ortilo_drake.onboard.estimator.tight.inertial import angles_of, matrix_of
from ortilo_drake.onboard.estimator.tight.layout import ADDITIVE, GYRO, Layout, V, pose_of, put_places
from ortilo_drake.onboard.estimator.tight.model import Aids
from ortilo_drake.onboard.estimator.tight.update import Taken, correct, innovation_variance, none_taken, settle, update
from ortilo_drake.onboard.landmarks.landmark_association import center_sd


@cached_njit
def pose_belief(x: np.ndarray, C: np.ndarray, layout: Layout, clone: int) -> tuple[np.ndarray, np.ndarray]:
    """Return a pose for the association: xhat (15) and P (225), both 0 but for position and Euler angles."""
    p_WB, q_WB = pose_of(x, layout, clone)
    xhat, rpy = np.zeros(15), angles_of(q_WB)
    put(p_WB, xhat)
    put(rpy, xhat, 3)
    E, T = inverse_rate_matrix(rpy), np.zeros((6, 6))
    for i in range(3):
        T[i, i] = 1.0
        put(E[i], T[3 + i], 3)
    at = np.empty(6, np.int64)
    put_places(layout, clone, at)
    whole = np.zeros((15, 15))
    for a in range(6):
        for b in range(6):
            total = 0.0
            for i in range(6):
                for j in range(6):
                    total += T[a, i] * C[at[i], at[j]] * T[b, j]
            whole[a, b] = total
    return xhat, whole.ravel()


@register_jitable
def box_rows(
    x: np.ndarray,
    layout: Layout,
    i: int,
    center: np.ndarray,
    position: np.ndarray,
    outline: np.ndarray,
    camera: Camera,
    noise: np.ndarray,
    rates: np.ndarray,
    clone: int,
    where: np.ndarray,
    rows: np.ndarray,
    e: np.ndarray,
    sd: np.ndarray,
) -> int:
    """Write the two rows of a box's centre; return their number of entries, 0 if the landmark has no projection.

    Landmark i is estimated at `position`, p_WL (3) [m], and has the `outline` (m, 3); its box has the measured `center`
    (2) [px]. `noise` is Aids.pixel_noise; `rates` are the body rates at the stamp (3) [rad/s]; `clone` is the pose.
    `where` gets the indices of the rows' entries (2, 11 or more), `rows` their values, `e` the innovations (2) [px],
    and `sd` the sds of the centre (2) [px], unless they are already set.
    """
    J, box = np.empty((2, 6)), np.empty(4)
    p_WB, q_WB = pose_of(x, layout, clone)
    rpy, R = angles_of(q_WB), matrix_of(q_WB)
    if not box_and_jacobian(position, outline, p_WB, sines(rpy), R, camera, box, J):
        return 0
    E, m = inverse_rate_matrix(rpy), 0
    for axis in range(2):
        if sd[axis] == 0.0:
            sd[axis] = center_sd(box[2 + axis] - box[axis], noise[0], noise[1])
        m, e[axis] = 6, center[axis] - 0.5 * (box[axis] + box[2 + axis])
        put_places(layout, clone, where[axis])
        for k in range(3):
            rows[axis, k] = J[axis, k]
            rows[axis, 3 + k] = J[axis, 3] * E[0, k] + J[axis, 4] * E[1, k] + J[axis, 5] * E[2, k]
        if layout.survey >= 0:  # to move a landmark has the effect of moving the vehicle the other way
            for k in range(3):
                where[axis, m], rows[axis, m] = layout.survey + 3 * i + k, -J[axis, k]
                m += 1
        if layout.pixel_slow >= 0:
            at = layout.pixel_slow + 2 * i + axis
            where[axis, m], rows[axis, m] = at, sd[axis] * np.sqrt(noise[2])
            e[axis] -= rows[axis, m] * x[ADDITIVE + at - GYRO]
            m += 1
        if layout.clock >= 0:
            moved = 0.0
            for k in range(3):
                moved += rows[axis, k] * x[V + k] + rows[axis, 3 + k] * rates[k]
            where[axis, m], rows[axis, m] = layout.clock + 1, -moved
            e[axis] += moved * x[ADDITIVE + layout.clock + 1 - GYRO]
            m += 1
    return m


@register_jitable
def box_misfit(
    C: np.ndarray,
    taken: Taken,
    where: np.ndarray,
    rows: np.ndarray,
    m: int,
    e: np.ndarray,
    r_u: float,
    r_v: float,
    first: np.ndarray,
    second: np.ndarray,
) -> tuple[float, float]:
    """Return e^T S^-1 e of a box's two rows, and S_u; write C H^T of the two rows to `first` and `second` (n).

    `where` holds the indices and `rows` the values of each row's m entries (2, m or more). The innovations e (2) have
    noise of variance r_u and r_v.
    """
    S_u = innovation_variance(C, taken, where[0], rows[0], m, first) + r_u
    S_v = innovation_variance(C, taken, where[1], rows[1], m, second) + r_v
    S_uv = 0.0
    for k in range(m):
        S_uv += rows[1, k] * first[where[1, k]]
    squared = (S_v * e[0] ** 2 - 2.0 * S_uv * e[0] * e[1] + S_u * e[1] ** 2) / (S_u * S_v - S_uv**2)
    return squared, S_u


@cached_njit
def take_boxes(
    x: np.ndarray,
    C: np.ndarray,
    layout: Layout,
    chosen: np.ndarray,
    centers: np.ndarray,
    aids: Aids,
    rates: np.ndarray,
    clone: int,
) -> tuple[int, int]:
    """Update with boxes that were assigned to landmarks; return the numbers of used and of refused boxes.

    `chosen` are the landmarks' indices (k), `centers` the centres of their boxes (k, 2) [px], `rates` the body rates at
    the stamp (3) [rad/s]; other arguments as in take_ranges of ranges.py.
    """
    camera, noise, outlines = aids.boxes.camera, aids.pixel_noise, aids.boxes.outlines
    PHt, first = np.empty(C.shape[0]), np.empty(C.shape[0])
    where, rows = np.zeros((2, 11), np.int64), np.zeros((2, 11))
    taken = none_taken(2 * chosen.size, C.shape[0])
    used = refused = 0
    for b in range(chosen.size):
        i, e, sd = chosen[b], np.empty(2), np.zeros(2)
        position = aids.boxes.positions[i].copy()
        if layout.survey >= 0:
            for k in range(3):
                position[k] += x[ADDITIVE + layout.survey + 3 * i + k - GYRO]
        m = box_rows(x, layout, i, centers[b], position, outlines[i], camera, noise, rates, clone, where, rows, e, sd)
        if m == 0:
            continue
        r_u, r_v = (1.0 - noise[2]) * sd[0] ** 2, (1.0 - noise[2]) * sd[1] ** 2
        squared, S_u = box_misfit(C, taken, where, rows, m, e, r_u, r_v, first, PHt)
        if not squared <= aids.gates[1]:
            refused += 1
            continue
        used += 1
        weight = max(1.0, np.sqrt(squared) / aids.huber)
        correct(x, taken, first, S_u + (weight - 1.0) * r_u, e[0], layout.core)
        m = box_rows(
            x, layout, i, centers[b], position, outlines[i], camera, noise, rates, clone, where, rows, e, sd
        )  # computed again, because the first row has corrected the state
        if m > 0:
            update(x, C, taken, where[1], rows[1], m, e[1], weight * r_v, np.inf, np.inf, layout.core, PHt)
    settle(C, taken)
    return used, refused
