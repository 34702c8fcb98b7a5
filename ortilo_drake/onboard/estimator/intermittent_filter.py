"""The Kalman filter's equations with intermittent, correlated measurements (paper, section IV-C).

State xbar = [x; i] (15): the vehicle's twelve states and the three integrals of the position error.

    xbar_{k+1} = Phibar xbar_k + Gammabar u_k + Ebar [w_k; v_k] + Ibar r_k,   y_k = H_k xbar_k + Delta_k v_k

with Phibar = [[Phi, 0], [-E C, I]], Gammabar = [Gamma; 0], Ebar = [[I, 0], [0, -E]], Cbar = [C, 0],
H_k = Delta_k Cbar, V1 = blkdiag(W, V2) and V12 = [0; V2], so that Ebar V12 = [0; -E V2]. As printed, with the
slips mended (Phibar and P_k throughout, V12^T Ebar^T in the last factor):

    K_k = (Phibar P_k H^T + Ebar V12) (H P_k H^T + V2)^-1                                       (gain)
    P_{k+1} = Phibar P_k Phibar^T + Ebar V1 Ebar^T - K_k (H P_k Phibar^T + V12^T Ebar^T)        (covariance)
    xhat_{k+1|k} = Phibar xhat_{k|k-1} + Gammabar u_k + Ibar r_k + K_k (y_k - H xhat_{k|k-1})   (prediction)

The covariance is computed in Joseph form. The error obeys
xtilde_{k+1} = (Phibar - K H) xtilde_k + [w; 0] - (K + [0; E]) v, hence

    P_{k+1} = F P_k F^T + blkdiag(W, 0) + G V2 G^T,   F = Phibar - K H,   G = K + [0; E]        (Joseph)

Rows that did not arrive are left out, which equals the full-size formula because V2 is block diagonal. The
integrator is a known quantity: from P_ii = 0 the last three rows of K equal -E_k, those of G vanish, and the
integrator's block of P stays 0.
"""

import numpy as np
from numba import njit
from numba.extending import register_jitable

# Row j of C selects this state: uwb and camera see the position, the imu the angles.
STATE_OF_ROW = np.array([0, 1, 2, 0, 1, 2, 3, 4, 5])

# What the last three states integrate. 'literal' (the paper) and 'hold' take the measured position and belong to
# the filter's model: i_{k+1} = i_k + r_k - E_k y_k, which 'hold' leaves out where E_k = 0. 'estimate' (the authors'
# code) takes i_{k+1} = i_k + r_k - xhat_k: the filter proper then has 12 states, and the integral only rides along.
INTEGRATOR_ESTIMATE, INTEGRATOR_LITERAL, INTEGRATOR_HOLD = 0, 1, 2
INTEGRATORS = {"estimate": INTEGRATOR_ESTIMATE, "literal": INTEGRATOR_LITERAL, "hold": INTEGRATOR_HOLD}


@register_jitable
def solve_in_place(S: np.ndarray, X: np.ndarray) -> None:
    """Overwrite X (m, n) by S^-1 X through S's Cholesky factor, which overwrites S's lower half."""
    m, n = X.shape
    for i in range(m):
        for j in range(i):
            for k in range(j):
                S[i, j] -= S[i, k] * S[j, k]
            S[i, j] /= S[j, j]
            S[i, i] -= S[i, j] ** 2
        S[i, i] = np.sqrt(S[i, i])
    for i in range(m):
        for k in range(i):
            for c in range(n):
                X[i, c] -= S[i, k] * X[k, c]
        for c in range(n):
            X[i, c] /= S[i, i]
    for i in range(m - 1, -1, -1):
        for k in range(i + 1, m):
            for c in range(n):
                X[i, c] -= S[k, i] * X[k, c]
        for c in range(n):
            X[i, c] /= S[i, i]


@register_jitable
def integrated_sensor(delta: np.ndarray, integrator: int) -> int:
    """Return which sensor E_k = [Delta_1, not Delta_1 and Delta_2, 0] selects: 0 uwb, 1 camera, -1 none."""
    if integrator == INTEGRATOR_ESTIMATE:
        return -1
    if delta[0] != 0.0:
        return 0
    return 1 if delta[1] != 0.0 else -1


@register_jitable
def augmented_dynamics(Phi: np.ndarray, chosen: int) -> np.ndarray:
    """Return Phibar = [[Phi, 0], [-E C, I]]; E C selects the position where a sensor is chosen."""
    Phibar = np.zeros((15, 15))
    Phibar[:12, :12] = Phi
    for i in range(12, 15):
        Phibar[i, i] = 1.0
        if chosen >= 0:
            Phibar[i, i - 12] = -1.0
    return Phibar


@register_jitable
def transposed_gain(P: np.ndarray, Phibar: np.ndarray, V2: np.ndarray, rows: np.ndarray, chosen: int) -> np.ndarray:
    """Return K^T (m, 15) for the m rows of y that arrived.

    Args:
        P: covariance (15, 15), symmetric.
        Phibar: augmented dynamics (15, 15).
        V2: covariances of the three sensors (3, 3, 3).
        rows: which rows of y arrived (m).
        chosen: what integrated_sensor returned.
    """
    m = rows.shape[0]
    KT = np.zeros((m, 15))  # H P Phibar^T + V12^T Ebar^T, then K^T
    S = np.empty((m, m))  # H P H^T + V2
    for a in range(m):
        state, sensor, axis = STATE_OF_ROW[rows[a]], rows[a] // 3, rows[a] % 3
        for i in range(15):
            for j in range(15):
                if Phibar[i, j] != 0.0:
                    KT[a, i] += Phibar[i, j] * P[state, j]
        if sensor == chosen:
            for i in range(3):
                KT[a, 12 + i] -= V2[sensor, axis, i]
        for b in range(m):
            S[a, b] = P[state, STATE_OF_ROW[rows[b]]]
            if rows[b] // 3 == sensor:
                S[a, b] += V2[sensor, axis, rows[b] % 3]
    solve_in_place(S, KT)
    return KT


@register_jitable
def joseph(
    P: np.ndarray,
    Phibar: np.ndarray,
    KT: np.ndarray,
    W: np.ndarray,
    V2: np.ndarray,
    rows: np.ndarray,
    chosen: int,
) -> np.ndarray:
    """Return P_{k+1} = F P F^T + blkdiag(W, 0) + G V2 G^T, exactly symmetric. Arguments as transposed_gain."""
    m = rows.shape[0]
    FT = np.empty((15, 15))  # F = Phibar - K H
    for i in range(15):
        for j in range(15):
            FT[j, i] = Phibar[i, j]
    for a in range(m):
        for i in range(15):
            FT[STATE_OF_ROW[rows[a]], i] -= KT[a, i]
    FP = np.zeros((15, 15))
    for i in range(15):
        for k in range(15):
            if FT[k, i] != 0.0:
                for j in range(15):
                    FP[i, j] += FT[k, i] * P[k, j]
    GT = KT.copy()  # G = K + [0; E]
    for a in range(m):
        if rows[a] // 3 == chosen:
            GT[a, 12 + rows[a] % 3] += 1.0
    P_next = np.zeros((15, 15))
    P_next[:12, :12] = W
    GV = np.empty(15)  # a column of G V2
    for a in range(m):
        sensor, axis = rows[a] // 3, rows[a] % 3
        first = a - axis
        for i in range(15):
            GV[i] = (
                GT[first, i] * V2[sensor, 0, axis]
                + GT[first + 1, i] * V2[sensor, 1, axis]
                + GT[first + 2, i] * V2[sensor, 2, axis]
            )
        for i in range(15):
            for j in range(i, 15):
                P_next[i, j] += GV[i] * GT[a, j]
    for i in range(15):
        for k in range(15):
            for j in range(i, 15):
                P_next[i, j] += FP[i, k] * FT[k, j]
    for i in range(15):
        for j in range(i):
            P_next[i, j] = P_next[j, i]
    return P_next


@njit(cache=True)
def filter_step(
    xhat: np.ndarray,
    P_flat: np.ndarray,
    measurement: np.ndarray,
    u: np.ndarray,
    r: np.ndarray,
    Phi: np.ndarray,
    Gamma: np.ndarray,
    W: np.ndarray,
    integrator: int,
) -> np.ndarray:
    """Return [xhat_{k+1|k}, P_{k+1} row by row] (240).

    Args:
        xhat: xhat_{k|k-1} (15).
        P_flat: P_k row by row (225).
        measurement: [y (9), delta (3), V2's blocks row by row (27)], see model/signals.py.
        u: control less hover (4).
        r: reference position, of which the first three entries are read.
        Phi: discrete hover dynamics (12, 12).
        Gamma: discrete control input (12, 4).
        W: process noise covariance (12, 12).
        integrator: INTEGRATOR_ESTIMATE, INTEGRATOR_LITERAL or INTEGRATOR_HOLD.
    """
    P = P_flat.reshape(15, 15)
    y, delta, V2 = measurement[:9], measurement[9:12], measurement[12:39].reshape(3, 3, 3)
    rows = np.empty(9, dtype=np.int64)
    m = 0
    for s in range(3):
        if delta[s] != 0.0:
            for i in range(3):
                rows[m] = 3 * s + i
                m += 1
    rows = rows[:m]
    chosen = integrated_sensor(delta, integrator)
    Phibar = augmented_dynamics(Phi, chosen)
    KT = transposed_gain(P, Phibar, V2, rows, chosen)

    out = np.empty(240)
    for i in range(15):
        total = 0.0
        for j in range(15):
            total += Phibar[i, j] * xhat[j]
        for a in range(m):
            total += KT[a, i] * (y[rows[a]] - xhat[STATE_OF_ROW[rows[a]]])
        out[i] = total
    for i in range(12):
        for j in range(4):
            out[i] += Gamma[i, j] * u[j]
    for i in range(3):
        if integrator == INTEGRATOR_ESTIMATE:
            out[12 + i] += r[i] - xhat[i]
        elif integrator == INTEGRATOR_LITERAL or chosen >= 0:  # Ibar r
            out[12 + i] += r[i]
    out[15:] = joseph(P, Phibar, KT, W, V2, rows, chosen).ravel()
    return out


@njit(cache=True)
def filter_gain(P: np.ndarray, delta: np.ndarray, V2: np.ndarray, Phi: np.ndarray, integrator: int) -> np.ndarray:
    """Return K_k at full size (15 x 9), its columns 0 where nothing arrived. Arguments as in filter_step."""
    rows = np.array([r for r in range(9) if delta[r // 3] != 0.0], dtype=np.int64)
    chosen = integrated_sensor(delta, integrator)
    K = np.zeros((15, 9))
    K[:, rows] = transposed_gain(P, augmented_dynamics(Phi, chosen), V2, rows, chosen).T
    return K
