"""Compiled matrix operations for many cases side by side, used in each tick of the tube's recursion.

The last axis of the arrays has B cases, so that the innermost loop runs over contiguous memory.
"""

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.model.measurement import Layout


@register_jitable
def copy(M: np.ndarray, out: np.ndarray) -> None:
    """Copy M to out; both have the same shape and are contiguous."""
    x, y = M.reshape(-1), out.reshape(-1)
    for j in range(x.shape[0]):
        y[j] = x[j]


@register_jitable
def sandwich(
    D: np.ndarray, rows: np.ndarray, columns: np.ndarray, M: np.ndarray, AM: np.ndarray, MA: np.ndarray, out: np.ndarray
) -> None:
    """Write A M to AM, its transpose to MA and A M A^T, exactly symmetric, to out (n, n, B each), A = I + D.

    D (n, n) is the same in all cases; rows, columns: indices of D's entries that are not zero, rows ascending; M is
    symmetric (n, n, B).
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
    """Write M + D M to out (n, n, B), only its upper half if `upper`, or to out (n, B). Arguments as in sandwich."""
    e = 0
    for i in range(M.shape[0]):
        first = i if upper else 0
        y = out[i, first:].reshape(-1)
        copy(M[i, first:], y)
        while e < rows.shape[0] and rows[e] == i:  # two entries at a time, in long loops that become SIMD instructions
            x, a = M[columns[e], first:].reshape(-1), D[i, columns[e]]
            if e + 1 < rows.shape[0] and rows[e + 1] == i:
                z, b = M[columns[e + 1], first:].reshape(-1), D[i, columns[e + 1]]
                for j in range(y.shape[0]):
                    y[j] += a * x[j] + b * z[j]
                e += 2
            else:
                for j in range(y.shape[0]):
                    y[j] += a * x[j]
                e += 1


@register_jitable
def transitions(loss: np.ndarray) -> np.ndarray:
    """Return pi (2^s, 2^s, B) of all chains together; bit q of a mode: sensor q's chain is bad; loss: see propagate."""
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
    """Return the chance that each sensor's message arrives in mode i (s, B), 0 if the message is not there (s, B)."""
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
    """Replace P (12, 12, B) by P - weight P C^T (C P C^T + V)^-1 C P, with the rows C of sensor s.

    With the Cholesky factorisation C P C^T + V = G G^T and Y = G^-1 C P, this is P - weight Y^T Y. V: the sensor's
    covariance in the corner of a block (M, M); weight (B). G (M, M, B) and Y (M, 12, B) are overwritten.
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

    The update is linear in the chance of the sensor that comes last. So if at most one sensor arrives by chance, one
    pass is enough, with this sensor last; else the arrival patterns are summed one by one. X: X_i (12, 12, B); V: the
    sensors' covariances, each in the corner of a block (s, M, M); chances: of each sensor's arrival (s, B).
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
    """Write mean (n, B) and covariance (n, n, B) of the mixture of the modes, and the modes' mean X, err (l, l, B).

    These are of the first n of 15 and l of 12 states. weights: of the modes (2^s, B); m, C, X: the modes' means
    (2^s, 15, B), covariances (2^s, 15, 15, B) and X (2^s, 12, 12, B).
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
    """Add the measured position's effect on the integral to the next mean m_next (15, B) and covariance C_next.

    m, C: mean (15, B) and covariance (15, 15, B); X, PhiX: X and Phi X (12, 12, B each); AC: A C without an arrival
    (15, 15, B); V: the sensors' covariances, each in the corner of a block (s, M, M); chances: of each sensor's arrival
    (s, B); is_position: whether each measures the position (s); change: of d_p's last rows by an arrival (3).
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
            jump = change[a] - m[a, q]  # an arrival adds this to the integral's mean
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
