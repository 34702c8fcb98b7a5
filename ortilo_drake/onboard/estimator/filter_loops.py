"""The step of intermittent_filter.py as loops over what is not zero, which takes half the time of its matrices.

The covariance is computed in Joseph form. The error obeys
xtilde_{k+1} = (Phibar - K H) xtilde_k + [w; 0] - (K + [0; E]) v, hence

    P_{k+1} = F P_k F^T + blkdiag(W, 0) + G V2 G^T,   F = Phibar - K H,   G = K + [0; E]        (Joseph)

which stays positive where the printed difference may not. The last three rows of G vanish.

Model and layout are unpacked, not read by name: a System hands them in as plain tuples, which numba takes in half the
time of named ones.
"""

import numpy as np
from numba import njit
from numba.extending import register_jitable

from ortilo_drake.model.measurement import Layout
from ortilo_drake.onboard.estimator.intermittent_filter import (
    INTEGRATOR_ESTIMATE,
    INTEGRATOR_LITERAL,
    FilterModel,
    arrived_rows,
    integrated_sensor,
)


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
def sensors_of_rows(rows: np.ndarray, first: np.ndarray) -> np.ndarray:
    """Return the sensor of each row that arrived (m)."""
    sensors = np.empty_like(rows)
    s = 0
    for a in range(rows.size):
        while rows[a] >= first[s + 1]:
            s += 1
        sensors[a] = s
    return sensors


@register_jitable
def transposed_gain(
    P: np.ndarray,
    Phibar: np.ndarray,
    V2: np.ndarray,
    rows: np.ndarray,
    sensors: np.ndarray,
    chosen: int,
    layout: Layout,
) -> np.ndarray:
    """Return K^T (m, 15) for the m rows of y that arrived.

    Args:
        P: covariance (15, 15), symmetric.
        Phibar: augmented dynamics (15, 15).
        V2: covariances of the sensors (q).
        rows: which rows of y arrived (m).
        sensors: the sensor of each (m).
        chosen: what integrated_sensor returned.
        layout: of the measurement.
    """
    _, states, weights, first, block, _ = layout
    m = rows.shape[0]
    HP = np.zeros((m, 15))
    KT = np.zeros((m, 15))  # H P Phibar^T + V12^T Ebar^T, then K^T
    S = np.zeros((m, m))  # H P H^T + V2
    for a in range(m):
        for w in range(states.shape[1]):
            state, c = states[rows[a], w], weights[rows[a], w]
            for j in range(15):
                HP[a, j] += c * P[state, j]
    for a in range(m):
        s = sensors[a]
        n, start = first[s + 1] - first[s], block[s] + (rows[a] - first[s]) * (first[s + 1] - first[s])
        for i in range(15):
            for j in range(15):
                if Phibar[i, j] != 0.0:
                    KT[a, i] += Phibar[i, j] * HP[a, j]
        if s == chosen:
            for i in range(n):
                KT[a, 12 + i] -= V2[start + i]
        for b in range(m):
            for w in range(states.shape[1]):
                S[a, b] += weights[rows[b], w] * HP[a, states[rows[b], w]]
            if sensors[b] == s:
                S[a, b] += V2[start + rows[b] - first[s]]
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
    sensors: np.ndarray,
    chosen: int,
    layout: Layout,
    P_next: np.ndarray,
) -> None:
    """Write P_{k+1} = F P F^T + blkdiag(W, 0) + G V2 G^T, symmetric, to P_next. Arguments as transposed_gain."""
    _, states, weights, first, block, _ = layout
    m = rows.shape[0]
    FT = np.empty((15, 15))  # F = Phibar - K H
    for i in range(15):
        for j in range(15):
            FT[j, i] = Phibar[i, j]
    for a in range(m):
        for w in range(states.shape[1]):
            state, c = states[rows[a], w], weights[rows[a], w]
            for i in range(15):
                FT[state, i] -= c * KT[a, i]
    FP = np.zeros((15, 15))
    for i in range(15):
        for k in range(15):
            if FT[k, i] != 0.0:
                for j in range(15):
                    FP[i, j] += FT[k, i] * P[k, j]
    GT = KT.copy()  # G = K + [0; E]
    for a in range(m):
        if sensors[a] == chosen:
            GT[a, 12 + rows[a] - first[chosen]] += 1.0
    P_next[:] = 0.0
    P_next[:12, :12] = W
    GV = np.empty(15)  # a column of G V2
    for a in range(m):
        s = sensors[a]
        n, axis = first[s + 1] - first[s], rows[a] - first[s]
        GV[:] = 0.0
        for b in range(n):
            v = V2[block[s] + b * n + axis]
            for i in range(15):
                GV[i] += GT[a - axis + b, i] * v
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


@njit(cache=True)
def filter_step(
    belief: np.ndarray,
    y: np.ndarray,
    delta: np.ndarray,
    V2: np.ndarray,
    u: np.ndarray,
    r: np.ndarray,
    model: FilterModel,
    layout: Layout,
) -> np.ndarray:
    """Return [xhat_{k+1|k}, P_{k+1} row by row] (240) from the same of tick k. Arguments as intermittent_step."""
    Phi, Gamma, W, integrator = model
    _, states, weights, first, _, is_position = layout
    xhat, P = belief[:15], belief[15:].reshape(15, 15)
    rows = arrived_rows(delta, first)
    sensors = sensors_of_rows(rows, first)
    chosen = integrated_sensor(delta, is_position, integrator)
    Phibar = augmented_dynamics(Phi, chosen)
    KT = transposed_gain(P, Phibar, V2, rows, sensors, chosen, layout)

    out = np.empty(240)
    e = np.empty(rows.size)
    for a in range(rows.size):
        predicted = 0.0
        for w in range(states.shape[1]):
            predicted += weights[rows[a], w] * xhat[states[rows[a], w]]
        e[a] = y[rows[a]] - predicted
    for i in range(15):
        total = 0.0
        for j in range(15):
            total += Phibar[i, j] * xhat[j]
        for a in range(rows.size):
            total += KT[a, i] * e[a]
        out[i] = total
    for i in range(12):
        for j in range(4):
            out[i] += Gamma[i, j] * u[j]
    for i in range(3):
        if integrator == INTEGRATOR_ESTIMATE:
            out[12 + i] += r[i] - xhat[i]
        elif integrator == INTEGRATOR_LITERAL or chosen >= 0:  # Ibar r
            out[12 + i] += r[i]
    joseph(P, Phibar, KT, W, V2, rows, sensors, chosen, layout, out[15:].reshape(15, 15))
    return out


@njit(cache=True)
def filter_gain(
    P: np.ndarray, delta: np.ndarray, V2: np.ndarray, Phi: np.ndarray, integrator: int, layout: Layout
) -> np.ndarray:
    """Return K_k at full size (15 x p), its columns 0 where nothing arrived. Arguments as in filter_step."""
    _, _, _, first, _, is_position = layout
    rows = arrived_rows(delta, first)
    sensors = sensors_of_rows(rows, first)
    chosen = integrated_sensor(delta, is_position, integrator)
    K = np.zeros((15, first[-1]))
    KT = transposed_gain(P, augmented_dynamics(Phi, chosen), V2, rows, sensors, chosen, layout)
    for a in range(rows.size):
        K[:, rows[a]] = KT[a]
    return K
