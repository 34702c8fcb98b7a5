"""Propagation between two events: the nominal state at once, the covariance when a row needs it."""

from typing import NamedTuple

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.model.vehicle import GRAVITY
from ortilo_drake.onboard.estimator.tight.drag import along_body, drag_step
from ortilo_drake.onboard.estimator.tight.inertial import inertial_step, matrix_of, propagate_covariance
from ortilo_drake.onboard.estimator.tight.layout import GYRO, N_INERTIAL, THETA, Q, V
from ortilo_drake.studies.recorded.filter_types import BIASES, TRANSITION, Aids, Noise, nominal
from ortilo_drake.studies.recorded.imu_watch import RESTS, SINCE

STEP = 0.01  # longest step of the propagation [s]
STALE, HOVERS = 0.1, (0.3, 2.0)  # age after which a sample no longer holds [s]; noise then [rad/s/√Hz, m/s²/√Hz]


class Passing(NamedTuple):
    """The motion accumulated since the covariance was last propagated, with N error states.

    Attributes:
        A: transition from the first fifteen errors and drag's dk to the first nine errors (9, 16).
        W: covariance of the noise that entered the first nine errors (9, 9).
        keeps: factor of each further error over the time (N - 9).
        walks: variance added to each further error (N - 9).
        scratch: room for products (9, N).
        time: time passed [s] (1).
    """

    A: np.ndarray
    W: np.ndarray
    keeps: np.ndarray
    walks: np.ndarray
    scratch: np.ndarray
    time: np.ndarray


@register_jitable
def empty_passing(N: int) -> Passing:
    """Return an empty Passing: no time has passed."""
    A, W = np.zeros((9, TRANSITION)), np.zeros((9, 9))
    for i in range(9):
        A[i, i] = 1.0
    return Passing(A, W, np.ones(N - GYRO), np.zeros(N - GYRO), np.empty((9, N)), np.zeros(1))


@register_jitable
def accumulate(
    x: np.ndarray,
    passing: Passing,
    h: float,
    held: np.ndarray,
    watched: np.ndarray,
    t: float,
    noise: Noise,
    aids: Aids,
    stale: bool,
) -> None:
    """Propagate nominal state, transition and noise by h, in steps; propagate_over does the errors that fade.

    Args:
        x: nominal state; changed.
        passing: the accumulated motion; changed.
        h: time [s].
        held: the imu's samples that hold (6).
        watched: see State.
        t: stamp at the start of the time [s].
        noise: the filter's noise.
        aids: drag, which may replace the accelerometer; its k is the last state.
        stale: whether the samples are too old to hold: then the body is taken to hover.
    """
    A, W = passing.A, passing.W
    passing.time[0] += h
    steps = int(np.ceil(h / STEP))
    dt = h / steps
    variances = np.array([noise.rotation**2 / dt, noise.acceleration**2 / dt])
    if stale:
        variances = np.array([max(noise.rotation, HOVERS[0]) ** 2 / dt, max(noise.acceleration, HOVERS[1]) ** 2 / dt])
    for _ in range(steps):
        w, f, R, v = held[:3].copy(), held[3:].copy(), matrix_of(x[Q : Q + 4]), x[V : V + 3].copy()
        if stale:
            w, f = x[Q + 4 : Q + 7].copy(), R[2] * GRAVITY + x[Q + 7 : Q + 10]
        if watched[RESTS] > 0.0:
            f = R[2] * GRAVITY + x[Q + 7 : Q + 10]
        for i in range(2):
            if watched[RESTS] == 0.0 and watched[SINCE + i] <= t:
                f[i] = x[Q + 7 + i] - x[-1] * along_body(R, v, i)
        place = x[:THETA].copy()
        inertial_step(x, A, W, w, f, dt, variances if watched[RESTS] == 0.0 else np.array([variances[0], 0.0]))
        if watched[RESTS] > 0.0:  # position and velocity stay, whatever tilt and biases are
            x[:THETA] = place
            A[:THETA], W[:THETA], W[:, :THETA] = 0.0, 0.0, 0.0
            for i in range(THETA):
                A[i, i] = 1.0
        for i in range(2):
            if watched[RESTS] == 0.0 and watched[SINCE + i] <= t:
                drag_step(A, W, R, v, i, x[-1], dt, aids.drag_sd**2)
                for j in range(3):
                    A[V + j, N_INERTIAL] -= dt * R[j, i] * along_body(R, v, i)


@register_jitable
def propagate_over(C: np.ndarray, x: np.ndarray, passing: Passing, grown: float, n: int, noise: Noise) -> None:
    """Propagate the covariance, and the errors of n anchors, over the time passed; call reset_passing afterwards.

    With range_tail, a large lasting error is expected to stay large. Behind metal an anchor errs by many standard
    deviations; a filter that expects only the usual error would move to a wrong place instead.
    """
    keeps, walks, passed = passing.keeps, passing.walks, passing.time[0]
    for i in range(n):
        keeps[BIASES + n + i - GYRO] = np.exp(-passed / noise.correlation_time)
        walks[BIASES + i - GYRO] = noise.bias_walk**2 * passed
        lasts = max(noise.range_correlated * grown, noise.range_tail * abs(x[nominal(BIASES + n + i)]))
        walks[BIASES + n + i - GYRO] = lasts**2 * (1.0 - keeps[BIASES + n + i - GYRO] ** 2)
        x[nominal(BIASES + n + i)] *= keeps[BIASES + n + i - GYRO]
    for i in range(3):
        walks[i], walks[3 + i] = noise.rotation_bias**2 * passed, noise.acceleration_bias**2 * passed
    propagate_covariance(C, passing.A, passing.W, keeps, walks, passing.scratch)
    if C[-1, -1] > 0.0:
        by_k = passing.A[:, N_INERTIAL]
        for i in range(9):
            C[i] += by_k[i] * C[-1]
        for i in range(9):
            C[:, i] += by_k[i] * C[:, -1]


@register_jitable
def reset_passing(passing: Passing) -> None:
    """Reset the accumulated motion to no time passed."""
    passing.A[:], passing.W[:], passing.time[0] = 0.0, 0.0, 0.0
    for i in range(9):
        passing.A[i, i] = 1.0
