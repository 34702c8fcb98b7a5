"""The step of intermittent_filter.py as loops over what is not zero, faster than its matrices.

Of xbar = [x; e; i] the integral is known: from P_ii = 0 the printed equations leave K_i = -E and P_ii = 0, so that

    i_{k+1} = i_k + r_k - E y_k

and the rest is a Kalman filter of the N states [x; e], measured and then propagated, Phibar K the printed gain. The
covariances of the sensors are blocks of V2, so one sensor is taken after the other:

    S = C P C^T + V,   K = P C^T S^-1,   x^ <- x^ + K (y - C x^),   P <- P - K C P - (K C P)^T + K S K^T
    x^ <- Phi x^ + Gamma u,   P <- Phi P Phi^T + W

The covariance's measurement step is Joseph's (I - K C) P (I - K C)^T + K V K^T, multiplied out: an error of K enters it
squared, so that it stays positive where the printed difference may not.

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
    integrated_sensor,
    tilted_lift,
)


@register_jitable
def measure(
    x: np.ndarray, P: np.ndarray, y: np.ndarray, V: np.ndarray, states: np.ndarray, weights: np.ndarray, extra: Numbers
) -> None:
    """Change an estimate and its covariance by what one sensor measured.

    Args:
        x: estimate of [x; e] (N).
        P: its covariance (N, N).
        y: values (m).
        V: their covariance (m, m).
        states: which states each row sees (m, w).
        weights: with which coefficients (m, w).
        extra: of the model.
    """
    m, N = y.size, N_X + len(extra)
    threes = m + (-m) % 3  # P is passed over once for three rows, those that are not there 0
    CP, KT, S, e = np.zeros((threes, N)), np.zeros((threes, N)), V.copy(), y.copy()
    for a in range(m):
        for w in range(states.shape[1]):
            state, c = states[a, w], weights[a, w]
            e[a] -= c * x[state]
            for j in range(N):
                CP[a, j] += c * P[state, j]
    for a in range(m):
        for b in range(m):
            for w in range(states.shape[1]):
                S[a, b] += weights[b, w] * CP[a, states[b, w]]
    KT[:] = CP
    solve_in_place(S.copy(), KT[:m])
    for a in range(m):  # C P - S K^T / 2, so that two products of it are the three that are taken from P
        for j in range(N):
            x[j] += KT[a, j] * e[a]
        for b in range(m):
            for j in range(N):
                CP[a, j] -= 0.5 * S[a, b] * KT[b, j]
    for i in range(N):
        for a in range(0, threes, 3):
            K_0, K_1, K_2 = KT[a, i], KT[a + 1, i], KT[a + 2, i]
            D_0, D_1, D_2 = CP[a, i], CP[a + 1, i], CP[a + 2, i]
            for j in range(N):
                P[i, j] -= K_0 * CP[a, j] + K_1 * CP[a + 1, j] + K_2 * CP[a + 2, j]
                P[i, j] -= D_0 * KT[a, j] + D_1 * KT[a + 1, j] + D_2 * KT[a + 2, j]


@register_jitable
def nonzero_columns(A: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return which columns of each row are not 0 (N, N), of which the first so many are meant (N)."""
    columns, counts = np.empty(A.shape, np.uint8), np.zeros(A.shape[0], np.int64)
    for i in range(A.shape[0]):
        for k in range(A.shape[1]):
            columns[i, counts[i]] = k  # overwritten by the next where it is none
            counts[i] += A[i, k] != 0.0
    return columns, counts


@register_jitable
def propagate(P: np.ndarray, Phi: np.ndarray, W: np.ndarray, extra: Numbers, out: np.ndarray) -> None:
    """Write Phi P Phi^T + W, symmetric, to the first N rows and columns of out, and 0 to the others."""
    N = N_X + len(extra)
    columns, counts = nonzero_columns(Phi)
    PPhiT, half = np.empty((N, N)), np.empty((N, N))
    for i in range(N):
        half[i] = 0.0
        for c in range(counts[i]):
            k, f = columns[i, c], Phi[i, columns[i, c]]
            for j in range(N):
                half[i, j] += f * P[k, j]
    for i in range(N):
        for j in range(N):
            PPhiT[j, i] = half[i, j]
    out[:] = 0.0
    for i in range(N):
        half[i] = W[i]
        for c in range(counts[i]):
            k, f = columns[i, c], Phi[i, columns[i, c]]
            for j in range(N):
                half[i, j] += f * PPhiT[k, j]
        for j in range(i, N):
            out[i, j] = half[i, j]
            out[j, i] = half[i, j]


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
    """Return [xhat_{k+1|k}, P_{k+1} row by row] (n + n^2) from the same of tick k, in which P_ii = 0.

    Arguments as intermittent_step.
    """
    Phi, Gamma, W, integrator, extra, Gamma_a, mass = model
    N, n = N_X + len(extra), N_XBAR + len(extra)
    _, states, weights, first, block, is_position = layout
    x, P = belief[:N].copy(), belief[n:].reshape(n, n)[:N, :N].copy()
    for s in range(delta.size):
        if delta[s] != 0.0:
            rows, m = slice(first[s], first[s + 1]), first[s + 1] - first[s]
            V = V2[block[s] : block[s + 1]].reshape(m, m)
            measure(x, P, y[rows], V, states[rows], weights[rows], extra)

    out = np.empty(n + n * n)
    for i in range(N):
        total = 0.0
        for j in range(N):
            total += Phi[i, j] * x[j]
        for j in range(4):
            total += Gamma[i, j] * u[j]
        out[i] = total
    if len(extra) > 0:
        a = tilted_lift(belief, u, mass)
        for i in range(N):
            out[i] += Gamma_a[i, 0] * a[0] + Gamma_a[i, 1] * a[1] + Gamma_a[i, 2] * a[2]
    chosen = integrated_sensor(delta, is_position, integrator)
    for i in range(3):
        out[N + i] = belief[N + i]
        if integrator == INTEGRATOR_ESTIMATE:
            out[N + i] += r[i] - belief[i]
        elif chosen >= 0:
            out[N + i] += r[i] - y[first[chosen] + i]
        elif integrator == INTEGRATOR_LITERAL:
            out[N + i] += r[i]
    propagate(P, Phi, W, extra, out[n:].reshape(n, n))
    return out
