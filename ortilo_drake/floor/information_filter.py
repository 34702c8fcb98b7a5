"""The recursion of the Cramer-Rao bound (cramer_rao.py), over rows of information and with slowly changing errors.

    P_{k+1} = Phi (P_k^-1 + J_k)^-1 Phi^T + W

The inverses are never formed. J_k comes as rows (information_rows.py), and each row is one scalar measurement of the
Kalman filter (onboard/estimator/kalman.py),

    P <- P - P g g^T P / (g^T P g + r),

which allows singular P and J_k, and r = 0. A slowly changing error is part of the state while it is seen. It is the
linear interpolation between two nodes n_j, n_{j+1}; a new standard normal node is drawn every ``spacing`` ticks, as in
the projected camera (world/sensors/projected_camera.py). With both nodes in the state the process is Markov, so the
update is exact.
"""

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.model.signals import N_X
from ortilo_drake.onboard.estimator.kalman import correct, innovation, propagate, structure_of
from ortilo_drake.sensors.information_rows import AMPLITUDE, GRADIENT, SLOW, TICK, VARIANCE


@register_jitable
def _new_nodes(P: np.ndarray, m: int, number: np.ndarray, used: np.ndarray, count: int) -> int:
    """Begin a new interval: the later node of each slow error becomes its earlier one, and a new node is drawn.

    Errors not used in the last interval are dropped, since nothing is known of them any more. Return the number kept.
    """
    kept, old = 0, np.empty(m + count, dtype=np.int64)
    for i in range(m):
        old[i] = i
    for c in range(count):
        if used[c]:
            old[m + kept] = m + 2 * c + 1
            number[kept], used[kept] = number[c], False
            kept += 1
    small = np.empty((m + kept, m + kept))
    for i in range(m + kept):
        for j in range(m + kept):
            small[i, j] = P[old[i], old[j]]
    P[m:, :] = 0.0
    P[:, m:] = 0.0
    for i in range(m + kept):
        for j in range(m + kept):
            P[i if i < m else 2 * i - m, j if j < m else 2 * j - m] = small[i, j]
    for c in range(kept):
        P[m + 2 * c + 1, m + 2 * c + 1] = 1.0
    return kept


@cached_njit
def predicted_bound(
    rows: np.ndarray, ticks: int, Phi: np.ndarray, W: np.ndarray, P_0: np.ndarray, spacing: int
) -> np.ndarray:
    """Return the bound P_k on the covariance of x_{k|k-1}, of the vehicle's states, at each tick (ticks, 12, 12).

    rows (l, 5 + m) are measurements in the order of ticks (information_rows.py). The first twelve of the m states are
    the vehicle's; Phi is their dynamics, W the noise covariance per tick, P_0 the start (all m x m). The nodes of slow
    errors are `spacing` ticks apart.
    """
    m, most = Phi.shape[0], 0
    for row in rows:
        most = max(most, int(row[SLOW]) + 1)
    size = m + 2 * most
    P, Phi_all, W_all = np.zeros((size, size)), np.eye(size), np.zeros((size, size))  # nodes are constant
    P[:m, :m], Phi_all[:m, :m], W_all[:m, :m] = P_0, Phi, W
    bounds, structure = np.empty((ticks, N_X, N_X)), structure_of(Phi_all)
    weights, states = np.zeros((1, m + 2)), np.zeros((1, m + 2), dtype=np.int64)
    states[0, :m] = np.arange(m)
    x, y, r = np.zeros(size), np.zeros(1), np.empty(1)  # x and y do not enter P
    S, work = np.empty((1, 1)), np.empty((m + 1) * (size + 1))
    number, used, count = np.empty(most, dtype=np.int64), np.zeros(most, dtype=np.bool_), 0
    place = np.full(most, -1)  # index of each slow error among those in the state, else -1
    at = 0
    for tick in range(ticks):
        bounds[tick] = P[:N_X, :N_X]
        if count > 0 and tick % spacing == 0:
            place[:] = -1
            count = _new_nodes(P, m, number, used, count)
            for c in range(count):
                place[number[c]] = c
        after = (tick % spacing) / spacing
        scale = 1.0 / np.sqrt((1.0 - after) ** 2 + after**2)
        while at < rows.shape[0] and rows[at, TICK] <= tick:
            slow = int(rows[at, SLOW])
            weights[0, :m], weights[0, m:], states[0, m:] = rows[at, GRADIENT], 0.0, 0
            r[0] = rows[at, VARIANCE]
            if slow >= 0:
                c = place[slow]
                if c < 0:
                    c = place[slow] = count
                    number[c] = slow
                    P[m + 2 * c, m + 2 * c] = P[m + 2 * c + 1, m + 2 * c + 1] = 1.0
                    count += 1
                used[c] = True
                amplitude = rows[at, AMPLITUDE] * scale
                weights[0, m], weights[0, m + 1] = amplitude * (1.0 - after), amplitude * after
                states[0, m], states[0, m + 1] = m + 2 * c, m + 2 * c + 1
            n = m + 2 * count
            GT = work[: n + 1].reshape((1, n + 1))
            innovation(x, P, y, r, 1, 0, states, weights, S, GT)
            if not S[0, 0] <= 0.0:  # otherwise known exactly, and seen exactly; NaN stays in sight
                correct(x, P, 1, S, GT)
            at += 1
        n = m + 2 * count
        propagate(P, W_all[:n, :n], structure, work[: m * n].reshape((m, n)))
    return bounds
