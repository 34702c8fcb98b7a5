"""The likelihood of recorded measurements under a filter's W and V, by the innovations.

The one-step predictor of the 12 states turns the measurements into independent innovations e_k ~ N(0, S_k), so

    log L = -1/2 sum_k (m_k log 2 pi + log det S_k + e_k^T S_k^-1 e_k)

over the ticks k in which anything arrived, m_k the rows that did (F. C. Schweppe, "Evaluation of likelihood functions
for Gaussian signals", IEEE Trans. Information Theory 11, 1965; R. H. Shumway and D. S. Stoffer, Time Series Analysis
and Its Applications, section 6.3, missing observations in 6.4). The predictor is the flying filter without its
integrator, which does not act on the first 12 states. The record may come from a filter with other W and V.

A sensor whose errors are not white spoils this: errors of boxes persist from picture to picture, and log L takes that
for precision. Such a sensor may be used without being counted. Then sum_k log p(counted y_k | all y before) still
scores how well x is predicted, by measurements whose errors are independent of the camera's (a composite likelihood,
C. Varin, N. Reid, D. Firth, "An overview of composite likelihood methods", Statistica Sinica 21, 2011).
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numba.extending import register_jitable

from ortilo_drake.model.cholesky import forward_in_place
from ortilo_drake.model.measurement import Layout


class Record(NamedTuple):
    """The inputs of the filter in one flight.

    Attributes:
        y: measurements, 0 where nothing arrived (n, p).
        delta: arrivals, 0 or 1 (n, s).
        V2: the covariances that came with them, each in the corner of an M x M block (n, s, M, M).
        u: control less hover (n, 4).
        xhat_0: first prediction (12).
        P_0: its covariance (12, 12).
        layout: of the measurement.
    """

    y: np.ndarray
    delta: np.ndarray
    V2: np.ndarray
    u: np.ndarray
    xhat_0: np.ndarray
    P_0: np.ndarray
    layout: Layout


class NoiseModel(NamedTuple):
    """The noise that a filter assumes.

    Attributes:
        W: process noise (12, 12).
        V: constant covariances of the sensors (s, M, M), where scale is 0.
        scale: the record's covariances are taken times this (s); 0 takes V in their place.
        counted: 1 for each sensor that log L counts, else 0 (s).
    """

    W: np.ndarray
    V: np.ndarray
    scale: np.ndarray
    counted: np.ndarray


@register_jitable
def predictor_step(
    x: np.ndarray,
    P: np.ndarray,
    record: Record,
    k: int,
    Phi: np.ndarray,
    Gamma: np.ndarray,
    noise: NoiseModel,
    work: np.ndarray,
) -> float:
    """Take xhat_{k|k-1} and P_k in place to the next tick; return this tick's share of log L.

    With S = L L^T and U = L^-1 H P the measurement update is x + U^T L^-1 e and P - U^T U, the time update
    Phi x + Gamma u and Phi P Phi^T + W.

    Args:
        x: prediction (12).
        P: its covariance (12, 12), symmetric.
        record: what the filter was given.
        k: tick.
        Phi: dynamics (12, 12).
        Gamma: input (12, 4).
        noise: W, V and scale.
        work: room to compute in, of work_room.
    """
    # U and z = L^-1 e side by side: one forward substitution serves both
    y, delta, V2, u = record.y[k], record.delta[k], record.V2[k], record.u[k]
    states, weights, first = record.layout.states, record.layout.weights, record.layout.first
    p, sensors = y.size, delta.size
    U, S, FP, x_new = work[:p], work[p : 2 * p], work[2 * p : 2 * p + 12], work[2 * p + 12, :12]
    rows, m, n_counted, total = np.empty(p, dtype=np.int64), 0, 0, 0.0
    for turn in range(2 * sensors):  # counted rows come first: their pivots are then their own density
        s = turn % sensors
        if delta[s] == 0.0 or (noise.counted[s] == 0.0) != (turn >= sensors):
            continue
        for i in range(first[s + 1] - first[s]):
            row = first[s] + i
            U[m, :13] = 0.0
            U[m, 12] = y[row]
            for w in range(states.shape[1]):
                state, c = states[row, w], weights[row, w]
                U[m, 12] -= c * x[state]
                for j in range(12):
                    U[m, j] += c * P[state, j]
            rows[m] = row
            for a in range(m + 1):
                S[m, a] = 0.0
                for w in range(states.shape[1]):
                    S[m, a] += weights[rows[a], w] * U[m, states[rows[a], w]]
            for j in range(i + 1):
                V = noise.scale[s] * V2[s, i, j] if noise.scale[s] > 0.0 else noise.V[s, i, j]
                S[m, m - i + j] += V
            m += 1
            n_counted += turn < sensors
    forward_in_place(S, U, m)  # NaN if S is not positive definite: then so is log L
    for i in range(m):
        z = U[i, 12]
        for j in range(12):
            x[j] += U[i, j] * z
        if i < n_counted:
            total -= 0.5 * (np.log(2.0 * np.pi) + z**2) + np.log(S[i, i])
    for a in range(m):
        for i in range(12):
            for j in range(i, 12):
                P[i, j] -= U[a, i] * U[a, j]
    for i in range(12):
        for j in range(i):
            P[i, j] = P[j, i]
    for i in range(12):
        x_new[i] = 0.0
        for j in range(12):
            FP[i, j] = 0.0
        for l in range(12):  # noqa: E741 - i, j, l are indices
            if Phi[i, l] != 0.0:
                x_new[i] += Phi[i, l] * x[l]
                for j in range(12):
                    FP[i, j] += Phi[i, l] * P[l, j]
        for l in range(4):  # noqa: E741
            x_new[i] += Gamma[i, l] * u[l]
    x[:] = x_new
    P[:] = noise.W
    for j in range(12):
        for l in range(12):  # noqa: E741
            if Phi[j, l] != 0.0:
                for i in range(j + 1):
                    P[i, j] += FP[i, l] * Phi[j, l]
    for i in range(12):
        for j in range(i):
            P[i, j] = P[j, i]
    return total


@register_jitable
def work_room(p: int) -> np.ndarray:
    """Return room for predictor_step to compute in, of p rows of y."""
    return np.zeros((2 * p + 13, max(13, p)))


@njit(cache=True)
def log_likelihood(record: Record, noise: NoiseModel, Phi: np.ndarray, Gamma: np.ndarray, counts: np.ndarray) -> float:
    """Return log L of one record; NaN if a covariance is not positive definite.

    Args:
        record: the record.
        noise: W and V.
        Phi: discrete hover dynamics (12, 12).
        Gamma: discrete control input (12, 4).
        counts: which ticks count (n); the others are only filtered.
    """
    x, P, work, total = record.xhat_0.copy(), record.P_0.copy(), work_room(record.y.shape[1]), 0.0
    for k in range(record.y.shape[0]):
        share = predictor_step(x, P, record, k, Phi, Gamma, noise, work)
        if counts[k]:
            total += share
    return total


@njit(cache=True)
def refilter(record: Record, noise: NoiseModel, Phi: np.ndarray, Gamma: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return xhat_{k|k-1} (n, 12) and P_k (n, 12, 12) of a filter with this W and V on a record.

    Arguments as in log_likelihood.
    """
    n = record.y.shape[0]
    x, P, work = record.xhat_0.copy(), record.P_0.copy(), work_room(record.y.shape[1])
    estimates, covariances = np.empty((n, 12)), np.empty((n, 12, 12))
    for k in range(n):
        estimates[k], covariances[k] = x, P
        predictor_step(x, P, record, k, Phi, Gamma, noise, work)
    return estimates, covariances


def used_covariance(V2: np.ndarray, noise: NoiseModel) -> np.ndarray:
    """Return the covariances (n, s, M, M) that a filter with this V uses in place of the recorded ones (n, s, M, M)."""
    from_record = noise.scale[:, np.newaxis, np.newaxis]
    return np.where(from_record > 0.0, from_record * V2, noise.V)
