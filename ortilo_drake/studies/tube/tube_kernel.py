"""Matrices of many cases side by side, compiled: what a tick of the tube's recursion is made of.

Arrays end in an axis of B cases, so that the innermost loop runs over memory that lies together.
"""

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.model.measurement import Layout


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
def pattern_chance(p: int, i: int, there: np.ndarray, loss: np.ndarray) -> np.ndarray:
    """Return Pr(p | i) (B); bit s of p: sensor s arrives, which it cannot where it is not there (s, B)."""
    chance = np.ones(loss.shape[2])
    for s in range(loss.shape[0]):
        lost = loss[s, 3 if (i >> s) & 1 else 2]
        for q in range(chance.shape[0]):
            arrives = 1.0 - lost[q] if there[s, q] else 0.0
            chance[q] *= arrives if (p >> s) & 1 else 1.0 - arrives
    return chance


@register_jitable
def sandwich(
    D: np.ndarray, rows: np.ndarray, columns: np.ndarray, M: np.ndarray, AM: np.ndarray, MA: np.ndarray, out: np.ndarray
) -> None:
    """Write A M to AM, its transpose to MA and A M A^T to out, A = I + D.

    Args:
        D: (n, n), the same in all cases.
        rows: of D's entries that are not zero.
        columns: likewise.
        M: symmetric (n, n, B).
        AM: (n, n, B).
        MA: (n, n, B).
        out: exactly symmetric (n, n, B).
    """
    add_product(D, rows, columns, M, AM, False)
    for i in range(M.shape[0]):
        for j in range(M.shape[0]):
            for q in range(M.shape[2]):
                MA[j, i, q] = AM[i, j, q]
    add_product(D, rows, columns, MA, out, True)
    for i in range(M.shape[0]):
        for j in range(i):
            for q in range(M.shape[2]):
                out[i, j, q] = out[j, i, q]


@register_jitable
def add_product(
    D: np.ndarray, rows: np.ndarray, columns: np.ndarray, M: np.ndarray, out: np.ndarray, upper: bool
) -> None:
    """Write M + D M, or its upper half, to out (n, n, B). Arguments as in sandwich."""
    for i in range(M.shape[0]):
        for j in range(i if upper else 0, M.shape[0]):
            for q in range(M.shape[2]):
                out[i, j, q] = M[i, j, q]
    for e in range(rows.shape[0]):
        i, k = rows[e], columns[e]
        a = D[i, k]
        for j in range(i if upper else 0, M.shape[0]):
            for q in range(M.shape[2]):
                out[i, j, q] += a * M[k, j, q]


@register_jitable
def condition(P: np.ndarray, V: np.ndarray, s: int, layout: Layout, G: np.ndarray, Y: np.ndarray) -> None:
    """Turn P (12, 12, B) into P - P C^T (C P C^T + V)^-1 C P, C the rows of sensor s.

    With the Cholesky factor of C P C^T + V = G G^T and Y = G^-1 C P that is P - Y^T Y. G (M, M, B) and Y (M, 12, B) are
    room to work in.
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
    for a in range(m):
        for i in range(n):
            for j in range(n):
                for q in range(B):
                    P[i, j, q] -= Y[a, i, q] * Y[a, j, q]


@register_jitable
def mean_update(
    X: np.ndarray,
    V: np.ndarray,
    i: int,
    there: np.ndarray,
    loss: np.ndarray,
    layout: Layout,
    U: np.ndarray,
    P: np.ndarray,
) -> None:
    """Write sum_p Pr(p | i) U_p to U (12, 12, B); P (12, 12, B) is room to work in.

    Args:
        X: X_i (12, 12, B).
        V: covariances of the sensors, each in the corner of a block (s, M, M).
        i: mode.
        there: whether a sensor's message can arrive (s, B).
        loss: parameters of the links' chains (s, 4, B).
        layout: of the measurement.
        U: what is written.
        P: overwritten.
    """
    for a in range(X.shape[0]):
        for b in range(X.shape[0]):
            for q in range(X.shape[2]):
                U[a, b, q] = 0.0
    most = V.shape[1]
    G, Y = np.empty((most, most, X.shape[2])), np.empty((most, X.shape[0], X.shape[2]))
    for p in range(2 ** loss.shape[0]):
        chance = pattern_chance(p, i, there, loss)
        if not np.any(chance):
            continue
        for a in range(X.shape[0]):
            for b in range(X.shape[0]):
                for q in range(X.shape[2]):
                    P[a, b, q] = X[a, b, q]
        for s in range(loss.shape[0]):
            if (p >> s) & 1:
                condition(P, V[s], s, layout, G, Y)
        for a in range(X.shape[0]):
            for b in range(X.shape[0]):
                for q in range(X.shape[2]):
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
    i: int,
    there: np.ndarray,
    loss: np.ndarray,
    is_position: np.ndarray,
    change: np.ndarray,
    m_next: np.ndarray,
    C_next: np.ndarray,
) -> None:
    """Add to the next mean (15, B) and covariance (15, 15, B) what the measured position brings into the integral.

    Args:
        m: mean (15, B).
        C: covariance (15, 15, B).
        X: (12, 12, B).
        AC: A C without an arrival (15, 15, B).
        PhiX: (12, 12, B).
        V: covariances of the sensors, each in the corner of a block (s, M, M).
        i: mode.
        there: whether a sensor's message can arrive (s, B).
        loss: parameters of the links' chains (s, 4, B).
        is_position: whether a sensor measures the position (s).
        change: of d_p's last rows by an arrival (3).
        m_next: what is added to.
        C_next: likewise.
    """
    for q in range(m.shape[1]):
        none, noise = 1.0, np.zeros((3, 3))  # the chance that no position arrives; E[V] of the first that does
        for s in range(loss.shape[0]):
            if is_position[s] and there[s, q]:
                arrives = 1.0 - loss[s, 2 + ((i >> s) & 1), q]
                for a in range(3):
                    for b in range(3):
                        noise[a, b] += none * arrives * V[s, a, b]
                none *= 1.0 - arrives
        c = 1.0 - none
        for a in range(3):
            jump = change[a] - m[a, q]  # what an arrival adds to the integral's mean
            m_next[12 + a, q] += c * jump
            for b in range(12):
                cross = c * (AC[b, a, q] + PhiX[b, a, q])
                C_next[b, 12 + a, q] -= cross
                C_next[12 + a, b, q] -= cross
            for b in range(3):
                C_next[12 + a, 12 + b, q] += (
                    c * (C[a, b, q] + X[a, b, q] - AC[12 + a, b, q] - AC[12 + b, a, q])
                    + noise[a, b]
                    + c * (1.0 - c) * jump * (change[b] - m[b, q])
                )
