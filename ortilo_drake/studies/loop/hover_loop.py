"""The flying loop at hover as matrices: what the theory starts from.

Everything is per tick of h, as deviations from hover. The state of the whole loop is [x; xhat; i] (27): the vehicle,
the filter's prediction of it, and the integral of the position error.
"""

from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_discrete_are

from ortilo_drake.model.hover import discretize, hover_A, hover_B, output_C
from ortilo_drake.model.signals import N_I, N_U, N_X, N_XBAR, SENSORS
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.estimator.kalman_filter import process_noise
from ortilo_drake.onboard.estimator.measurement_handler import arrival_matrix, selection_matrix
from ortilo_drake.onboard.servo.lq_gain import servo_gain
from ortilo_drake.scenario import Scenario

N_LOOP = N_X + N_XBAR


class HoverLoop(NamedTuple):
    """The matrices of a scenario's vehicle, filter and servo at hover.

    Attributes:
        Phi: x_{k+1} = Phi x_k + Gamma u_k + w_k (12 x 12).
        Gamma: (12 x 4).
        C: y = C x + v, rows uwb, camera, imu (9 x 12).
        W: covariance of w as the filter believes it (12 x 12), of rank 6 where it follows from the disturbance.
        L: servo gain, u = -L [xhat; i], or as loop_gain has it (4 x 15).
        h: tick [s].
        integrator: 'literal', 'hold' or 'estimate'.
        lends_velocities: whether the servo gets the true velocities and Euler rates in place of the estimated ones.
    """

    Phi: np.ndarray
    Gamma: np.ndarray
    C: np.ndarray
    W: np.ndarray
    L: np.ndarray
    h: float
    integrator: str
    lends_velocities: bool


def hover_loop(scenario: Scenario) -> HoverLoop:
    """Return the loop of a scenario; InputError if it has no servo gain."""
    Phi, Gamma = discretize(hover_A(), hover_B(scenario.vehicle), scenario.h)
    W = process_noise(scenario.estimator, scenario.vehicle, scenario.h)
    L = servo_gain(scenario.vehicle, scenario.servo.weights, scenario.h)
    lends = scenario.servo.velocities == "truth"
    return HoverLoop(Phi, Gamma, output_C(), W, L, scenario.h, scenario.estimator.integrator, lends)


def arrivals_of(sensors: tuple[str, ...]) -> np.ndarray:
    """Return delta (3), 1 for each of uwb, camera and imu that is named."""
    unknown = set(sensors) - set(SENSORS)
    if unknown:
        raise InputError(f"sensors: {', '.join(sorted(unknown))}: must be among {', '.join(SENSORS)}")
    return np.array([float(s in sensors) for s in SENSORS])


def steady_predictor(Phi: np.ndarray, C: np.ndarray, W: np.ndarray, V: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return K = Phi P C^T (C P C^T + V)^-1 and P, the steady one-step predictor of x.

    P = Phi P Phi^T + W - Phi P C^T (C P C^T + V)^-1 C P Phi^T, the filter's DARE. (Phi, C) must be detectable and V
    positive definite; theory/riccati/riccati.py checks both and says what is wrong.
    """
    P = solve_discrete_are(Phi.T, C.T, W, V)
    K = np.linalg.solve(C @ P @ C.T + V, C @ P @ Phi.T).T
    return K, P


def loop_gain(loop: HoverLoop) -> np.ndarray:
    """Return the servo gain on the whole loop's state, u = -L [x; xhat; i] (4 x 27).

    x has columns where the servo is given the true velocities and Euler rates, which then take those of their xhat.
    """
    L = np.hstack([np.zeros((N_U, N_X)), loop.L])
    if loop.lends_velocities:
        true, believed = slice(N_X // 2, N_X), slice(N_X + N_X // 2, 2 * N_X)
        L[:, true], L[:, believed] = L[:, believed].copy(), 0.0
    return L


def closed_loop_matrix(loop: HoverLoop, K: np.ndarray, delta: np.ndarray) -> np.ndarray:
    """Return A_cl (27 x 27) of [x; xhat; i] in a tick with those arrivals, reference 0 and no noise.

        u_k        = -L [x; xhat; i], L of loop_gain
        x_{k+1}    = Phi x + Gamma u
        xhat_{k+1} = Phi xhat + Gamma u + K Delta C (x - xhat)
        i_{k+1}    = i - E C x, or i - p_hat with the integrator 'estimate'  (paper, equations of servo and filter)

    Args:
        loop: the loop.
        K: predictor gain (12 x 9) at full size; columns of sensors that did not arrive are ignored.
        delta: arrivals of uwb, camera, imu (3).
    """
    KDC = K @ arrival_matrix(delta) @ loop.C
    by_control = loop.Gamma @ loop_gain(loop)
    A = np.zeros((N_LOOP, N_LOOP))
    x, xhat, i = slice(0, N_X), slice(N_X, 2 * N_X), slice(2 * N_X, N_LOOP)
    A[x, x] = A[xhat, xhat] = loop.Phi
    A[x] -= by_control
    A[xhat] -= by_control
    A[xhat, x] += KDC
    A[xhat, xhat] -= KDC
    A[i, i] = np.eye(N_I)
    if loop.integrator == "estimate":
        A[i, xhat] = -np.eye(N_I, N_X)
    else:
        A[i, x] = -selection_matrix(delta) @ loop.C
    return A
