"""Inertial propagation of state and covariance by one sample of gyroscope and accelerometer.

w are the body rates less their bias, averaged over this sample and the one before, f is the specific force less its
bias, and R_m the attitude half way (Forster et al., "On-manifold preintegration for real-time visual-inertial
odometry", IEEE Trans. Robotics 33, 2017; Sola, "Quaternion kinematics for the error-state Kalman filter", 2017):

    R' = R exp([w dt]x),  a = R_m f - g e_z,  v' = v + a dt,  p' = p + v dt + a dt^2 / 2

    theta' = exp([w dt]x)^T theta - dt db_g
    dv'    = dv - dt R_m [f]x theta_m - dt R_m db_a,   theta_m = exp([w dt / 2]x)^T theta - (dt / 2) db_g
    dp'    = dp + dt dv + (dt / 2) (dv' - dv)

A sample's noise adds dt n_g to theta and dt n_a to dv.
"""

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.model.elementary import arctan2, cos, sin, sin_cos
from ortilo_drake.model.placing import put
from ortilo_drake.model.vehicle import GRAVITY
from ortilo_drake.onboard.estimator.tight.layout import ACCEL, GYRO, N_INERTIAL, THETA, P, Q, V


@register_jitable
def turn(q: np.ndarray, x: float, y: float, z: float) -> None:
    """Replace the unit quaternion q by the one of R(q) exp([(x, y, z)]x); allocates no array, as it is called often."""
    half = 0.5 * np.sqrt(x * x + y * y + z * z)
    s = 0.5 * (1.0 - half * half / 6.0) if half < 1e-4 else 0.5 * sin(half) / half
    b_0, b_1, b_2, b_3 = cos(half), s * x, s * y, s * z
    w = q[0] * b_0 - q[1] * b_1 - q[2] * b_2 - q[3] * b_3
    i = q[0] * b_1 + q[1] * b_0 + q[2] * b_3 - q[3] * b_2
    j = q[0] * b_2 - q[1] * b_3 + q[2] * b_0 + q[3] * b_1
    k = q[0] * b_3 + q[1] * b_2 - q[2] * b_1 + q[3] * b_0
    norm = np.sqrt(w**2 + i**2 + j**2 + k**2)
    q[0], q[1], q[2], q[3] = w / norm, i / norm, j / norm, k / norm


@register_jitable
def turned(q: np.ndarray, x: float, y: float, z: float) -> np.ndarray:
    """Return the unit quaternion of R(q) exp([(x, y, z)]x)."""
    result = q.copy()
    turn(result, x, y, z)
    return result


@register_jitable
def matrix_of(q: np.ndarray) -> np.ndarray:
    """Return R_WB (3, 3) of the unit quaternion q_WB."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    return np.array(
        (
            (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
            (2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
            (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
        )
    )


@register_jitable
def quaternion_of(rpy: np.ndarray) -> np.ndarray:
    """Return the unit quaternion of R_z(psi) R_y(theta) R_x(phi)."""
    (s_0, c_0), (s_1, c_1), (s_2, c_2) = sin_cos(0.5 * rpy[0]), sin_cos(0.5 * rpy[1]), sin_cos(0.5 * rpy[2])
    return np.array(
        [
            c_0 * c_1 * c_2 + s_0 * s_1 * s_2,
            s_0 * c_1 * c_2 - c_0 * s_1 * s_2,
            c_0 * s_1 * c_2 + s_0 * c_1 * s_2,
            c_0 * c_1 * s_2 - s_0 * s_1 * c_2,
        ]
    )


@register_jitable
def angles_of(q: np.ndarray) -> np.ndarray:
    """Return roll, pitch and yaw [rad] of a unit quaternion; at theta = +-pi/2 roll and yaw are not unique."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    sine = min(1.0, max(-1.0, 2.0 * (w * y - z * x)))
    return np.array(
        [
            arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)),
            arctan2(sine, np.sqrt((1.0 - sine) * (1.0 + sine))),
            arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)),
        ]
    )


@cached_njit
def inertial_step(
    x: np.ndarray, A: np.ndarray, N: np.ndarray, w: np.ndarray, f: np.ndarray, dt: float, variances: np.ndarray
) -> None:
    """Propagate x, and the tick's transition A and noise covariance N so far, by one sample; all three are changed.

    A maps the fifteen inertial errors at the start of the tick to (dp, dv, theta) (9, 15); N is the covariance of the
    noise added to these since then (9, 9). w are the measured body rates, averaged over the step of dt [s], f is the
    measured specific force; `variances` are of one sample of both [rad^2/s^2], [m^2/s^4] (2).
    """
    wx, wy, wz = w[0] - x[Q + 4], w[1] - x[Q + 5], w[2] - x[Q + 6]
    fx, fy, fz = f[0] - x[Q + 7], f[1] - x[Q + 8], f[2] - x[Q + 9]
    R = matrix_of(turned(x[Q : Q + 4], 0.5 * dt * wx, 0.5 * dt * wy, 0.5 * dt * wz))
    turn(x[Q : Q + 4], dt * wx, dt * wy, dt * wz)
    for i in range(3):
        a = R[i, 0] * fx + R[i, 1] * fy + R[i, 2] * fz - (GRAVITY if i == 2 else 0.0)
        x[P + i] += dt * x[V + i] + 0.5 * dt * dt * a
        x[V + i] += dt * a
    # B = -dt R [f]x, the factor of theta, and D = exp([w dt]x)^T to second order.
    B = np.empty((3, 3))
    for i in range(3):
        B[i, 0] = -dt * (R[i, 1] * fz - R[i, 2] * fy)
        B[i, 1] = -dt * (R[i, 2] * fx - R[i, 0] * fz)
        B[i, 2] = -dt * (R[i, 0] * fy - R[i, 1] * fx)
    tx, ty, tz = dt * wx, dt * wy, dt * wz
    s = 0.5 * (tx * tx + ty * ty + tz * tz)
    D = np.array(
        (
            (1.0 - s + 0.5 * tx * tx, tz + 0.5 * tx * ty, -ty + 0.5 * tx * tz),
            (-tz + 0.5 * tx * ty, 1.0 - s + 0.5 * ty * ty, tx + 0.5 * ty * tz),
            (ty + 0.5 * tx * tz, -tx + 0.5 * ty * tz, 1.0 - s + 0.5 * tz * tz),
        )
    )
    half = np.array([0.5 * tx, 0.5 * ty, 0.5 * tz])
    _advance(A, B, D, R, half, dt, True)
    _advance(N, B, D, R, half, dt, False)  # first F N, then (F N) F^T on the columns
    _advance(N.T, B, D, R, half, dt, False)
    for i in range(3):
        N[V + i, V + i] += dt * dt * variances[1]
        N[THETA + i, THETA + i] += dt * dt * variances[0]


@register_jitable
def _advance(
    M: np.ndarray, B: np.ndarray, D: np.ndarray, R: np.ndarray, half: np.ndarray, dt: float, biased: bool
) -> None:
    """Replace the rows (dp, dv, theta) of M by F M; `biased` adds the effect of the biases to their columns of M."""
    for j in range(M.shape[1]):
        t0, t1, t2 = M[THETA, j], M[THETA + 1, j], M[THETA + 2, j]
        m0 = t0 - (half[1] * t2 - half[2] * t1)
        m1 = t1 - (half[2] * t0 - half[0] * t2)
        m2 = t2 - (half[0] * t1 - half[1] * t0)
        if biased and GYRO <= j < ACCEL:
            m0 -= 0.5 * dt if j == GYRO else 0.0
            m1 -= 0.5 * dt if j == GYRO + 1 else 0.0
            m2 -= 0.5 * dt if j == GYRO + 2 else 0.0
        for i in range(3):
            dv = B[i, 0] * m0 + B[i, 1] * m1 + B[i, 2] * m2
            if biased and ACCEL <= j < N_INERTIAL:
                dv -= dt * R[i, j - ACCEL]
            M[P + i, j] += dt * M[V + i, j] + 0.5 * dt * dv
            M[V + i, j] += dv
            turned_i = D[i, 0] * t0 + D[i, 1] * t1 + D[i, 2] * t2
            if biased and j == GYRO + i:
                turned_i -= dt
            M[THETA + i, j] = turned_i


@cached_njit
def propagate_covariance(
    C: np.ndarray, A: np.ndarray, N: np.ndarray, keeps: np.ndarray, steps: np.ndarray, scratch: np.ndarray
) -> None:
    """Propagate the covariance over a tick: C <- F C F^T + noise, symmetric.

    A is the transition from the first fifteen errors to the first nine (9, 15), N the noise covariance of the nine (9,
    9). Each further error from GYRO up to the clones (core - 9) is multiplied by its factor in `keeps` and gets its
    variance in `steps`. `scratch` is work memory (9, n).
    """
    n, core = C.shape[0], keeps.size + GYRO
    for i in range(GYRO):
        product = scratch[i]
        product[:] = 0.0
        for k in range(N_INERTIAL):
            if A[i, k] != 0.0:
                a, row = A[i, k], C[k]
                for j in range(n):
                    product[j] += a * row[j]
    # (A C)[:, :15] A^T in the corner; A C in the other columns.
    for j in range(GYRO, n):  # along the rows of C: along a column, each number would load a new cache line
        for i in range(GYRO):
            C[j, i] = scratch[i, j]
    for i in range(GYRO):
        put(scratch[i, GYRO:], C[i], GYRO)
        for j in range(i, GYRO):
            total = N[i, j]
            for k in range(N_INERTIAL):
                total += scratch[i, k] * A[j, k]
            C[i, j] = total
            C[j, i] = total
    end = GYRO
    while end < core:  # errors with keeps below 1, group by group: first their columns, then their rows
        first = end
        while end < core and keeps[end - GYRO] != 1.0:
            end += 1
        fading = keeps[first - GYRO : end - GYRO]
        if fading.size > 0:
            for i in range(n):
                columns = C[i, first:end]
                for j in range(fading.size):
                    columns[j] *= fading[j]
            for i in range(first, end):
                for j in range(n):
                    C[i, j] *= keeps[i - GYRO]
        end += 1
    for i in range(GYRO, core):
        C[i, i] += steps[i - GYRO]
