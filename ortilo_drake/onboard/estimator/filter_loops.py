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

from ortilo_drake.model.cholesky import solve_in_place
from ortilo_drake.model.measurement import Layout
from ortilo_drake.model.signals import N_X, N_XBAR
from ortilo_drake.onboard.estimator.intermittent_filter import (
    INTEGRATOR_ESTIMATE,
    INTEGRATOR_LITERAL,
    FilterModel,
    Numbers,
    arrived_rows,
    integrated_sensor,
    tilted_lift,
)


@register_jitable
def augmented_dynamics(Phi: np.ndarray, extra: Numbers, chosen: int, layout: Layout) -> np.ndarray:
    """Return Phibar = [[Phi, 0], [-E C, I]], with E C the rows of the chosen sensor."""
    _, states, weights, first, _, _ = layout
    N = N_X + len(extra)
    Phibar = np.zeros((N + 3, N + 3))
    Phibar[:N, :N] = Phi
    for i in range(3):
        Phibar[N + i, N + i] = 1.0
        if chosen >= 0:
            for w in range(states.shape[1]):
                Phibar[N + i, states[first[chosen] + i, w]] -= weights[first[chosen] + i, w]
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
    extra: Numbers,
    V2: np.ndarray,
    rows: np.ndarray,
    sensors: np.ndarray,
    chosen: int,
    layout: Layout,
) -> np.ndarray:
    """Return K^T (m, n) for the m rows of y that arrived.

    Args:
        P: covariance (n, n), symmetric.
        Phibar: augmented dynamics (n, n).
        extra: of the model.
        V2: covariances of the sensors (q).
        rows: which rows of y arrived (m).
        sensors: the sensor of each (m).
        chosen: what integrated_sensor returned.
        layout: of the measurement.
    """
    _, states, weights, first, block, _ = layout
    m, n = rows.shape[0], N_XBAR + len(extra)
    HP = np.zeros((m, n))
    KT = np.zeros((m, n))  # H P Phibar^T + V12^T Ebar^T, then K^T
    S = np.zeros((m, m))  # H P H^T + V2
    for a in range(m):
        for w in range(states.shape[1]):
            state, c = states[rows[a], w], weights[rows[a], w]
            for j in range(n):
                HP[a, j] += c * P[state, j]
    for i in range(n):
        for j in range(n):
            if Phibar[i, j] != 0.0:
                for a in range(m):
                    KT[a, i] += Phibar[i, j] * HP[a, j]
    for a in range(m):
        s = sensors[a]
        start = block[s] + (rows[a] - first[s]) * (first[s + 1] - first[s])
        if s == chosen:
            for i in range(3):
                KT[a, n - 3 + i] -= V2[start + i]
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
    extra: Numbers,
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
    m, n = rows.shape[0], N_XBAR + len(extra)
    FT = np.ascontiguousarray(Phibar.T)  # F = Phibar - K H
    for a in range(m):
        for w in range(states.shape[1]):
            state, c = states[rows[a], w], weights[rows[a], w]
            for i in range(n):
                FT[state, i] -= c * KT[a, i]
    FP = np.zeros((n, n))
    for i in range(n):
        for k in range(n):
            if FT[k, i] != 0.0:
                for j in range(n):
                    FP[i, j] += FT[k, i] * P[k, j]
    GT = KT.copy()  # G = K + [0; E]
    for a in range(m):
        if sensors[a] == chosen and rows[a] - first[chosen] < 3:
            GT[a, n - 3 + rows[a] - first[chosen]] += 1.0
    P_next[:] = 0.0
    P_next[: n - 3, : n - 3] = W
    GV = np.empty(n)  # a column of G V2
    for a in range(m):
        s = sensors[a]
        size, axis = first[s + 1] - first[s], rows[a] - first[s]
        GV[:] = 0.0
        for b in range(size):
            v = V2[block[s] + b * size + axis]
            for i in range(n):
                GV[i] += GT[a - axis + b, i] * v
        for i in range(n):
            for j in range(i, n):
                P_next[i, j] += GV[i] * GT[a, j]
    for i in range(n):
        for k in range(n):
            for j in range(i, n):
                P_next[i, j] += FP[i, k] * FT[k, j]
    for i in range(n):
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
    """Return [xhat_{k+1|k}, P_{k+1} row by row] (n + n^2) from the same of tick k. Arguments as intermittent_step."""
    Phi, Gamma, W, integrator, extra, Gamma_a, mass = model
    N, n = N_X + len(extra), N_XBAR + len(extra)
    _, states, weights, first, _, is_position = layout
    xhat, P = belief[:n], belief[n:].reshape(n, n)
    rows = arrived_rows(delta, first)
    sensors = sensors_of_rows(rows, first)
    chosen = integrated_sensor(delta, is_position, integrator)
    Phibar = augmented_dynamics(Phi, extra, chosen, layout)
    KT = transposed_gain(P, Phibar, extra, V2, rows, sensors, chosen, layout)

    out = np.empty(n + n * n)
    e = np.empty(rows.size)
    for a in range(rows.size):
        predicted = 0.0
        for w in range(states.shape[1]):
            predicted += weights[rows[a], w] * xhat[states[rows[a], w]]
        e[a] = y[rows[a]] - predicted
    for i in range(n):
        total = 0.0
        for j in range(n):
            total += Phibar[i, j] * xhat[j]
        for a in range(rows.size):
            total += KT[a, i] * e[a]
        out[i] = total
    for i in range(N):
        for j in range(4):
            out[i] += Gamma[i, j] * u[j]
    if len(extra) > 0:
        out[:N] += Gamma_a @ tilted_lift(xhat, u, mass)
    for i in range(3):
        if integrator == INTEGRATOR_ESTIMATE:
            out[N + i] += r[i] - xhat[i]
        elif integrator == INTEGRATOR_LITERAL or chosen >= 0:  # Ibar r
            out[N + i] += r[i]
    joseph(P, Phibar, extra, KT, W, V2, rows, sensors, chosen, layout, out[n:].reshape(n, n))
    return out


@njit(cache=True)
def filter_gain(
    P: np.ndarray,
    delta: np.ndarray,
    V2: np.ndarray,
    Phi: np.ndarray,
    integrator: int,
    layout: Layout,
    extra: Numbers = (),
) -> np.ndarray:
    """Return K_k at full size (n x p), its columns 0 where nothing arrived. Arguments as in filter_step."""
    _, _, _, first, _, is_position = layout
    rows = arrived_rows(delta, first)
    sensors = sensors_of_rows(rows, first)
    chosen = integrated_sensor(delta, is_position, integrator)
    K = np.zeros((N_XBAR + len(extra), first[-1]))
    KT = transposed_gain(P, augmented_dynamics(Phi, extra, chosen, layout), extra, V2, rows, sensors, chosen, layout)
    for a in range(rows.size):
        K[:, rows[a]] = KT[a]
    return K
