"""The Kalman filter's equations with intermittent, correlated measurements (paper, section IV-C).

State xbar = [x; i] (15): the vehicle's twelve states and the three integrals of the position error.

    xbar_{k+1} = Phibar xbar_k + Gammabar u_k + Ebar [w_k; v_k] + Ibar r_k,   y_k = H_k xbar_k + Delta_k v_k

with Phibar = [[Phi, 0], [-E C, I]], Gammabar = [Gamma; 0], Ebar = [[I, 0], [0, -E]], Cbar = [C, 0],
H_k = Delta_k Cbar, V1 = blkdiag(W, V2) and V12 = [0; V2], so that Ebar V12 = [0; -E V2]. As printed, with the
slips mended (Phibar and P_k throughout, V12^T Ebar^T in the last factor):

    K_k = (Phibar P_k H^T + Ebar V12) (H P_k H^T + V2)^-1                                       (gain)
    P_{k+1} = Phibar P_k Phibar^T + Ebar V1 Ebar^T - K_k (H P_k Phibar^T + V12^T Ebar^T)        (covariance)
    xhat_{k+1|k} = Phibar xhat_{k|k-1} + Gammabar u_k + Ibar r_k + K_k (y_k - H xhat_{k|k-1})   (prediction)

intermittent_step below is these three lines. filter_loops.py computes the same in half the time, and flies; a test
holds it to this one.

Rows that did not arrive are left out, which equals the full-size formula because V2 is block diagonal. The
integrator is a known quantity: from P_ii = 0 the last three rows of K equal -E_k, and its block of P stays 0.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numba.extending import register_jitable

from ortilo_drake.model.measurement import Layout

# What the last three states integrate. 'literal' (the paper) and 'hold' take the measured position and belong to
# the filter's model: i_{k+1} = i_k + r_k - E_k y_k, which 'hold' leaves out where E_k = 0. 'estimate' (the authors'
# code) takes i_{k+1} = i_k + r_k - xhat_k: the filter proper then has 12 states, and the integral only rides along.
INTEGRATOR_ESTIMATE, INTEGRATOR_LITERAL, INTEGRATOR_HOLD = 0, 1, 2
INTEGRATORS = {"estimate": INTEGRATOR_ESTIMATE, "literal": INTEGRATOR_LITERAL, "hold": INTEGRATOR_HOLD}


class FilterModel(NamedTuple):
    """What the filter believes of the vehicle.

    Attributes:
        Phi: discrete hover dynamics (12, 12).
        Gamma: discrete control input (12, 4).
        W: process noise covariance (12, 12).
        integrator: INTEGRATOR_ESTIMATE, INTEGRATOR_LITERAL or INTEGRATOR_HOLD.
    """

    Phi: np.ndarray
    Gamma: np.ndarray
    W: np.ndarray
    integrator: int


@register_jitable
def integrated_sensor(delta: np.ndarray, is_position: np.ndarray, integrator: int) -> int:
    """Return which sensor E_k selects: the first of those that measure the position and arrived, -1 for none.

    With the paper's sensors that is E_k = [Delta_1, not Delta_1 and Delta_2, 0].
    """
    if integrator != INTEGRATOR_ESTIMATE:
        for s in range(delta.shape[0]):
            if is_position[s] and delta[s] != 0.0:
                return s
    return -1


@register_jitable
def arrived_rows(delta: np.ndarray, first: np.ndarray) -> np.ndarray:
    """Return which rows of y arrived (m)."""
    rows = np.empty(first[-1], dtype=np.int64)
    m = 0
    for s in range(delta.shape[0]):
        if delta[s] != 0.0:
            for i in range(first[s], first[s + 1]):
                rows[m] = i
                m += 1
    return rows[:m]


@njit(cache=True)
def intermittent_step(
    xhat: np.ndarray,
    P: np.ndarray,
    y: np.ndarray,
    delta: np.ndarray,
    V2_blocks: np.ndarray,
    u: np.ndarray,
    r: np.ndarray,
    model: FilterModel,
    layout: Layout,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return xhat_{k+1|k} (15), P_{k+1} (15, 15) and K_k (15, p), the columns of what did not arrive 0.

    Args:
        xhat: xhat_{k|k-1} (15).
        P: P_k (15, 15).
        y: values (p).
        delta: arrivals (s).
        V2_blocks: the sensors' covariances, each row by row (q).
        u: control less hover (4).
        r: reference position (3).
        model: what the filter believes of the vehicle.
        layout: of the measurement.
    """
    Phi, Gamma, W, integrator = model
    arrived = arrived_rows(delta, layout.first)
    chosen = integrated_sensor(delta, layout.is_position, integrator)
    m = arrived.size

    H = np.zeros((m, 15))
    V2 = np.zeros((m, m))
    E = np.zeros((3, m))
    a = 0
    for s in range(delta.size):
        if delta[s] != 0.0:
            n = layout.first[s + 1] - layout.first[s]
            H[a : a + n, :12] = layout.C[layout.first[s] : layout.first[s + 1]]
            V2[a : a + n, a : a + n] = V2_blocks[layout.block[s] : layout.block[s + 1]].reshape(n, n)
            if s == chosen:
                E[:, a : a + n] = np.eye(3)
            a += n

    Phibar = np.eye(15)
    Phibar[:12, :12] = Phi
    Phibar[12:, :] -= E @ H
    Gammabar = np.zeros((15, 4))
    Gammabar[:12] = Gamma
    Ebar_V1_EbarT = np.zeros((15, 15))
    Ebar_V1_EbarT[:12, :12] = W
    Ebar_V1_EbarT[12:, 12:] = E @ V2 @ E.T
    Ebar_V12 = np.zeros((15, m))
    Ebar_V12[12:] = -E @ V2
    Ibar_r = np.zeros(15)
    if integrator == INTEGRATOR_ESTIMATE:
        Ibar_r[12:] = r[:3] - xhat[:3]
    elif integrator == INTEGRATOR_LITERAL or chosen >= 0:
        Ibar_r[12:] = r[:3]

    K = np.ascontiguousarray(np.linalg.solve(H @ P @ H.T + V2, (Phibar @ P @ H.T + Ebar_V12).T).T)
    P_next = Phibar @ P @ Phibar.T + Ebar_V1_EbarT - K @ (H @ P @ Phibar.T + Ebar_V12.T)
    xhat_next = Phibar @ xhat + Gammabar @ u + Ibar_r + K @ (y[arrived] - H @ xhat)

    gain = np.zeros((15, y.size))
    for a in range(m):
        gain[:, arrived[a]] = K[:, a]
    return xhat_next, (P_next + P_next.T) / 2.0, gain
