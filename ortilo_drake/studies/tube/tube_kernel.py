"""Matrices of many cases side by side, compiled: what a tick of the tube's recursion is made of.

Arrays end in an axis of B cases, so that the innermost loop runs over memory that lies together.
"""

import numpy as np
from numba.extending import register_jitable

N_MODES = 8  # bit s of a mode: the chain of sensor s is bad
_FIRST_STATE = (0, 0, 3)  # of the three that uwb, camera and imu see


@register_jitable
def transitions(loss: np.ndarray) -> np.ndarray:
    """Return pi (8, 8, B) of the three chains together; loss (3, 4, B) as link.loss_parameters."""
    pi = np.ones((N_MODES, N_MODES, loss.shape[2]))
    for i in range(N_MODES):
        for j in range(N_MODES):
            for s in range(3):
                bad, after = (i >> s) & 1, (j >> s) & 1
                leaves = loss[s, 1] if bad else loss[s, 0]
                pi[i, j] *= leaves if bad != after else 1.0 - leaves
    return pi


@register_jitable
def pattern_chance(p: int, i: int, there: np.ndarray, loss: np.ndarray) -> np.ndarray:
    """Return Pr(p | i) (B); bit s of p: sensor s arrives, which it cannot where it is not there (3, B)."""
    chance = np.ones(loss.shape[2])
    for s in range(3):
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
def condition(P: np.ndarray, first: int, V: np.ndarray, Y: np.ndarray) -> None:
    """Turn P (12, 12, B) into P - P C^T (C P C^T + V)^-1 C P, C picking three states; Y (3, 12, B) is room to work in.

    With the Cholesky factor of C P C^T + V = G G^T and Y = G^-1 C P that is P - Y^T Y.
    """
    G = np.empty((6, P.shape[2]))
    f = first
    for q in range(P.shape[2]):
        G[0, q] = 1.0 / np.sqrt(P[f, f, q] + V[0, 0])
        G[1, q] = (P[f + 1, f, q] + V[1, 0]) * G[0, q]
        G[2, q] = (P[f + 2, f, q] + V[2, 0]) * G[0, q]
        G[3, q] = 1.0 / np.sqrt(P[f + 1, f + 1, q] + V[1, 1] - G[1, q] ** 2)
        G[4, q] = (P[f + 2, f + 1, q] + V[2, 1] - G[2, q] * G[1, q]) * G[3, q]
        G[5, q] = 1.0 / np.sqrt(P[f + 2, f + 2, q] + V[2, 2] - G[2, q] ** 2 - G[4, q] ** 2)
    for j in range(P.shape[0]):
        for q in range(P.shape[2]):
            Y[0, j, q] = P[f, j, q] * G[0, q]
            Y[1, j, q] = (P[f + 1, j, q] - G[1, q] * Y[0, j, q]) * G[3, q]
            Y[2, j, q] = (P[f + 2, j, q] - G[2, q] * Y[0, j, q] - G[4, q] * Y[1, j, q]) * G[5, q]
    for i in range(P.shape[0]):
        for j in range(P.shape[0]):
            for q in range(P.shape[2]):
                P[i, j, q] -= Y[0, i, q] * Y[0, j, q] + Y[1, i, q] * Y[1, j, q] + Y[2, i, q] * Y[2, j, q]


@register_jitable
def mean_update(
    X: np.ndarray, V: np.ndarray, i: int, there: np.ndarray, loss: np.ndarray, U: np.ndarray, P: np.ndarray
) -> None:
    """Write sum_p Pr(p | i) U_p to U (12, 12, B); P (12, 12, B) is room to work in.

    Args:
        X: X_i (12, 12, B).
        V: covariances of the three sensors (3, 3, 3).
        i: mode.
        there: whether a sensor's message can arrive (3, B).
        loss: parameters of the links' chains (3, 4, B).
        U: what is written.
        P: overwritten.
    """
    for a in range(X.shape[0]):
        for b in range(X.shape[0]):
            for q in range(X.shape[2]):
                U[a, b, q] = 0.0
    Y = np.empty((3, X.shape[0], X.shape[2]))
    for p in range(8):
        chance = pattern_chance(p, i, there, loss)
        if not np.any(chance):
            continue
        for a in range(X.shape[0]):
            for b in range(X.shape[0]):
                for q in range(X.shape[2]):
                    P[a, b, q] = X[a, b, q]
        for s in range(3):
            if (p >> s) & 1:
                condition(P, _FIRST_STATE[s], V[s], Y)
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
        weights: of the modes (8, B).
        m: means in each mode (8, 15, B).
        C: covariances (8, 15, 15, B).
        X: (8, 12, 12, B).
        mean: what is written, of the first n states of 15.
        cov: likewise.
        err: likewise, of the first l states of 12.
    """
    mean[:], cov[:], err[:] = 0.0, 0.0, 0.0
    used = [i for i in range(N_MODES) if np.any(weights[i])]
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
        V: covariances of the three sensors (3, 3, 3).
        i: mode.
        there: whether a sensor's message can arrive (3, B).
        loss: parameters of the links' chains (3, 4, B).
        change: of d_p's last rows by an arrival (3).
        m_next: what is added to.
        C_next: likewise.
    """
    for q in range(m.shape[1]):
        uwb = 1.0 - loss[0, 2 + (i & 1), q] if there[0, q] else 0.0
        camera = (1.0 - uwb) * (1.0 - loss[1, 2 + ((i >> 1) & 1), q]) if there[1, q] else 0.0
        c = uwb + camera
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
                    + uwb * V[0, a, b]
                    + camera * V[1, a, b]
                    + c * (1.0 - c) * jump * (change[b] - m[b, q])
                )
