"""The step of intermittent_filter.py as loops over what is not zero, faster than its matrices.

Of xbar = [x; e; i] the integral is known: from P_ii = 0 the printed equations leave K_i = -E and P_ii = 0, so that

    i_{k+1} = i_k + r_k - E y_k

and the rest is a Kalman filter of the N states [x; e], measured and then propagated, Phibar K the printed gain. The
covariances of the sensors are blocks of V2, so one sensor is taken after the other, with a root of its innovation's
covariance:

    L L^T = C P C^T + V,   G = P C^T L^-T,   x^ <- x^ + G L^-1 (y - C x^),   P <- P - G G^T
    x^ <- Phi x^ + Gamma u,   P <- Phi P Phi^T + W

G G^T is the printed K S K^T, K = G L^-1, and symmetric to the last bit.
"""

import numpy as np
from numba import njit
from numba.extending import register_jitable

from ortilo_drake.model.cholesky import forward_in_place
from ortilo_drake.model.measurement import Layout
from ortilo_drake.model.signals import N_I, N_U, N_X
from ortilo_drake.onboard.estimator.intermittent_filter import (
    INTEGRATOR_ESTIMATE,
    INTEGRATOR_LITERAL,
    FilterModel,
    integrated_sensor,
    tilted_lift,
)
from ortilo_drake.onboard.estimator.structure import Structure


@register_jitable
def measure(
    x: np.ndarray,
    P: np.ndarray,
    y: np.ndarray,
    V: np.ndarray,
    m: int,
    first: int,
    states: np.ndarray,
    weights: np.ndarray,
    S: np.ndarray,
    GT: np.ndarray,
) -> None:
    """Change an estimate and its covariance by what one sensor measured.

    Args:
        x: estimate, of which the N states [x; e] are changed.
        P: its covariance, of which N rows and columns are.
        y: values of all sensors (p).
        V: covariance of this one's, row by row, and whatever follows (m^2 or more).
        m: how many it has.
        first: row of the first of them.
        states: which states each row of y sees, see model.measurement.Layout (p, w).
        weights: with which coefficients (p, w).
        S: to work in (m or more, m or more).
        GT: likewise, for [G^T, L^-1 (y - C x^)] (m or more, N + 1).
    """
    N = GT.shape[1] - 1
    for a in range(m):
        state, c = states[first + a, 0], weights[first + a, 0]
        GT[a, N] = y[first + a] - c * x[state]
        for j in range(N):
            GT[a, j] = c * P[state, j]
        for w in range(1, states.shape[1]):
            state, c = states[first + a, w], weights[first + a, w]
            if c != 0.0:
                GT[a, N] -= c * x[state]
                for j in range(N):
                    GT[a, j] += c * P[state, j]
    for a in range(m):
        for b in range(a + 1):
            S[a, b] = V[m * a + b]
            for w in range(states.shape[1]):
                S[a, b] += weights[first + b, w] * GT[a, states[first + b, w]]
    forward_in_place(S, GT, m)
    for a in range(m):
        for j in range(N):
            x[j] += GT[a, j] * GT[a, N]
    threes = m - m % 3  # P is passed over once for three values
    for a in range(0, threes, 3):
        for i in range(N):
            g_0, g_1, g_2 = GT[a, i], GT[a + 1, i], GT[a + 2, i]
            for j in range(N):
                P[i, j] -= g_0 * GT[a, j] + g_1 * GT[a + 1, j] + g_2 * GT[a + 2, j]
    for a in range(threes, m):
        for i in range(N):
            g = GT[a, i]
            for j in range(N):
                P[i, j] -= g * GT[a, j]


@register_jitable
def propagate(P: np.ndarray, W: np.ndarray, structure: Structure, rows: np.ndarray) -> None:
    """Change P, of which N rows and columns are meant, to Phi P Phi^T + W, symmetric.

    Args:
        P: covariance.
        W: of the model (N, N).
        structure: of the model.
        rows: to work in (N, N or more).
    """
    N = W.shape[0]
    columns, values, counts, mixing, keeps = structure
    for side in range(2):  # P Phi^T, then Phi times that
        for a in range(mixing.size):
            i = mixing[a]
            k, f = columns[i, 0], values[i, 0]
            for j in range(N):
                rows[a, j] = f * P[k, j]
            for c in range(1, counts[i]):
                k, f = columns[i, c], values[i, c]
                for j in range(N):
                    rows[a, j] += f * P[k, j]
        for a in range(mixing.size):
            i = mixing[a]
            if side == 0:
                for j in range(N):
                    P[j, i] = rows[a, j]
            else:
                for j in range(N):
                    P[i, j] = rows[a, j]
    for a in range(mixing.size):
        for b in range(a):
            P[mixing[a], mixing[b]] = P[mixing[b], mixing[a]]
    for i in range(N):
        kept = keeps[i]
        for j in range(N):
            P[i, j] = kept * keeps[j] * P[i, j] + W[i, j]


@register_jitable
def to_work_in(n: int, p: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the work arrays of step_in_place for n states, the integral among them, and p values."""
    return np.empty((max(n - N_I, p), n - N_I + 1)), np.empty((p, p))


@njit(cache=True)
def step_in_place(
    rows: np.ndarray,
    S: np.ndarray,
    belief: np.ndarray,
    y: np.ndarray,
    delta: np.ndarray,
    V2: np.ndarray,
    u: np.ndarray,
    r: np.ndarray,
    model: FilterModel,
    layout: Layout,
) -> None:
    """Change [xhat_{k|k-1}, P_k row by row] (n + n^2), in which P_ii = 0, to the same of tick k + 1.

    It allocates nothing. Arguments as intermittent_step, after those of to_work_in.
    """
    Phi, Gamma, W, integrator, Gamma_a, mass, yaw, structure = model
    _, states, weights, first, block, is_position = layout
    columns, values, counts, _, _ = structure
    n = Phi.shape[0] + N_I
    P = belief[n:].reshape((n, n))
    N = W.shape[0]
    lift = tilted_lift(belief, u, mass, yaw) if N > N_X else (0.0, 0.0, 0.0)
    chosen = integrated_sensor(delta, is_position, integrator)
    for i in range(N_I):
        if integrator == INTEGRATOR_ESTIMATE:
            belief[N + i] += r[i] - belief[i]
        elif chosen >= 0:
            belief[N + i] += r[i] - y[first[chosen] + i]
        elif integrator == INTEGRATOR_LITERAL:
            belief[N + i] += r[i]

    for s in range(delta.size):
        if delta[s] != 0.0:
            measure(belief, P, y, V2[block[s] :], first[s + 1] - first[s], first[s], states, weights, S, rows)

    x = rows[0]
    for i in range(N):
        total = 0.0
        for c in range(counts[i]):
            total += values[i, c] * belief[columns[i, c]]
        for j in range(N_U):
            total += Gamma[i, j] * u[j]
        if N > N_X:
            total += Gamma_a[i, 0] * lift[0] + Gamma_a[i, 1] * lift[1] + Gamma_a[i, 2] * lift[2]
        x[i] = total
    for i in range(N):
        belief[i] = x[i]
    propagate(P, W, structure, rows)


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
    after = belief.copy()
    rows, S = to_work_in(model.Phi.shape[0] + N_I, layout.first[-1])
    step_in_place(rows, S, after, y, delta, V2, u, r, model, layout)
    return after
