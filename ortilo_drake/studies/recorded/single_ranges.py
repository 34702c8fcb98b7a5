"""An error-state Kalman filter on single ranges and IMU samples, each at its own stamp.

Nominal state: position p and velocity v of the point that is estimated [m, m/s], attitude R (body to world), biases
b_g of the gyro [rad/s] and b_a of the accelerometer [m/s²]; for each anchor a bias c_i [m] that wanders slowly and an
error g_i [m] that lasts for tau (first-order Gauss-Markov). Error state, in this order (15 + 2 n):

    p_true = p + dp,  v_true = v + dv,  R_true = exp(dtheta) R,  b_true = b + db,  c_true = c + dc,  g_true = g + dg

Between stamps, with the latest sample (w, f) of the IMU and gravity along -z:

    a = R (f - b_a) - [0, 0, G],   p += h v + h²/2 a,   v += h a,   R = exp(h R (w - b_g)) R,   g_i *= exp(-h / tau)

A range to anchor a_i, with the antenna at the lever l from p in body axes:

    r = |p + R l - a_i| + c_i + g_i + white,   H = [u, 0, (R l) x u, 0, 0, e_i, e_i]
    u = (p + R l - a_i) / |p + R l - a_i|

taken one at a time, and left out if its innovation exceeds the gate times its standard deviation. An anchor that was
left out for a second, by far, comes back when its innovations are small on average: an error that fades would pull the
filter along as soon as it passed the gate. Where the height is known or constant, a row of z or v_z comes first at each
epoch. Without an IMU, no samples and no variance of R, b_g and b_a, this is the constant-velocity filter, driven by
white acceleration.

Source: J. Solà, Quaternion kinematics for the error-state Kalman filter, arXiv 1711.02508, chapters 5 to 7, with the
attitude's error in the world's axes.
"""

import numpy as np
from numba import njit
from numba.extending import register_jitable

from ortilo_drake.studies.recorded.filter_types import FIXED, IMU, RANGE, Anew, Events, Level, Noise, Run, State, Watch
from ortilo_drake.studies.recorded.propagation import predicted, transition, turn

RECENT = 5.0  # an anchor counts among those heard if its last range is not older [s]
PATIENCE = 3.0  # so many times longer the filter is believed where all that it refuses is too long
SETTLES = 0.5  # innovations of an anchor that was refused for long are averaged over this time [s]
MOST = 8.0  # of these innovations, in standard deviations
FAR = 1.0  # what is refused by less may be a bias that the filter does not know of [m]
SETTLED = 1.0  # and it is heard again when their mean is below so many standard deviations


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


@register_jitable
def _level_row(R: np.ndarray, lever: np.ndarray, N: int) -> np.ndarray:
    """Return the row of the antenna's height, z of p + R l."""
    arm, H = R @ lever, np.zeros(N)
    H[2], H[6], H[7] = 1.0, arm[1], -arm[0]
    return H


@register_jitable
def _held(S: float, deviation: float) -> float:
    """Return the noise of a row that brings its variance S down to deviation², and no further.

    What is known of a height is known once: taken at every epoch as if it were new, it would soon be believed to death.
    """
    return 1.0 / (1.0 / deviation**2 - 1.0 / S)


@register_jitable
def _corrected(P, PH, S, e, p, v, R, b_g, b_a, c, g):  # type: ignore[no-untyped-def]
    """Return covariance and nominal state after a row with innovation e of variance S, and P H'."""
    n, dx = len(c), PH * (e / S)
    P = P - np.outer(PH, PH / S)
    P = (P + P.T) / 2.0
    R = turn(dx[6:9]) @ R
    c, g = c + dx[FIXED : FIXED + n], g + dx[FIXED + n :]
    return P, p + dx[:3], v + dx[3:6], R, b_g + dx[9:12], b_a + dx[12:15], c, g


@register_jitable
def _is_lost(
    t: float, refused_from: np.ndarray, heard_at: np.ndarray, mean: np.ndarray, far: np.ndarray, watch: Watch
) -> bool:
    """Return whether the refused ranges say that the filter is wrong, and not they.

    A range that is too long alone says little: it came by a detour. Three anchors that agree stand for the filter.
    """
    heard = refused = long_since = 0
    short = off = False
    for i in range(len(heard_at)):
        if heard_at[i] >= t - RECENT:
            heard += 1
            if refused_from[i] <= t - watch.refused:
                refused += 1
                short |= mean[i] < 0.0
                off |= far[i]
            if refused_from[i] <= t - PATIENCE * watch.refused:
                long_since += 1
    if refused < 2 or not off:
        return False
    if short:
        return heard - refused < 3 or refused > watch.share * heard
    return long_since >= 2 and heard - long_since < 3


@njit(cache=True)
def run_filter(
    events: Events,
    samples: np.ndarray,
    anchors: np.ndarray,
    lever: np.ndarray,
    start: State,
    anew: Anew,
    level: Level,
    noise: Noise,
    gravity: float,
    watch: Watch,
    whole: bool,
) -> tuple[Run, State, int]:
    """Run the filter over the events, to their end or until it is lost.

    Returns the run, the state behind it, and how many events it took in: fewer than there are if it was lost.

    Args:
        events: in order of time.
        samples: body rates and specific force, body axes (k, 6).
        anchors: positions (n, 3).
        lever: from the estimated point to the antenna, body axes (3).
        start: the state before the first event; the attitude's variance is 0 without an IMU.
        anew: position and velocity to start anew from.
        level: what is known of the height.
        noise: the noise.
        gravity: [m/s²].
        watch: when it is lost.
        whole: whether to keep what a smoother needs.
    """
    n, total = len(anchors), len(events.t)
    N = FIXED + 2 * n
    t, p, v, R, b_g, b_a, c, g, P, held, since = start
    w, f = held[:3].copy(), held[3:].copy()
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
    refused_from, heard_at = np.full(n, np.inf), np.full(n, -np.inf)
    far = np.zeros(n, dtype=np.bool_)  # whether it was refused by far
    mean = np.zeros(n)  # of the innovations of an anchor that is refused, in standard deviations
    epoch, heard, done = -1, 0, total
    for k in range(total):
        h = events.t[k] - t
        if h > 0.0:
            t = events.t[k]
            a = R @ (f - b_a)
            Phi = transition(h, R, a, noise, n)
            P = predicted(P, Phi, h, noise, n)
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
            astray = P[0, 0] + P[1, 1] + P[2, 2] > watch.astray**2
            lost = astray or _is_lost(t, refused_from, heard_at, mean, far, watch)
            if lost and events.kind[k] == RANGE and t >= watch.wait:
                done = k
                break
            epoch += 1
            t_out[epoch] = t
            begins = epoch == 0 and anew.variances[0] < np.inf
            if begins:
                for i in range(N):
                    P[i, i] += anew.opening[i]
            if whole:
                x_before[epoch] = np.concatenate((p, v, b_g, b_a, c, g))
                R_before[epoch], P_before[epoch], Phis[epoch] = R, P, since
                since = np.eye(N)
            if begins:
                for i in range(6):
                    PH, S = P[i].copy(), P[i, i] + anew.variances[i]
                    e = anew.x[i] - (p[i] if i < 3 else v[i - 3])
                    P, p, v, R, b_g, b_a, c, g = _corrected(P, PH, S, e, p, v, R, b_g, b_a, c, g)
            if P[5, 5] > level.climb**2:
                S = P[5, 5] + _held(P[5, 5], level.climb)
                P, p, v, R, b_g, b_a, c, g = _corrected(P, P[5].copy(), S, -v[2], p, v, R, b_g, b_a, c, g)
            if level.deviation < np.inf:
                H = _level_row(R, lever, N)
                PH = P @ H
                S = np.sum(H * PH)
                if level.deviation**2 < S:
                    e = level.height - p[2] - (R @ lever)[2]
                    S += _held(S, level.deviation)
                    P, p, v, R, b_g, b_a, c, g = _corrected(P, PH, S, e, p, v, R, b_g, b_a, c, g)
        if events.kind[k] == RANGE:
            i = events.which[k]
            distance, H = range_row(p, R, lever, anchors[i], i, n)
            e = events.r[k] - distance - c[i] - g[i]
            PH = P @ H
            S = np.sum(H * PH) + noise.range_white**2
            innovation[heard], variance[heard] = e, S
            z = e / np.sqrt(S)
            share = 1.0 if refused_from[i] == np.inf else 1.0 - np.exp((heard_at[i] - t) / SETTLES)
            mean[i] += share * (min(max(z, -MOST), MOST) - mean[i])
            heard_at[i] = t
            far[i] = (far[i] and refused_from[i] < np.inf) or abs(e) > FAR
            fades = far[i] and t - refused_from[i] >= watch.refused and abs(mean[i]) > SETTLED
            if e * e <= noise.gate**2 * S and not fades:
                taken[heard] = True
                refused_from[i] = np.inf
                P, p, v, R, b_g, b_a, c, g = _corrected(P, PH, S, e, p, v, R, b_g, b_a, c, g)
            elif refused_from[i] == np.inf:
                refused_from[i] = t
            heard += 1
        x_out[epoch] = np.concatenate((p, v, b_g, b_a, c, g))
        R_out[epoch], P_out[epoch] = R, P[:3, :3]
        if whole:
            P_after[epoch] = P
    m = epoch + 1
    kept = m if whole else 0
    run = Run(
        t_out[:m],
        x_out[:m],
        R_out[:m],
        P_out[:m],
        innovation[:heard],
        variance[:heard],
        taken[:heard],
        x_before[:kept],
        R_before[:kept],
        P_before[:kept],
        P_after[:kept],
        Phis[:kept],
    )
    return run, State(t, p, v, R, b_g, b_a, c, g, P, np.concatenate((w, f)), since), done
