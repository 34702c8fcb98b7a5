"""The likelihood of recorded measurements under a filter's W and V, by the innovations.

The one-step predictor of the 12 states turns the measurements into independent innovations e_k ~ N(0, S_k), so

    log L = -1/2 sum_k (m_k log 2 pi + log det S_k + e_k^T S_k^-1 e_k)

over the ticks k in which anything arrived, m_k the number of rows that did (F. C. Schweppe, "Evaluation of likelihood
functions for Gaussian signals", IEEE Trans. Information Theory 11, 1965; R. H. Shumway and D. S. Stoffer, Time Series
Analysis and Its Applications, section 6.3, missing observations in 6.4). The predictor is the flying filter by the same
kernel, without its integrator, which does not act on the first 12 states. The record may come from a filter with other
W and V.

A sensor whose errors are not white breaks this: errors of boxes persist from picture to picture, and log L takes this
for precision. Such a sensor may be used without being counted. Then sum_k log p(counted y_k | all y before) still
scores how well x is predicted, by measurements whose errors are independent of the camera's (a composite likelihood,
C. Varin, N. Reid, D. Firth, "An overview of composite likelihood methods", Statistica Sinica 21, 2011).
"""

from typing import NamedTuple

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.model.measurement import Layout
from ortilo_drake.onboard.estimator.kalman import Structure, measure, predict, propagate, structure_of


class Record(NamedTuple):
    """The inputs of the filter in one flight: measurements y (n, p), 0 where nothing arrived, and arrivals (n, s).

    V2 are the covariances that came with them, each in the corner of an M x M block (n, s, M, M), u the control less
    hover (n, 4); the first prediction is xhat_0 (12), with the covariance P_0 (12, 12); the layout is the
    measurement's.
    """

    y: np.ndarray
    delta: np.ndarray
    V2: np.ndarray
    u: np.ndarray
    xhat_0: np.ndarray
    P_0: np.ndarray
    layout: Layout


class NoiseModel(NamedTuple):
    """The noise that a filter assumes: W of the process (12, 12), and V, constant covariances of the sensors (s, M, M).

    The record's covariances are multiplied by scale (s); where it is 0, V replaces them. counted (s) is 1 for each
    sensor that log L counts, else 0.
    """

    W: np.ndarray
    V: np.ndarray
    scale: np.ndarray
    counted: np.ndarray


class Work(NamedTuple):
    """Work arrays for p rows of y and at most M per sensor: S (p, p), G^T (p or more, 13), V (M^2) and x (12)."""

    S: np.ndarray
    GT: np.ndarray
    V: np.ndarray
    x: np.ndarray


@register_jitable
def work_for(record: Record) -> Work:
    """Return the work arrays for the steps of a record."""
    p, most = record.y.shape[1], record.V2.shape[2]
    return Work(np.empty((p, p)), np.empty((max(12, p), 13)), np.empty(most * most), np.empty(12))


@register_jitable
def predictor_step(
    x: np.ndarray,
    P: np.ndarray,
    record: Record,
    k: int,
    Gamma: np.ndarray,
    structure: Structure,
    noise: NoiseModel,
    work: Work,
) -> float:
    """Advance xhat_{k|k-1} (12) and the symmetric P_k (12, 12) in place by a tick; return the tick's part of log L."""
    y, delta, V2 = record.y[k], record.delta[k], record.V2[k]
    states, weights, first = record.layout.states, record.layout.weights, record.layout.first
    total = 0.0
    for turn in range(2 * delta.size):  # counted sensors first: others do not enter their density
        s = turn % delta.size
        counted = turn < delta.size
        if delta[s] == 0.0 or (noise.counted[s] != 0.0) != counted:
            continue
        m = first[s + 1] - first[s]
        for i in range(m):
            for j in range(m):
                work.V[m * i + j] = noise.scale[s] * V2[s, i, j] if noise.scale[s] > 0.0 else noise.V[s, i, j]
        measure(x, P, y, work.V, m, first[s], states, weights, work.S, work.GT)  # NaN if S is not positive definite
        if counted:
            for i in range(m):
                total -= 0.5 * (np.log(2.0 * np.pi) + work.GT[i, 12] ** 2) + np.log(work.S[i, i])
    predict(x, record.u[k], Gamma, structure, work.x)
    x[:] = work.x
    propagate(P, noise.W, structure, work.GT)
    return total


@cached_njit
def log_likelihood(record: Record, noise: NoiseModel, Phi: np.ndarray, Gamma: np.ndarray, counts: np.ndarray) -> float:
    """Return log L of one record; NaN if a covariance is not positive definite.

    Phi (12, 12) and Gamma (12, 4) are the discrete hover dynamics; ticks that do not count (n) are only filtered.
    """
    x, P, structure, work, total = record.xhat_0.copy(), record.P_0.copy(), structure_of(Phi), work_for(record), 0.0
    for k in range(record.y.shape[0]):
        share = predictor_step(x, P, record, k, Gamma, structure, noise, work)
        if counts[k]:
            total += share
    return total


@cached_njit
def refilter(record: Record, noise: NoiseModel, Phi: np.ndarray, Gamma: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return xhat_{k|k-1} (n, 12) and P_k (n, 12, 12) of a filter on a record; arguments as log_likelihood."""
    n = record.y.shape[0]
    x, P, structure, work = record.xhat_0.copy(), record.P_0.copy(), structure_of(Phi), work_for(record)
    estimates, covariances = np.empty((n, 12)), np.empty((n, 12, 12))
    for k in range(n):
        estimates[k], covariances[k] = x, P
        predictor_step(x, P, record, k, Gamma, structure, noise, work)
    return estimates, covariances


def used_covariance(V2: np.ndarray, noise: NoiseModel) -> np.ndarray:
    """Return the covariances (n, s, M, M) that a filter with this V uses in place of the recorded ones (n, s, M, M)."""
    from_record = noise.scale[:, np.newaxis, np.newaxis]
    return np.where(from_record > 0.0, from_record * V2, noise.V)
