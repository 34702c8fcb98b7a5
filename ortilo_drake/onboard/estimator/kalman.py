"""The Kalman filter's mathematics: the printed equations, and the two steps that fly, as loops over nonzero entries.

The one-step predictor, for measurements y = H x + v whose noise v may be correlated with w (S_wv; paper, section IV-C):

    K = (Phi P H^T + S_wv) (H P H^T + V)^-1                                                                 (gain)
    P <- Phi P Phi^T + W - K (H P Phi^T + S_wv^T)                                                     (covariance)

predictor_gain and predicted_covariance are these two lines in NumPy. The same in two steps, for S_wv = 0:

    L L^T = C P C^T + V,   G = P C^T L^-T,   x^ <- x^ + G L^-1 (y - C x^),   P <- P - G G^T        (measure)
    x^ <- Phi x^ + Gamma u,   P <- Phi P Phi^T + W                                                 (predict, propagate)

V is block diagonal with one block a sensor. So `measure` processes one sensor after another and skips each sensor whose
message did not arrive. G G^T equals K S K^T, K = G L^-1, and is symmetric to the last bit. The zeros of Phi are known,
so the loops of Phi P Phi^T + W skip them. Most rows of Phi only keep or shrink one state; the other rows read few.

Used by: intermittent_filter.py (the paper's filter), linear_filter.py (any linear model), measurement_handler.py (the
gates), floor/information_filter.py and studies/room_design/path_bound.py (Cramer-Rao bounds), studies/loop and
studies/command_link (steady and periodic gains), studies/tuning (likelihood), studies/recorded/at_rest.py and
studies/live/anchor_bank.py. Other forms: tight/update.py updates a nonlinear state row by row, with an outlier gate and
Huber's weight, and subtracts all rows at once; theory/arrivals/expected_riccati_kernel.py and
studies/tube/tube_kernel.py average over patterns of arrivals.
"""

from typing import NamedTuple

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.model.cholesky import forward_in_place, squared_norm_in_place
from ortilo_drake.model.scalars import solve


def predictor_gain(
    Phi: np.ndarray, H: np.ndarray, V: np.ndarray, P: np.ndarray, S_wv: np.ndarray | float = 0.0
) -> np.ndarray:
    """Return K (n, m) of the one-step predictor; Phi and P are (n, n), H is (m, n), V is (m, m), S_wv is (n, m)."""
    return solve(H @ P @ H.T + V, (Phi @ P @ H.T + S_wv).T).T


def predicted_covariance(
    Phi: np.ndarray, H: np.ndarray, W: np.ndarray, P: np.ndarray, K: np.ndarray, S_wv: np.ndarray | float = 0.0
) -> np.ndarray:
    """Return the next P (n, n), symmetric, with the gain K of predictor_gain and the process noise covariance W."""
    P_next = Phi @ P @ Phi.T + W - K @ (H @ P @ Phi.T + np.transpose(S_wv))
    return (P_next + P_next.T) / 2.0


class Structure(NamedTuple):
    """The entries of Phi (N, N) that are not 0."""

    columns: np.ndarray
    """columns of the nonzero entries of each row (N, w); only the first `counts` of a row are valid."""
    values: np.ndarray
    """values of these entries (N, w)."""
    counts: np.ndarray
    """number of nonzero entries of each row (N)."""
    mixing: np.ndarray
    """indices of the rows with a nonzero entry off the diagonal, or with none at all (c)."""
    keeps: np.ndarray
    """diagonal entry of each row that is not in `mixing`; 1 for the rows in `mixing` (N)."""


@register_jitable
def structure_of(Phi: np.ndarray) -> Structure:
    """Return the nonzero entries of Phi (N, N)."""
    N = Phi.shape[0]
    columns, values, counts = np.zeros((N, N), np.int64), np.zeros((N, N)), np.zeros(N, np.int64)
    mixing, keeps, c = np.zeros(N, np.int64), np.ones(N), 0
    for i in range(N):
        for k in range(N):
            if Phi[i, k] != 0.0:
                columns[i, counts[i]], values[i, counts[i]] = k, Phi[i, k]
                counts[i] += 1
        if counts[i] == 1 and columns[i, 0] == i:
            keeps[i] = values[i, 0]
        else:
            mixing[c] = i
            c += 1
    w = max(1, counts.max())
    return Structure(columns[:, :w].copy(), values[:, :w].copy(), counts, mixing[:c].copy(), keeps)


@register_jitable(_nrt=False)
def innovation(
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
    """Write [C P, y - C x^] of one sensor to GT and the lower half of C P C^T + V to S.

    Only the first N states [x; e] of the estimate x and its covariance P are used. y holds the values of all sensors
    (p); the sensor has m of them, from row `first` on. V begins with their covariance, row by row (m^2 or more). Row i
    of y is the sum of `weights` times `states` (p, w), see model.measurement.Layout. S is (m or more, m or more), GT is
    (m or more, N + 1).
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


@register_jitable(_nrt=False)
def squared_distance(S: np.ndarray, GT: np.ndarray, m: int) -> float:
    """Return the squared Mahalanobis distance of a sensor's m values from their prediction; S, GT as in `innovation`.

    The distance is infinite if the prediction is not finite or S is not positive definite. S and GT are overwritten.
    """
    for a in range(m):
        for b in range(a + 1):
            if not np.isfinite(S[a, b]):
                return np.inf
    squared = squared_norm_in_place(S, GT[:m, GT.shape[1] - 1])
    return squared if np.isfinite(squared) else np.inf


@register_jitable(_nrt=False)
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
    """Update the estimate x and its covariance P with the values of one sensor.

    Arguments as in `innovation`. Afterwards GT holds [G^T, L^-1 (y - C x^)], and the lower triangle of S holds L.
    """
    innovation(x, P, y, V, m, first, states, weights, S, GT)
    correct(x, P, m, S, GT)


@register_jitable(_nrt=False)
def correct(x: np.ndarray, P: np.ndarray, m: int, S: np.ndarray, GT: np.ndarray) -> None:
    """Do the rest of `measure`, after `innovation`."""
    N = GT.shape[1] - 1
    forward_in_place(S, GT, m)
    for a in range(m):
        for j in range(N):
            x[j] += GT[a, j] * GT[a, N]
    threes = m - m % 3  # one pass over P for three values
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


@register_jitable(_nrt=False)
def propagate(P: np.ndarray, W: np.ndarray, structure: Structure, rows: np.ndarray) -> None:
    """Replace the first N rows and columns of P, symmetric, by Phi P Phi^T + W (N, N).

    `rows` is work memory: a row of N for each row of structure.mixing, or more.
    """
    N = W.shape[0]
    columns, values, counts, mixing, keeps = structure
    for side in range(2):  # first P Phi^T, then Phi (P Phi^T)
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


@register_jitable(_nrt=False)
def predict(x: np.ndarray, u: np.ndarray, Gamma: np.ndarray, structure: Structure, after: np.ndarray) -> None:
    """Write Phi x + Gamma u (N) to `after`, with the control u (m) and Gamma (N, m); x and `after` may be longer."""
    columns, values, counts, _, _ = structure
    for i in range(Gamma.shape[0]):
        total = 0.0
        for c in range(counts[i]):
            total += values[i, c] * x[columns[i, c]]
        for j in range(Gamma.shape[1]):
            total += Gamma[i, j] * u[j]
        after[i] = total
