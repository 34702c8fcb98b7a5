"""The parts of a tick of the tube's recursion, compiled; tube_recursion.py has the equations."""

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.model.measurement import Layout
from ortilo_drake.theory.arrivals.expected_riccati_kernel import forward_in_place


@register_jitable
def transitions(loss: np.ndarray) -> np.ndarray:
    """Return pi (2^s, 2^s) of the chains together; bit q of a mode: that of sensor q is bad. loss as propagate's."""
    sensors = loss.shape[0]
    pi = np.ones((2**sensors, 2**sensors))
    for i in range(2**sensors):
        for j in range(2**sensors):
            for s in range(sensors):
                bad, after = (i >> s) & 1, (j >> s) & 1
                leaves = loss[s, 1] if bad else loss[s, 0]
                pi[i, j] *= leaves if bad != after else 1.0 - leaves
    return pi


@register_jitable
def sparse_times(A: np.ndarray, M: np.ndarray, out: np.ndarray) -> None:
    """Write A M to out; zeros of A cost nothing."""
    out[:] = 0.0
    for i in range(A.shape[0]):
        for k in range(A.shape[1]):
            if A[i, k] != 0.0:
                for j in range(M.shape[1]):
                    out[i, j] += A[i, k] * M[k, j]


@register_jitable
def sandwich(A: np.ndarray, M: np.ndarray, AM: np.ndarray, MA: np.ndarray, out: np.ndarray) -> None:
    """Write A M, its transpose and A M A^T to the last three, M symmetric."""
    sparse_times(A, M, AM)
    for i in range(A.shape[0]):
        for j in range(A.shape[0]):
            MA[j, i] = AM[i, j]
    sparse_times(A, MA, out)


@register_jitable
def update(P: np.ndarray, V: np.ndarray, s: int, layout: Layout, S: np.ndarray, Y: np.ndarray) -> None:
    """Take a measurement of sensor s of covariance V into P (12, 12); S and Y are room to work in."""
    _, states, weights, first, _, _ = layout
    m = first[s + 1] - first[s]
    Y[:m] = 0.0
    for a in range(m):
        for w in range(states.shape[1]):
            state, c = states[first[s] + a, w], weights[first[s] + a, w]
            for j in range(12):
                Y[a, j] += c * P[state, j]
    for a in range(m):
        for b in range(m):
            S[a, b] = V[a, b]
            for w in range(states.shape[1]):
                S[a, b] += weights[first[s] + b, w] * Y[a, states[first[s] + b, w]]
    forward_in_place(S, Y, m)
    for i in range(12):
        for j in range(12):
            for a in range(m):
                P[i, j] -= Y[a, i] * Y[a, j]


@register_jitable
def mean_update(
    X: np.ndarray,
    V: np.ndarray,
    arrives: np.ndarray,
    layout: Layout,
    U: np.ndarray,
    P: np.ndarray,
    S: np.ndarray,
    Y: np.ndarray,
) -> None:
    """Write sum_p Pr(p) U_p to U (12, 12).

    Args:
        X: (12, 12).
        V: covariances of the sensors, each in the corner of a block (s, M, M).
        arrives: chance that a message of each arrives (s).
        layout: of the measurement.
        U: what is written (12, 12).
        P: room to work in (12, 12).
        S: likewise (M, M).
        Y: likewise (M, 12).
    """
    U[:] = 0.0
    for p in range(2**arrives.size):
        chance = 1.0
        for s in range(arrives.size):
            chance *= arrives[s] if (p >> s) & 1 else 1.0 - arrives[s]
        if chance == 0.0:
            continue
        P[:] = X
        for s in range(arrives.size):
            if (p >> s) & 1:
                update(P, V[s], s, layout, S, Y)
        for i in range(12):
            for j in range(12):
                U[i, j] += chance * P[i, j]


@register_jitable
def mixture_moments(
    weights: np.ndarray,
    m: np.ndarray,
    C: np.ndarray,
    X: np.ndarray,
    mean: np.ndarray,
    covariance: np.ndarray,
    error: np.ndarray,
) -> None:
    """Write mean (15) and covariance (15, 15) of the modes' mixture, and their mean X (12, 12), exactly symmetric."""
    mean[:], covariance[:], error[:] = 0.0, 0.0, 0.0
    for i in range(weights.size):
        if weights[i] > 0.0:
            mean += weights[i] * m[i]
    for i in range(weights.size):
        if weights[i] > 0.0:
            for a in range(15):
                strays = m[i, a] - mean[a]
                for b in range(a, 15):
                    covariance[a, b] += weights[i] * (C[i, a, b] + strays * (m[i, b] - mean[b]))
            for a in range(12):
                for b in range(a, 12):
                    error[a, b] += weights[i] * X[i, a, b]
    for a in range(15):
        for b in range(a):
            covariance[a, b] = covariance[b, a]
            if a < 12:
                error[a, b] = error[b, a]


@register_jitable
def position_chances(arrives: np.ndarray, is_position: np.ndarray) -> np.ndarray:
    """Return the chance that the integral takes the position of each sensor (s): the first that arrives."""
    chances, none_before = np.zeros(arrives.size), 1.0
    for s in range(arrives.size):
        if is_position[s]:
            chances[s] = none_before * arrives[s]
            none_before *= 1.0 - arrives[s]
    return chances
