"""Compiled matrix operations for many cases side by side, used in each tick of the tube's recursion.

Arrays end in an axis of B cases, so that the innermost loop runs over memory that lies together.
"""

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.model.measurement import Layout
from ortilo_drake.studies.tube.side_by_side import copy


@register_jitable
def transitions(loss: np.ndarray) -> np.ndarray:
    """Return pi (2^s, 2^s, B) of the chains together; bit q of a mode: that of sensor q is bad. loss as propagate's."""
    modes = 2 ** loss.shape[0]
    pi = np.ones((modes, modes, loss.shape[2]))
    for i in range(modes):
        for j in range(modes):
            for s in range(loss.shape[0]):
                bad, after = (i >> s) & 1, (j >> s) & 1
                leaves = loss[s, 1] if bad else loss[s, 0]
                pi[i, j] *= leaves if bad != after else 1.0 - leaves
    return pi


@register_jitable
def arrival_chances(i: int, there: np.ndarray, loss: np.ndarray) -> np.ndarray:
    """Return the chance that a sensor's message arrives in mode i (s, B), 0 where it is not there (s, B)."""
    chances = np.zeros(there.shape)
    for s in range(there.shape[0]):
        for q in range(there.shape[1]):
            if there[s, q]:
                chances[s, q] = 1.0 - loss[s, 3 if (i >> s) & 1 else 2, q]
    return chances


@register_jitable
def condition(
    P: np.ndarray, V: np.ndarray, weight: np.ndarray, s: int, layout: Layout, G: np.ndarray, Y: np.ndarray
) -> None:
    """Turn P into P - weight P C^T (C P C^T + V)^-1 C P, C the rows of sensor s.

    With the Cholesky factor of C P C^T + V = G G^T and Y = G^-1 C P that is P - weight Y^T Y.

    Args:
        P: (12, 12, B).
        V: the sensor's covariance, in the corner of a block (M, M).
        weight: (B).
        s: the sensor.
        layout: of the measurement.
        G: overwritten (M, M, B).
        Y: overwritten (M, 12, B).
    """
    _, states, weights, first, _, _ = layout
    m, start, n, B = first[s + 1] - first[s], first[s], P.shape[0], P.shape[2]
    for a in range(m):
        for j in range(n):
            for q in range(B):
                Y[a, j, q] = weights[start + a, 0] * P[states[start + a, 0], j, q]
            for w in range(1, states.shape[1]):
                for q in range(B):
                    Y[a, j, q] += weights[start + a, w] * P[states[start + a, w], j, q]
    for a in range(m):
        for b in range(a + 1):
            for q in range(B):
                G[a, b, q] = V[a, b]
            for w in range(states.shape[1]):
                c, state = weights[start + b, w], states[start + b, w]
                for q in range(B):
                    G[a, b, q] += c * Y[a, state, q]
    for a in range(m):
        for b in range(a):
            for c in range(b):
                for q in range(B):
                    G[a, b, q] -= G[a, c, q] * G[b, c, q]
            for q in range(B):
                G[a, b, q] *= G[b, b, q]
                G[a, a, q] -= G[a, b, q] ** 2
            for j in range(n):
                for q in range(B):
                    Y[a, j, q] -= G[a, b, q] * Y[b, j, q]
        for q in range(B):
            G[a, a, q] = 1.0 / np.sqrt(G[a, a, q])  # the diagonal holds the inverse
        for j in range(n):
            for q in range(B):
                Y[a, j, q] *= G[a, a, q]
    for i in range(n):
        for j in range(i, n):
            for a in range(m):
                for q in range(B):
                    P[i, j, q] -= weight[q] * Y[a, i, q] * Y[a, j, q]
        for j in range(i):
            for q in range(B):
                P[i, j, q] = P[j, i, q]


@register_jitable
def mean_update(
    X: np.ndarray, V: np.ndarray, chances: np.ndarray, layout: Layout, U: np.ndarray, P: np.ndarray
) -> None:
    """Write sum_p Pr(p | i) U_p to U (12, 12, B); P (12, 12, B) is overwritten.

    The update is linear in the chance of the sensor that comes last. So where no more than one sensor arrives by
    chance, one pass does, that sensor last; else the patterns come one by one.

    Args:
        X: X_i (12, 12, B).
        V: covariances of the sensors, each in the corner of a block (s, M, M).
        chances: of each sensor's arrival (s, B).
        layout: of the measurement.
        U: what is written.
        P: overwritten.
    """
    sensors, B, most = chances.shape[0], X.shape[2], V.shape[1]
    G, Y = np.empty((most, most, B)), np.empty((most, X.shape[0], B))
    by_chance = [np.any((chances[s] > 0.0) & (chances[s] < 1.0)) for s in range(sensors)]
    if sum(by_chance) < 2:
        copy(X, U)
        for last in (False, True):
            for s in range(sensors):
                if by_chance[s] == last and np.any(chances[s]):
                    condition(U, V[s], chances[s], s, layout, G, Y)
        return
    whole = np.ones(B)
    U[:] = 0.0
    for p in range(2**sensors):
        chance = whole.copy()
        for s in range(sensors):
            chance *= chances[s] if (p >> s) & 1 else 1.0 - chances[s]
        if not np.any(chance):
            continue
        copy(X, P)
        for s in range(sensors):
            if (p >> s) & 1:
                condition(P, V[s], whole, s, layout, G, Y)
        for a in range(X.shape[0]):
            for b in range(X.shape[0]):
                for q in range(B):
                    U[a, b, q] += chance[q] * P[a, b, q]


@register_jitable
def mixture_moments(
    weights: np.ndarray, m: np.ndarray, C: np.ndarray, X: np.ndarray, mean: np.ndarray, cov: np.ndarray, err: np.ndarray
) -> None:
    """Write mean (n, B) and covariance (n, n, B) of a mixture of the modes, and their mean X (l, l, B).

    Args:
        weights: of the modes (2^s, B).
        m: means in each mode (2^s, 15, B).
        C: covariances (2^s, 15, 15, B).
        X: (2^s, 12, 12, B).
        mean: what is written, of the first n states of 15.
        cov: likewise.
        err: likewise, of the first l states of 12.
    """
    mean[:], cov[:], err[:] = 0.0, 0.0, 0.0
    used = [i for i in range(weights.shape[0]) if np.any(weights[i])]
    for i in used:
        for a in range(mean.shape[0]):
            mean[a] += weights[i] * m[i, a]
    for i in used:
        for a in range(mean.shape[0]):
            for b in range(mean.shape[0]):
                for q in range(mean.shape[1]):
                    both = (m[i, a, q] - mean[a, q]) * (m[i, b, q] - mean[b, q])
                    cov[a, b, q] += weights[i, q] * (C[i, a, b, q] + both)
        for a in range(err.shape[0]):
            for b in range(err.shape[0]):
                for q in range(err.shape[2]):
                    err[a, b, q] += weights[i, q] * X[i, a, b, q]


@register_jitable
def add_measured(
    m: np.ndarray,
    C: np.ndarray,
    X: np.ndarray,
    AC: np.ndarray,
    PhiX: np.ndarray,
    V: np.ndarray,
    chances: np.ndarray,
    is_position: np.ndarray,
    change: np.ndarray,
    m_next: np.ndarray,
    C_next: np.ndarray,
) -> None:
    """Add the measured position's contribution to the integral to the next mean (15, B) and covariance (15, 15, B).

    Args:
        m: mean (15, B).
        C: covariance (15, 15, B).
        X: (12, 12, B).
        AC: A C without an arrival (15, 15, B).
        PhiX: (12, 12, B).
        V: covariances of the sensors, each in the corner of a block (s, M, M).
        chances: of each sensor's arrival (s, B).
        is_position: whether a sensor measures the position (s).
        change: of d_p's last rows by an arrival (3).
        m_next: what is added to.
        C_next: likewise.
    """
    noise, c_all = np.zeros((3, 3)), np.empty(m.shape[1])
    for q in range(m.shape[1]):
        none = 1.0  # the chance that no position arrives; noise is E[V] of the first that does
        noise[:] = 0.0
        for s in range(chances.shape[0]):
            if is_position[s] and chances[s, q] > 0.0:
                for a in range(3):
                    for b in range(3):
                        noise[a, b] += none * chances[s, q] * V[s, a, b]
                none *= 1.0 - chances[s, q]
        c = c_all[q] = 1.0 - none
        for a in range(3):
            jump = change[a] - m[a, q]  # what an arrival adds to the integral's mean
            m_next[12 + a, q] += c * jump
            for b in range(3):
                C_next[12 + a, 12 + b, q] += (
                    c * (C[a, b, q] + X[a, b, q] - AC[12 + a, b, q] - AC[12 + b, a, q])
                    + noise[a, b]
                    + c * (1.0 - c) * jump * (change[b] - m[b, q])
                )
    for a in range(3):
        for b in range(12):
            for q in range(m.shape[1]):
                cross = c_all[q] * (AC[b, a, q] + PhiX[b, a, q])
                C_next[b, 12 + a, q] -= cross
                C_next[12 + a, b, q] -= cross
