"""Likelihood of range errors that last, by a Kalman filter of the anchors' errors.

Each anchor i has a constant c_i [m], the same in all recordings, and an error g_i [m] that lasts: a first-order
Gauss-Markov process of its own. An error of a range to b, or of a difference of the ranges to b and a, is

    e = c_b + g_b (- c_a - g_a) + white,   an outlier with probability q, whose error has a further deviation o

A row's density is the mixture of both. What is known behind it has the mixture's mean and covariance (Bar-Shalom, Li
and Kirubarajan, Estimation with Applications, 2001, section 11.6.4: the first generalised pseudo-Bayesian estimator).
"""

import numpy as np
from numba import njit

PRIOR = 1.0  # deviation of a constant [m]


@njit(cache=True)
def lasting_filter(
    t: np.ndarray,
    anchor: np.ndarray,
    other: np.ndarray,
    e: np.ndarray,
    x: np.ndarray,
    C: np.ndarray,
    numbers: np.ndarray,
    outlier: np.ndarray,
) -> float:
    """Return the log-likelihood of a recording's errors; x and C become the constants' estimate after it.

    Args:
        t: stamps [s] (m).
        anchor: b (m).
        other: a, or -1 (m).
        e: errors [m] (m).
        x: the constants' means (n); changed.
        C: their covariance (n, n); changed.
        numbers: time constant [s], deviation of the lasting error, of the white one [m], q, and o [m].
        outlier: gets each row's probability to be one (m).
    """
    n, (tau, sd, white, share, far) = len(x), numbers
    z, S = np.zeros(2 * n), np.zeros((2 * n, 2 * n))
    z[:n], S[:n, :n] = x, C
    for i in range(n, 2 * n):
        S[i, i] = sd * sd
    column, total = np.empty(2 * n), 0.0
    for k in range(len(t)):
        h = t[k] - t[k - 1] if k > 0 else 0.0
        if h > 0.0:
            keep = np.exp(-h / tau)
            for i in range(n, 2 * n):
                z[i] *= keep
                for j in range(n):
                    S[i, j] *= keep
                    S[j, i] = S[i, j]
                for j in range(n, 2 * n):
                    S[i, j] *= keep * keep
                S[i, i] += (1.0 - keep * keep) * sd * sd
        b, a = anchor[k], other[k]
        for i in range(2 * n):
            column[i] = S[i, b] + S[i, n + b]
            if a >= 0:
                column[i] -= S[i, a] + S[i, n + a]
        y, V = e[k] - z[b] - z[n + b], white * white + column[b] + column[n + b]
        if a >= 0:
            y += z[a] + z[n + a]
            V -= column[a] + column[n + a]
        U = V + far * far
        usual = np.log(1.0 - share) - 0.5 * (np.log(2.0 * np.pi * V) + y * y / V)
        odd = np.log(share) - 0.5 * (np.log(2.0 * np.pi * U) + y * y / U)
        most = max(usual, odd)
        density = most + np.log(np.exp(usual - most) + np.exp(odd - most))
        total += density
        p = np.exp(odd - density)
        outlier[k] = p
        moves = y * ((1.0 - p) / V + p / U)
        spread = (1.0 - p) * (y / V) ** 2 + p * (y / U) ** 2 - moves * moves
        known = (1.0 - p) / V + p / U - spread
        for i in range(2 * n):
            z[i] += column[i] * moves
            for j in range(2 * n):
                S[i, j] -= column[i] * column[j] * known
    x[:], C[:] = z[:n], S[:n, :n]
    return total
