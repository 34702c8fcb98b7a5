"""The vehicle linearised at hover, in continuous and discrete time (paper, section II-B).

At hover the vehicle rests with a heading psi, which is 0 in the paper. The heading turns only the axes along which tilt
accelerates. The deviation from hover obeys x_dot = A x + B u + B_d d, with u the control less [m g, 0, 0, 0] and d the
disturbance [force in W, torque in B]. A is nilpotent (A^4 = 0), so the series below are finite and exact.
"""

import math

import numpy as np

from ortilo_drake.model.signals import N_U, N_X, N_Y
from ortilo_drake.model.vehicle import GRAVITY, Vehicle


def hover_A(yaw: float = 0.0) -> np.ndarray:
    """Return A (12 x 12): [x_ddot, y_ddot] = R_z(yaw) [g theta, -g phi], with the held heading yaw [rad]."""
    c, s = math.cos(yaw), math.sin(yaw)
    A = np.zeros((N_X, N_X))
    A[0:6, 6:12] = np.eye(6)
    A[6, 3:5] = GRAVITY * s, GRAVITY * c
    A[7, 3:5] = -GRAVITY * c, GRAVITY * s
    return A


def hover_B(vehicle: Vehicle) -> np.ndarray:
    """Return B (12 x 4): z_ddot = f_T / m, and angular accelerations equal to torque over moment of inertia."""
    B = np.zeros((N_X, N_U))
    B[8, 0] = 1.0 / vehicle.mass
    B[9:12, 1:4] = np.diag(1.0 / np.array(vehicle.inertia))
    return B


def hover_B_d(vehicle: Vehicle) -> np.ndarray:
    """Return B_d (12 x 6), the input matrix of the disturbance force in W and torque in B."""
    B_d = np.zeros((N_X, 6))
    B_d[6:9, 0:3] = np.eye(3) / vehicle.mass
    B_d[9:12, 3:6] = np.diag(1.0 / np.array(vehicle.inertia))
    return B_d


def discretize(A: np.ndarray, B: np.ndarray, h: float) -> tuple[np.ndarray, np.ndarray]:
    """Return Phi = e^(Ah) and Gamma = int_0^h e^(As) ds B, exact for A^4 = 0.

    Phi = sum_k A^k h^k / k!,  Gamma = sum_k A^k h^(k+1) / (k+1)! B,  k = 0..3.
    """
    powers = [np.linalg.matrix_power(A, k) for k in range(4)]
    Phi = sum(M * h**k / math.factorial(k) for k, M in enumerate(powers))
    Gamma = sum(M * h ** (k + 1) / math.factorial(k + 1) for k, M in enumerate(powers)) @ B
    return np.asarray(Phi), np.asarray(Gamma)


def drag_D(drag: tuple[float, float, float], yaw: float = 0.0) -> np.ndarray:
    """Return D (3 x 3) of linear drag, force = -D v_WB at hover, given the coefficients along B's axes [N s/m]."""
    c, s = math.cos(yaw), math.sin(yaw)
    R_z = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return R_z @ np.diag(drag) @ R_z.T


def output_C() -> np.ndarray:
    """Return C (9 x 12): uwb and camera measure the position, the imu the three angles."""
    C = np.zeros((N_Y, N_X))
    C[0:3, 0:3] = C[3:6, 0:3] = C[6:9, 3:6] = np.eye(3)
    return C


def disturbance_W(vehicle: Vehicle, h: float, force_sd: float, torque_sd: float, yaw: float = 0.0) -> np.ndarray:
    """Return W (12 x 12) of a disturbance that is constant over each tick: Gamma_d diag(sd^2) Gamma_d^T.

    h is the tick [s], force_sd [N] and torque_sd [N m] are the standard deviations per axis, yaw is the held heading
    [rad].
    """
    _, Gamma_d = discretize(hover_A(yaw), hover_B_d(vehicle), h)
    return Gamma_d @ np.diag([force_sd**2] * 3 + [torque_sd**2] * 3) @ Gamma_d.T
