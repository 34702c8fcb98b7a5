"""A tick of the tight filter: propagate through the imu's samples to now, predict one tick ahead, store the pose.

If the imu is silent (samples are missing, or one sample repeats for ever), the last sample replaces the missing ones,
changed by the changes of thrust and torque. Its error grows, and stays similar for many ticks, as the error of a bias
does. So the bias states absorb it: their random walk is as fast as rates and force deviate from those of thrust and
torque, and ranges and boxes correct them. When samples come again, the biases return to their values from before.
"""

from typing import Final, NamedTuple

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.model.placing import put
from ortilo_drake.model.products import product, times
from ortilo_drake.model.signals import N_X
from ortilo_drake.onboard.estimator.tight.attitude_rows import inverse_rate_matrix, wrapped
from ortilo_drake.onboard.estimator.tight.inertial import angles_of, inertial_step, propagate_covariance
from ortilo_drake.onboard.estimator.tight.layout import ACCEL, ADDITIVE, GYRO, N_INERTIAL, THETA, Layout, P, Q, V

AFTER: Final = 0.1  # longest time without a sample that does not yet count as silence [s]
_N: Final = N_INERTIAL - GYRO  # number of biases of gyroscope and accelerometer

# Parts of `quiet`: last sample, its stamp, whether the imu is silent, biases and their variances before the silence.
_SAMPLE, _STAMP, _SILENT, _BIAS, _VARIANCE = 0, _N, _N + 1, _N + 2, 2 * _N + 2
N_QUIET: Final = 3 * _N + 2


@register_jitable
def is_repeated(sample: np.ndarray, quiet: np.ndarray) -> bool:
    """Return whether body rates and specific force (6) equal the last sample bit by bit; with noise they never do."""
    for i in range(_N):
        if sample[i] != quiet[_SAMPLE + i]:
            quiet[_SAMPLE : _SAMPLE + _N] = sample
            return False
    return True


@register_jitable
def in_silence(x: np.ndarray, C: np.ndarray, quiet: np.ndarray, now: float, h: float, silent: np.ndarray) -> None:
    """Let the biases of a silent imu walk for a tick of h [s] until t_k, `now` [s]; changes C and `quiet` (N_QUIET).

    `silent` is the variance per second of the walk of body rates and of specific force (2).
    """
    if now - quiet[_STAMP] <= AFTER:
        return
    if quiet[_SILENT] == 0.0:
        quiet[_SILENT] = 1.0
        for i in range(_N):
            quiet[_BIAS + i], quiet[_VARIANCE + i] = x[ADDITIVE + i], C[GYRO + i, GYRO + i]
    for i in range(_N):
        C[GYRO + i, GYRO + i] += h * silent[0 if GYRO + i < ACCEL else 1]


@register_jitable
def end_silence(x: np.ndarray, C: np.ndarray, held: np.ndarray, quiet: np.ndarray, stamp: float) -> None:
    """Store the stamp [s] of a sample that came; after a silence, restore the biases from before the silence.

    `held` has the body rates and the specific force that replaced samples (6); the change of the biases is added to
    them, so that `held` less the biases stays the same. Other arguments as in in_silence.
    """
    quiet[_STAMP] = stamp
    if quiet[_SILENT] == 0.0:
        return
    quiet[_SILENT] = 0.0
    for i in range(_N):
        held[i] += quiet[_BIAS + i] - x[ADDITIVE + i]
        x[ADDITIVE + i] = quiet[_BIAS + i]
        C[GYRO + i, :], C[:, GYRO + i] = 0.0, 0.0
    for i in range(_N):
        C[GYRO + i, GYRO + i] = quiet[_VARIANCE + i]


# Parts of `kept`, the memory of imu and control beside state and covariance; from QUIET on it is `quiet` above.
RATES, FORCE, TIME, THRUST, TORQUE, QUIET = 0, 3, 6, 7, 8, 11
N_KEPT = QUIET + N_QUIET
ROUNDING = 1e-9  # tolerance of times [s]
N_AHEAD = N_X + N_X * N_X  # size of the prediction for the next tick, estimate and covariance


class Motion(NamedTuple):
    """The tight filter's model of imu and vehicle."""

    variances: np.ndarray
    """noise variances of a sample's body rates [rad^2/s^2] and specific force [m^2/s^4] (2)."""
    coasting: np.ndarray
    """same as `variances`, for the values that replace samples in a tick without any (2)."""
    keeps: np.ndarray
    """factor on each additive error per tick (core - 9)."""
    steps: np.ndarray
    """variance added to each additive error per tick (core - 9)."""
    mass: float
    """mass of the vehicle [kg]."""
    inertia: np.ndarray
    """moments of inertia about the axes of B (3) [kg m^2]."""
    h: float
    """tick [s]."""
    silent: np.ndarray
    """variance per second of the biases' walk while the imu is silent: rates [rad^2/s^3], force [m^2/s^5] (2)."""
    watches: bool
    """whether the filter has a watch, and ignores samples and messages that repeat the one before."""
    yaw: float
    """heading that is held [rad]: the predicted yaw is within half a turn of it."""


@cached_njit
def propagate_to_now(
    x: np.ndarray,
    C: np.ndarray,
    kept: np.ndarray,
    samples: np.ndarray,
    now: float,
    motion: Motion,
    residual: np.ndarray,
) -> int:
    """Propagate x, C and `kept` (N_KEPT) to t_k, `now` [s]; return the number of imu samples that were used.

    The last sample replaces missing ones, with its specific force changed as the thrust was; in_silence changes the
    biases' variance then. `samples` are rows [arrived, stamp, rpy, body rates, specific force], oldest first (m, 11).
    The mean of measured less predicted angles [rad] goes to `residual` (3).
    """
    A, N = np.zeros((9, N_INERTIAL)), np.zeros((9, 9))
    for i in range(9):
        A[i, i] = 1.0
    residual[:] = 0.0
    count = 0
    for k in range(samples.shape[0]):
        stamp = samples[k, 1]
        if samples[k, 0] == 0.0 or stamp > now + ROUNDING or not np.isfinite(samples[k]).all():
            continue
        dt = stamp - kept[TIME]
        if dt < -ROUNDING or (motion.watches and is_repeated(samples[k, 5:11], kept[QUIET:])):
            continue
        end_silence(x, C, kept[RATES:TIME], kept[QUIET:], stamp)
        w, f = samples[k, 5:8], samples[k, 8:11]
        if dt > ROUNDING:
            inertial_step(x, A, N, 0.5 * (kept[RATES:FORCE] + w), f, dt, motion.variances)
        rpy = angles_of(x[Q : Q + 4])
        for i in range(3):
            residual[i] += wrapped(samples[k, 2 + i] - rpy[i])
        put(samples[k, 5:11], kept, RATES)
        kept[TIME] = stamp
        count += 1
    if count > 0:
        residual /= count
    dt = now - kept[TIME]
    if dt > ROUNDING:  # the rest of the tick, without a sample
        w, f = kept[RATES:FORCE].copy(), kept[FORCE:TIME].copy()
        w += dt * kept[TORQUE : TORQUE + 3] / motion.inertia
        inertial_step(x, A, N, 0.5 * (kept[RATES:FORCE] + w), f, dt, motion.coasting)
        put(w, kept, RATES)
        kept[TIME] = now
    propagate_covariance(C, A, N, motion.keeps, motion.steps, np.empty((9, C.shape[0])))
    for i in range(motion.keeps.size):
        if motion.keeps[i] != 1.0:
            x[ADDITIVE + i] *= motion.keeps[i]
    if count == 0:
        in_silence(x, C, kept[QUIET:], now, motion.h, motion.silent)
    return count


@cached_njit
def keep_pose(x: np.ndarray, C: np.ndarray, layout: Layout) -> None:
    """Insert the present pose as the first clone and drop the oldest clone."""
    if layout.clones == 0:
        return
    core, n = layout.core, layout.n
    for at in range(x.size - 1, core + 7, -1):
        x[at] = x[at - 7]
    put(x[P : P + 3], x, core + 1)
    put(x[Q : Q + 4], x, core + 4)
    for i in range(n - 1, core + 5, -1):
        put(C[i - 6], C[i])
    for k in range(3):
        put(C[P + k], C[core + k])
        put(C[THETA + k], C[core + 3 + k])
    for i in range(n):
        row = C[i]
        for j in range(n - 1, core + 5, -1):
            row[j] = row[j - 6]
        for k in range(3):
            row[core + k], row[core + 3 + k] = row[P + k], row[THETA + k]


@cached_njit
def predict_next_tick(
    x: np.ndarray, C: np.ndarray, kept: np.ndarray, u: np.ndarray, motion: Motion, ahead: np.ndarray
) -> None:
    """Write the prediction for the next tick, estimate (12) and covariance (144), to `ahead`.

    The specific force is the last one, changed by the change of thrust; the commanded torque changes the body rates.

    u is the control from now on (4), stored in `kept`. Other arguments as in propagate_to_now.
    """
    kept[FORCE + 2] += (u[0] - kept[THRUST]) / motion.mass
    put(u[:4], kept, THRUST)
    y, A, N = x.copy(), np.zeros((9, N_INERTIAL)), np.zeros((9, 9))
    for i in range(9):
        A[i, i] = 1.0
    w = kept[RATES:FORCE] + motion.h * u[1:4] / motion.inertia
    inertial_step(y, A, N, 0.5 * (kept[RATES:FORCE] + w), kept[FORCE:TIME], motion.h, motion.coasting)
    rpy = angles_of(y[Q : Q + 4])
    rpy[2] += 2.0 * np.pi * np.round((motion.yaw - rpy[2]) / (2.0 * np.pi))
    E = inverse_rate_matrix(rpy)
    put(y[P : P + 3], ahead)
    put(rpy, ahead, 3)
    put(y[V : V + 3], ahead, 6)
    put(times(E, w - y[ADDITIVE : ADDITIVE + 3]), ahead, 9)
    # Covariance of [dp, dv, theta, db_g] one tick ahead, then of the paper's states.
    D, T = C[:N_INERTIAL, :N_INERTIAL].copy(), np.zeros((12, 12))
    walks = N_INERTIAL - GYRO
    propagate_covariance(D, A, N, np.ones(walks), np.zeros(walks), np.empty((9, N_INERTIAL)))
    for i in range(3):
        D[GYRO + i, GYRO + i] += motion.variances[0] + motion.coasting[0]
        T[i, P + i], T[6 + i, V + i] = 1.0, 1.0
        for j in range(3):
            T[3 + i, THETA + j], T[9 + i, 9 + j] = E[i, j], -E[i, j]
    P_ahead = product(product(T, D[:12, :12]), T.T)
    for i in range(12):
        for j in range(12):
            ahead[12 + 12 * i + j] = 0.5 * (P_ahead[i, j] + P_ahead[j, i])
