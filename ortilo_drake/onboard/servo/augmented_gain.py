"""The LQ gain of a plant whose commands act late, with the commands on the way as states.

With tau = (d - theta) h, whole d and 0 <= theta < 1, and Gamma(s) = int_0^s e^(A r) dr B,

    x_{k+1} = Phi x_k + (Gamma(h) - Gamma(theta h)) u_{k-d} + Gamma(theta h) u_{k-d+1}

(K. J. Åström and B. Wittenmark, "Computer-Controlled Systems", on systems with time delay). The state
[x; i; u_{k-1}; ...; u_{k-d}] has no delay. Its LQ gain with Q on [x; i] and R on u_k is, for a whole number of ticks,
L [Phibar^d, Gammabar, Phibar Gammabar, ...]: the gain without a delay on the state predicted to the command's time.
"""

import math

import numpy as np

from ortilo_drake.model.hover import discretize, hover_A, hover_B
from ortilo_drake.model.signals import N_U, N_X, N_XBAR
from ortilo_drake.model.vehicle import Vehicle
from ortilo_drake.onboard.servo.lq_gain import augmented_pair, lq_gain, weight_matrices
from ortilo_drake.scenario import ServoWeights


def split_delay(delay: float, h: float) -> tuple[int, float]:
    """Return d and theta of a delay [s] in ticks of h [s]; what is a whole tick up to rounding is one."""
    d = math.ceil(delay / h - 1e-9)
    return d, max(0.0, d - delay / h)


def delayed_pair(vehicle: Vehicle, h: float, delay: float, yaw: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Return Phi and Gamma of [x; i; u_{k-1}; ...; u_{k-d}], n = 15 + 4 d; delay [s], yaw held [rad]."""
    Phibar, Gammabar = augmented_pair(vehicle, h, yaw)
    d, theta = split_delay(delay, h)
    n = N_XBAR + N_U * d
    Phi, Gamma = np.zeros((n, n)), np.zeros((n, N_U))
    Phi[:N_XBAR, :N_XBAR] = Phibar
    if d == 0:
        return Phibar, Gammabar
    late = np.zeros_like(Gammabar)
    late[:N_X] = discretize(hover_A(yaw), hover_B(vehicle), theta * h)[1]
    Phi[:N_XBAR, n - N_U :] = Gammabar - late
    if d == 1:
        Gamma[:N_XBAR] = late
    else:
        Phi[:N_XBAR, n - 2 * N_U : n - N_U] = late
    Gamma[N_XBAR : N_XBAR + N_U] = np.eye(N_U)
    Phi[N_XBAR + N_U :, N_XBAR : n - N_U] = np.eye(n - N_XBAR - N_U)
    return Phi, Gamma


def delayed_gain(vehicle: Vehicle, weights: ServoWeights, h: float, delay: float, yaw: float = 0.0) -> np.ndarray:
    """Return L (4 x 15 + 4 d) of delayed_pair; raises as lq_gain."""
    Phi, Gamma = delayed_pair(vehicle, h, delay, yaw)
    Q, R = weight_matrices(weights)
    wide = np.zeros_like(Phi)
    wide[:N_XBAR, :N_XBAR] = Q
    return lq_gain(Phi, Gamma, wide, R)[0]
