"""Bounds on the mean error covariance of a filter whose measurements arrive at random.

Let arrivals be independent from tick to tick. In each tick pattern p of sensors arrives with probability Pr(p). The
covariance P_k of the one-step predictor is then random, P_{k+1} = g_p(P_k). The mean g of the g_p is concave and
monotone, so E[P_{k+1}] <= g(E[P_k]) (Jensen). With

    g(X) = A X A^T + W - sum_p Pr(p) A X C_p^T (C_p X C_p^T + V_p)^-1 C_p X A^T

the fixed point X = g(X) bounds the limit of E[P_k] from above, and X = (1 - l) A X A^T + W, l the probability that
anything arrives, from below (B. Sinopoli, L. Schenato, M. Franceschetti, K. Poolla, M. I. Jordan, S. S. Sastry, "Kalman
filtering with intermittent observations", IEEE TAC 49(9), 2004, theorems 3 and 4).

In bursts (Gilbert-Elliott) and with slow sensors the arrivals follow a Markov chain, whose mode i decides the patterns'
probabilities. With X_j the mean of P_k while the mode is j, concavity gives

    X_j(k+1) <= sum_i Pr(mode before = i | mode now = j) g_i(X_i(k)),   g_i(X) = sum_p Pr(p | i) g_p(X)

so the fixed point of these coupled equations bounds each mode's mean of P from above, and sum_j pi_j X_j bounds the
mean over all modes. They are the filtering equations of a Markov jump linear system (O. L. V. Costa, M. D. Fragoso, R.
P. Marques, "Discrete-Time Markov Jump Linear Systems", Springer 2005, chapter 5) in conditional form; stability of the
scalar case: M. Huang, S. Dey, "Stability of Kalman filtering with Markovian packet losses", Automatica 43(4), 2007.
"""

from typing import NamedTuple

import numpy as np

from ortilo_drake.model.hover import discretize, hover_A, hover_B, output_C
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.model.vehicle import M100
from ortilo_drake.theory.arrivals.arrivals import PATTERN_ROWS, Model, check_arrivals, check_model, check_rate
from ortilo_drake.theory.arrivals.expected_riccati_kernel import DIVERGED, SETTLED, coupled_fixed_point
from ortilo_drake.theory.modes.modes import unseen_modes

TOLERANCE = 1e-9  # error of the fixed point (not of the last step), relative to the variances
MOST_ITERATIONS = 200_000

TRANSLATION = np.array([0, 1, 2, 6, 7, 8])  # position and velocity among the twelve states
ROTATION = np.array([3, 4, 5, 9, 10, 11])  # angles and their rates; a filter's further states follow the twelve


def vehicle_model(W: np.ndarray, V: np.ndarray, h: float, C: np.ndarray | None = None) -> Model:
    """Return the vehicle's filter model at hover for ticks of h [s], with the patterns of arrivals.PATTERN_ROWS.

    W is the process noise per tick (12 x 12), V the noise of uwb, camera, imu and further sensors (p x p); further
    sensors arrive in every tick. C (p x 12) holds the rows of y over the states, uwb and camera first; by default the
    rows of the paper's three sensors. InputError if a matrix has a wrong shape or sign.
    """
    C = output_C() if C is None else C
    Phi, _ = discretize(hover_A(), hover_B(M100), h)  # Phi is the same for every vehicle
    beside = np.ones((len(PATTERN_ROWS), len(C) - PATTERN_ROWS.shape[1]), dtype=bool)  # further sensors
    return check_model(Model(Phi, C, W, V, np.hstack([PATTERN_ROWS, beside])))


def solve_coupled(
    model: Model, probabilities: np.ndarray, backward: np.ndarray, start: np.ndarray | None, what: str
) -> np.ndarray:
    """Return the fixed point X (M, n, n) of X_j = sum_i backward[j, i] g_i(X_i), iterated from start (M, n, n) or W.

    The caller has checked the model. The probabilities (M, P) are those of the patterns in each mode, and backward (M,
    M) is Pr(mode before = i | mode now = j). InputError, beginning with `what`, if a mode of A is never or too seldom
    seen, or if the iteration does not reach X.
    """
    check_arrivals(model, probabilities, what)
    X = np.repeat(model.W[None], len(probabilities), axis=0) if start is None else np.ascontiguousarray(start)
    X, iterations, state, to_come = coupled_fixed_point(
        X, *model, np.ascontiguousarray(probabilities), np.ascontiguousarray(backward), TOLERANCE, MOST_ITERATIONS
    )
    if state == DIVERGED:
        growing = unseen_modes(model.A, 0.0 * model.C, radius=1.0 + 1e-6)
        raise InputError(
            f"{what}: the covariance grows without bound, for {'; '.join(map(str, growing))} is seen too seldom"
        )
    if state != SETTLED:
        raise InputError(f"{what}: not settled to {TOLERANCE:g} after {iterations} iterations ({to_come:.1g} to come)")
    return X


def upper_bound(model: Model, probabilities: np.ndarray) -> np.ndarray:
    """Return X = g(X) (n, n), which bounds the limit of E[P_k] from above, to 1e-9 relative.

    InputError if `probabilities` (P) are no distribution, or X does not exist; it names the modes concerned.
    """
    return solve_coupled(model, np.atleast_2d(probabilities), np.ones((1, 1)), None, "expected Riccati equation")[0]


def lower_bound(A: np.ndarray, W: np.ndarray, arrival_rate: float) -> np.ndarray:
    """Return X = (1 - l) A X A^T + W (n, n), which bounds the limit of E[P_k] from below; inf where there is none.

    Sinopoli et al. (2004), theorem 4: an arrival, of probability l, can at best bring the error back to W. X exists
    while (1 - l) max|eigenvalue of A|^2 < 1. InputError if the rate lies outside [0, 1].
    """
    missed = np.array([1.0 - check_rate(arrival_rate, "arrival rate")])
    return coupled_lower_bound(A, W, missed, np.ones((1, 1)))[0]


def coupled_lower_bound(A: np.ndarray, W: np.ndarray, missed: np.ndarray, backward: np.ndarray) -> np.ndarray:
    """Return X (M, n, n) with X_j = sum_i backward[j, i] (missed_i A X_i A^T + W); inf where there is none.

    missed_i (M) is the chance that nothing arrives in mode i; backward (M, M) is Pr(mode before = i | mode now = j).
    """
    n, modes = A.shape[0], len(missed)
    missing = backward * missed
    growth = np.max(np.abs(np.linalg.eigvals(missing))) * np.max(np.abs(np.linalg.eigvals(A))) ** 2
    if growth >= 1.0 - 1e-12:
        return np.full((modes, n, n), np.inf)
    system = np.eye(modes * n * n) - np.kron(missing, np.kron(A, A))
    X = np.linalg.solve(system, np.tile(W.ravel(), modes)).reshape(modes, n, n)
    return (X + X.transpose(0, 2, 1)) / 2.0


def translation_noise(W: np.ndarray) -> np.ndarray:
    """Return W_t = W_tt - W_tr W_rr^+ W_rt (6 x 6): the noise of position and velocity, given the noise of the rest.

    The rest is attitude, rates and any further states. An estimator that knows the rest exactly knows its noise, and so
    the correlated part of the noise of position and velocity. If W has no such cross terms, W_t is W_tt.
    """
    rest = np.setdiff1d(np.arange(len(W)), TRANSLATION)
    W_tr, W_rr = W[np.ix_(TRANSLATION, rest)], W[np.ix_(rest, rest)]
    W_t = W[np.ix_(TRANSLATION, TRANSLATION)] - W_tr @ np.linalg.pinv(W_rr, rcond=1e-12, hermitian=True) @ W_tr.T
    return np.asarray((W_t + W_t.T) / 2.0)


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
