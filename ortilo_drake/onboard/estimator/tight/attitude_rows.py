"""Measurement rows of the imu's angles, and of values that are linear in the paper's twelve states.

The paper's states are [p_WB, rpy, v_WB, rpy rates]. A small rotation theta of the body, in B, changes rpy by E(rpy)^-1
theta, with the E of model/equations.py. The body rates have the error -db_g, so to first order the Euler rates have the
error -E^-1 db_g.
"""

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.model.cholesky import forward_in_place
from ortilo_drake.model.elementary import sin_cos
from ortilo_drake.model.products import times
from ortilo_drake.onboard.estimator.tight.inertial import angles_of
from ortilo_drake.onboard.estimator.tight.layout import ADDITIVE, GYRO, THETA, Layout, P, Q, V
from ortilo_drake.onboard.estimator.tight.update import none_taken, settle, update


@register_jitable
def inverse_rate_matrix(rpy: np.ndarray) -> np.ndarray:
    """Return E(rpy)^-1 (3, 3), which turns body rates into Euler-angle rates; singular at theta = +-pi/2."""
    (s, c), (s_theta, c_theta) = sin_cos(rpy[0]), sin_cos(rpy[1])
    k = 1.0 / c_theta
    t = s_theta * k
    return np.array(((1.0, s * t, c * t), (0.0, c, -s), (0.0, s * k, c * k)))


@register_jitable
def wrapped(angle: float) -> float:
    """Return the angle [rad] wrapped to [-pi, pi)."""
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


@cached_njit
def take_angles(
    x: np.ndarray,
    C: np.ndarray,
    layout: Layout,
    residual: np.ndarray,
    variance: float,
    gate: float,
    huber: float,
    normalized: np.ndarray,
) -> int:
    """Update with the imu's roll, pitch and yaw; return how many of the three were used.

    `residual` is measured less predicted angles, before the angles' own errors b are subtracted, as the mean over a
    tick's samples (3) [rad], with noise of `variance` [rad^2]. gate and huber as in update.py. e / sqrt(S) of each
    angle goes to `normalized` (3), 0 for a refused one.
    """
    where, row, PHt = np.zeros(4, np.int64), np.zeros(4), np.empty(C.shape[0])
    where[:3] = np.arange(THETA, THETA + 3)
    before, used, taken = angles_of(x[Q : Q + 4]), 0, none_taken(3, C.shape[0])
    for i in range(3):
        rpy = angles_of(x[Q : Q + 4])
        row[:3] = inverse_rate_matrix(rpy)[i]
        e, m = residual[i] - wrapped(rpy[i] - before[i]), 3
        if layout.angles >= 0:
            where[3], row[3] = layout.angles + i, 1.0
            e -= x[ADDITIVE + layout.angles + i - GYRO]
            m = 4
        squared = update(x, C, taken, where, row, m, e, variance, gate, huber, layout.core, PHt)
        used += squared >= 0.0
        normalized[i] = np.copysign(np.sqrt(max(squared, 0.0)), e)
    settle(C, taken)
    return used


@cached_njit
def take_fix(
    x: np.ndarray,
    C: np.ndarray,
    layout: Layout,
    value: np.ndarray,
    covariance: np.ndarray,
    rows: np.ndarray,
    rates: np.ndarray,
    gate: float,
    huber: float,
) -> bool:
    """Update with a value y = C x + v (m) of the paper's twelve states x; return whether any row was used.

    `rows` is C (m, 12), `covariance` the V of v (m, m). With the Cholesky factor L of V, L^-1 y has independent rows of
    noise 1, which are used one by one. `rates` are the measured body rates (3) [rad/s]; gate, huber as in update.py.
    """
    m = value.size
    inverse = np.eye(m)
    forward_in_place(covariance.copy(), inverse, m)
    where, PHt, used, taken = np.arange(12), np.empty(C.shape[0]), False, none_taken(m, C.shape[0])
    for k in range(m):
        rpy = angles_of(x[Q : Q + 4])
        E = inverse_rate_matrix(rpy)
        state = np.concatenate((x[P : P + 3], rpy, x[V : V + 3], times(E, rates - x[ADDITIVE : ADDITIVE + 3])))
        seen, weights, e = np.zeros(12), inverse[k], 0.0
        for i in range(m):
            e += weights[i] * value[i]
            for j in range(12):
                seen[j] += weights[i] * rows[i, j]
        row = np.zeros(12)  # over dp, dv, theta, db_g
        for j in range(12):
            e -= seen[j] * state[j]
        row[0:3], row[3:6] = seen[0:3], seen[6:9]
        for i in range(3):
            for j in range(3):
                row[6 + j] += seen[3 + i] * E[i, j]
                row[9 + j] -= seen[9 + i] * E[i, j]
        if update(x, C, taken, where, row, 12, e, 1.0, gate, huber, layout.core, PHt) >= 0.0:
            used = True
    settle(C, taken)
    return used
