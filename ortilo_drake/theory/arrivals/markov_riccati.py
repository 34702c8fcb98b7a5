"""The expected Riccati equation when arrivals follow a Markov chain: bursts (Gilbert-Elliott) and slow sensors.

The chain's mode i decides the patterns' probabilities. With X_j the mean of P_k while the mode is j, concavity gives

    X_j(k+1) <= sum_i Pr(mode before = i | mode now = j) g_i(X_i(k)),   g_i(X) = sum_p Pr(p | i) g_p(X)

so the fixed point of these coupled equations bounds each mode's mean of P from above, and sum_j pi_j X_j bounds the
mean over all modes. They are the filtering equations of a Markov jump linear system (O. L. V. Costa, M. D. Fragoso, R.
P. Marques, "Discrete-Time Markov Jump Linear Systems", Springer 2005, chapter 5) in conditional form; stability of the
scalar case: M. Huang, S. Dey, "Stability of Kalman filtering with Markovian packet losses", Automatica 43(4), 2007.
"""

from typing import NamedTuple

import numpy as np

from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.theory.arrivals.arrivals import Model
from ortilo_drake.theory.arrivals.expected_riccati import ROTATION, TRANSLATION, coupled_lower_bound, translation_noise

_RARE = 1e-14  # a mode with a smaller share of time counts as never visited


class ArrivalChain(NamedTuple):
    """A Markov chain of modes, each with probabilities of the arrival patterns (M, P); only modes that recur.

    T is Pr(mode j next | mode i now) (M, M), stationary the share of time in each mode, pi = pi T (M), and backward
    Pr(mode before = i | mode now = j) = pi_i T_ij / pi_j (M, M).
    """

    T: np.ndarray
    probabilities: np.ndarray
    stationary: np.ndarray
    backward: np.ndarray


def arrival_chain(T: np.ndarray, probabilities: np.ndarray) -> ArrivalChain:
    """Return the chain restricted to the recurrent modes that it reaches from the first mode.

    T is Pr(mode j next | mode i now) (M, M), with the probabilities of the patterns in each mode (M, P). InputError if
    a row of T is no probability distribution.
    """
    T = np.array(T, dtype=float)
    if not np.all(T >= 0.0) or not np.allclose(T.sum(axis=1), 1.0, rtol=0.0, atol=1e-9):
        raise InputError("Markov chain: the rows of T must be at least 0 and sum to 1")
    # Row 0 of the mean of T^k over time. (I + T) / 2 has the same mean and is never periodic.
    limit = (np.eye(len(T)) + T) / 2.0
    for _ in range(60):
        limit = limit @ limit
        limit /= limit.sum(axis=1, keepdims=True)
    kept = limit[0] > _RARE
    T, pi = T[np.ix_(kept, kept)], limit[0, kept] / limit[0, kept].sum()
    backward = (pi[:, None] * T / pi[None, :]).T
    backward = np.ascontiguousarray(backward / backward.sum(axis=1, keepdims=True))
    return ArrivalChain(T, np.asarray(probabilities)[kept], pi, backward)


def average_over_modes(chain: ArrivalChain, X: np.ndarray) -> np.ndarray:
    """Return sum_j pi_j X_j (n, n) of X (M, n, n)."""
    return np.einsum("m,mij->ij", chain.stationary, X)


def markov_translation_lower_bound(model: Model, chain: ArrivalChain) -> np.ndarray:
    """Return each mode's lower bound on the mean of P's block of position and velocity (M, 6, 6).

    For a filter that knows attitude and rates as well, an arrival can at best bring the error back to W_t. The model is
    the vehicle's, the chain is over arrivals.PATTERN_ROWS.
    """
    Phi_t = model.A[np.ix_(TRANSLATION, TRANSLATION)]
    if np.any(model.A[np.ix_(ROTATION, TRANSLATION)]):
        raise InputError("lower bound: attitude must not depend on position")
    return coupled_lower_bound(Phi_t, translation_noise(model.W), chain.probabilities[:, 0], chain.backward)
