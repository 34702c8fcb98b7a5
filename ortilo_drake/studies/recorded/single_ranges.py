"""An error-state Kalman filter on single ranges and IMU samples, each at its own stamp.

Nominal state: position p and velocity v of the point that is estimated [m, m/s], attitude R (body to world), biases of
gyro
b_g [rad/s] and accelerometer b_a [m/s²]; for each anchor a bias c_i [m] that wanders slowly and an error g_i [m] that
lasts for tau (first-order Gauss-Markov). Error state, in this order (15 + 2 n):

    p_true = p + dp,  v_true = v + dv,  R_true = exp(dtheta) R,  b_true = b + db,  c_true = c + dc,  g_true = g + dg

Between stamps, with the latest sample (w, f) of the IMU and gravity along -z:

    a = R (f - b_a) - [0, 0, G],   p += h v + h²/2 a,   v += h a,   R = exp(h R (w - b_g)) R,   g_i *= exp(-h / tau)

A range to anchor a_i, with the antenna at the lever l from p in body axes:

    r = |p + R l - a_i| + c_i + g_i + white,   H = [u, 0, (R l) x u, 0, 0, e_i, e_i],   u = (p + R l - a_i) / |p + R l -
    a_i|

taken one at a time, and left out if its innovation exceeds the gate times its standard deviation. Without an IMU, no
samples and no variance of R, b_g and b_a, this is the constant-velocity filter, driven by white acceleration.

Source: J. Solà, Quaternion kinematics for the error-state Kalman filter, arXiv 1711.02508, chapters 5 to 7, with the
attitude's error in the world's axes.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numba.extending import register_jitable

IMU, RANGE, QUERY = 0, 1, 2  # kinds of events
FIXED = 15  # error states before the anchors'


class Events(NamedTuple):
    """What happens in order of time: stamp [s], kind, index (IMU sample or anchor), range [m] (n each)."""

    t: np.ndarray
    kind: np.ndarray
    which: np.ndarray
    r: np.ndarray


class Noise(NamedTuple):
    """Noise of the filter; units in interop/recorded/map_file.py, FilterSettings."""

    acceleration: float
    rotation: float
    acceleration_bias: float
    rotation_bias: float
    range_white: float
    range_correlated: float
    correlation_time: float
    bias_walk: float
    gate: float


class Start(NamedTuple):
    """Nominal state at the first event, p (3), v (3), R (3, 3), b_g and b_a (3), c (n), and variances (15 + 2 n)."""

    p: np.ndarray
    v: np.ndarray
    R: np.ndarray
    gyro: np.ndarray
    accelerometer: np.ndarray
    c: np.ndarray
    variances: np.ndarray


class Run(NamedTuple):
    """What a run gives, at each epoch (a stamp with ranges or a query) and for each range.

    t (m); x (m, 12 + 2 n) nominal [p, v, b_g, b_a, c, g]; R (m, 3, 3); P (m, 3, 3) of the position; innovation, its
    variance and whether it was taken (one for each range); and for a smoother the predictions before the ranges:
    x_before, R_before, whole covariances P_before and P_after, and the transition Phi from the epoch before.
    """

    t: np.ndarray
    x: np.ndarray
    R: np.ndarray
    P: np.ndarray
    innovation: np.ndarray
    variance: np.ndarray
    taken: np.ndarray
    x_before: np.ndarray
    R_before: np.ndarray
    P_before: np.ndarray
    P_after: np.ndarray
    Phi: np.ndarray


@register_jitable
def skew(a: np.ndarray) -> np.ndarray:
    """Return the matrix of a cross product, [a]x b = a x b."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


@register_jitable
def turn(a: np.ndarray) -> np.ndarray:
    """Return the rotation matrix of a rotation vector (Rodrigues)."""
    angle = np.sqrt(np.sum(a * a))
    K = skew(a)
    if angle < 1e-9:
        return np.eye(3) + K
    return np.eye(3) + np.sin(angle) / angle * K + (1.0 - np.cos(angle)) / angle**2 * (K @ K)


@register_jitable
def _transition(h: float, R: np.ndarray, a: np.ndarray, noise: Noise, anchors: int) -> np.ndarray:
    """Return the error's transition over h, with a = R (f - b_a) before gravity."""
    N = FIXED + 2 * anchors
    Phi = np.eye(N)
    A = skew(a)
    for i in range(3):
        Phi[i, 3 + i] = h
    Phi[0:3, 6:9] = -A * (h * h / 2.0)
    Phi[0:3, 12:15] = -R * (h * h / 2.0)
    Phi[3:6, 6:9] = -A * h
    Phi[3:6, 12:15] = -R * h
    Phi[6:9, 9:12] = -R * h
    for i in range(FIXED + anchors, N):
        Phi[i, i] = np.exp(-h / noise.correlation_time)
    return Phi


@register_jitable
def _predicted(P: np.ndarray, Phi: np.ndarray, h: float, noise: Noise, anchors: int) -> np.ndarray:
    """Return Phi P Phi' + Q h; Phi is the identity outside its first 15 rows but for the last diagonal."""
    N = len(P)
    left = P.copy()
    left[:FIXED] = np.ascontiguousarray(Phi[:FIXED, :FIXED]) @ np.ascontiguousarray(P[:FIXED])
    for i in range(FIXED + anchors, N):
        left[i] = Phi[i, i] * P[i]
    out = left.copy()
    out[:, :FIXED] = np.ascontiguousarray(left[:, :FIXED]) @ np.ascontiguousarray(Phi[:FIXED, :FIXED].T)
    for i in range(FIXED + anchors, N):
        out[:, i] = Phi[i, i] * left[:, i]
    q = noise.acceleration**2
    for i in range(3):
        out[i, i] += q * h**3 / 3.0
        out[i, 3 + i] += q * h * h / 2.0
        out[3 + i, i] += q * h * h / 2.0
        out[3 + i, 3 + i] += q * h
        out[6 + i, 6 + i] += noise.rotation**2 * h
        out[9 + i, 9 + i] += noise.rotation_bias**2 * h
        out[12 + i, 12 + i] += noise.acceleration_bias**2 * h
    for i in range(anchors):
        out[FIXED + i, FIXED + i] += noise.bias_walk**2 * h
        j = FIXED + anchors + i
        out[j, j] += noise.range_correlated**2 * (1.0 - Phi[j, j] ** 2)
    return out


@register_jitable
def range_row(p: np.ndarray, R: np.ndarray, lever: np.ndarray, anchor: np.ndarray, i: int, n: int) -> tuple:
    """Return the distance to anchor i and its row H (15 + 2 n)."""
    arm = R @ lever
    d = p + arm - anchor
    distance = np.sqrt(np.sum(d * d))
    u = d / distance
    H = np.zeros(FIXED + 2 * n)
    H[:3] = u
    H[6] = arm[1] * u[2] - arm[2] * u[1]
    H[7] = arm[2] * u[0] - arm[0] * u[2]
    H[8] = arm[0] * u[1] - arm[1] * u[0]
    H[FIXED + i] = 1.0
    H[FIXED + n + i] = 1.0
    return distance, H


@njit(cache=True)
def run_filter(
    events: Events,
    samples: np.ndarray,
    anchors: np.ndarray,
    lever: np.ndarray,
    start: Start,
    noise: Noise,
    gravity: float,
    whole: bool,
) -> Run:
    """Run the filter over all events.

    Args:
        events: in order of time.
        samples: body rates and specific force, body axes (k, 6).
        anchors: positions (n, 3).
        lever: from the estimated point to the antenna, body axes (3).
        start: the state at the first event; the attitude's variance is 0 without an IMU.
        noise: the noise.
        gravity: [m/s²]; until the first sample, and without any, the specific force is its reaction.
        whole: whether to keep what a smoother needs.
    """
    n, total = len(anchors), len(events.t)
    N = FIXED + 2 * n
    p, v, R = start.p.copy(), start.v.copy(), start.R.copy()
    b_g, b_a, c, g = start.gyro.copy(), start.accelerometer.copy(), start.c.copy(), np.zeros(n)
    P = np.diag(start.variances)
    epochs, ranges, last = 0, 0, -np.inf
    for k in range(total):
        if events.kind[k] != IMU and events.t[k] > last:
            epochs += 1
            last = events.t[k]
        if events.kind[k] == RANGE:
            ranges += 1
    kept = epochs if whole else 0
    t_out, x_out = np.empty(epochs), np.empty((epochs, 12 + 2 * n))
    R_out, P_out = np.empty((epochs, 3, 3)), np.empty((epochs, 3, 3))
    innovation, variance, taken = np.empty(ranges), np.empty(ranges), np.zeros(ranges, dtype=np.bool_)
    x_before, R_before = np.empty((kept, 12 + 2 * n)), np.empty((kept, 3, 3))
    P_before, P_after, Phis = np.empty((kept, N, N)), np.empty((kept, N, N)), np.empty((kept, N, N))
    w, f = np.zeros(3), R.T @ np.array([0.0, 0.0, gravity])
    since = np.eye(N)  # the transition since the last epoch
    t, epoch, heard = events.t[0], -1, 0
    for k in range(total):
        h = events.t[k] - t
        if h > 0.0:
            t = events.t[k]
            a = R @ (f - b_a)
            Phi = _transition(h, R, a, noise, n)
            P = _predicted(P, Phi, h, noise, n)
            if whole:
                since = Phi @ since
            spin = (R @ (w - b_g)) * h
            a[2] -= gravity
            p = p + h * v + (h * h / 2.0) * a
            v = v + h * a
            R = turn(spin) @ R
            g = g * np.exp(-h / noise.correlation_time)
        if events.kind[k] == IMU:
            sample = samples[events.which[k]]
            w, f = sample[:3].copy(), sample[3:].copy()
            continue
        if epoch < 0 or t > t_out[epoch]:
            epoch += 1
            t_out[epoch] = t
            if whole:
                x_before[epoch] = np.concatenate((p, v, b_g, b_a, c, g))
                R_before[epoch], P_before[epoch], Phis[epoch] = R, P, since
                since = np.eye(N)
        if events.kind[k] == RANGE:
            i = events.which[k]
            distance, H = range_row(p, R, lever, anchors[i], i, n)
            e = events.r[k] - distance - c[i] - g[i]
            PH = P @ H
            S = np.sum(H * PH) + noise.range_white**2
            innovation[heard], variance[heard] = e, S
            if e * e <= noise.gate**2 * S:
                taken[heard] = True
                dx = PH * (e / S)
                P = P - np.outer(PH, PH / S)
                P = (P + P.T) / 2.0
                p, v = p + dx[:3], v + dx[3:6]
                R = turn(dx[6:9]) @ R
                b_g, b_a = b_g + dx[9:12], b_a + dx[12:15]
                c, g = c + dx[FIXED : FIXED + n], g + dx[FIXED + n :]
            heard += 1
        x_out[epoch] = np.concatenate((p, v, b_g, b_a, c, g))
        R_out[epoch], P_out[epoch] = R, P[:3, :3]
        if whole:
            P_after[epoch] = P
    return Run(t_out, x_out, R_out, P_out, innovation, variance, taken, x_before, R_before, P_before, P_after, Phis)
