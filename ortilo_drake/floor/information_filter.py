"""The recursion of the Cramer-Rao bound (cramer_rao.py), over rows of information and with slowly changing errors.

    P_{k+1} = Phi (P_k^-1 + J_k)^-1 Phi^T + W

The inverses are never formed. J_k comes as rows (information_rows.py), and each row is one scalar update

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
from ortilo_drake.onboard.estimator.kalman import Structure, structure_of
from ortilo_drake.sensors.information_rows import AMPLITUDE, GRADIENT, SLOW, TICK, VARIANCE


@register_jitable
def _update(P: np.ndarray, n: int, row: np.ndarray, before: int, a: float, b: float, k: np.ndarray) -> None:
    """Update the leading n x n of P by a row; its slow error is a P_before + b P_before+1, or none if before < 0."""
    k[:n] = 0.0
    gradient = row[GRADIENT]
    for j in range(gradient.size):
        if gradient[j] != 0.0:
            for i in range(n):
                k[i] += gradient[j] * P[j, i]
    if before >= 0:
        for i in range(n):
            k[i] += a * P[before, i] + b * P[before + 1, i]
    s = row[VARIANCE]
    for j in range(gradient.size):
        s += gradient[j] * k[j]
    if before >= 0:
        s += a * k[before] + b * k[before + 1]
    if s <= 0.0:
        return  # known exactly, and seen exactly
    scale = 1.0 / np.sqrt(s)
    for i in range(n):
        k[i] *= scale
    for i in range(n):
        for j in range(n):
            P[i, j] -= k[i] * k[j]


@register_jitable
def _predict(P: np.ndarray, n: int, structure: Structure, W: np.ndarray, work: np.ndarray) -> None:
    """Overwrite P by Phi P Phi^T + W, with constant nodes of slow errors; structure describes Phi (m, m)."""
    columns, values, counts, _, _ = structure
    m = W.shape[0]
    work[:m, :n] = 0.0
    for i in range(m):
        for c in range(counts[i]):
            for j in range(n):
                work[i, j] += values[i, c] * P[columns[i, c], j]
    for i in range(m):
        for j in range(m, n):
            P[i, j] = P[j, i] = work[i, j]
        for j in range(i + 1):
            total = W[i, j]
            for c in range(counts[j]):
                total += work[i, columns[j, c]] * values[j, c]
            P[i, j] = P[j, i] = total


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
    P, work, k = np.zeros((size, size)), np.empty((m, size)), np.empty(size)
    P[:m, :m] = P_0
    bounds, structure = np.empty((ticks, N_X, N_X)), structure_of(Phi)
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
            slow, before = int(rows[at, SLOW]), -1
            if slow >= 0:
                c = place[slow]
                if c < 0:
                    c = place[slow] = count
                    number[c] = slow
                    P[m + 2 * c, m + 2 * c] = P[m + 2 * c + 1, m + 2 * c + 1] = 1.0
                    count += 1
                used[c] = True
                before = m + 2 * c
            amplitude = rows[at, AMPLITUDE] * scale
            _update(P, m + 2 * count, rows[at], before, amplitude * (1.0 - after), amplitude * after, k)
            at += 1
        _predict(P, m + 2 * count, structure, W, work)
    return bounds
