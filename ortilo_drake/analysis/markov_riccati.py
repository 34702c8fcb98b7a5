"""The expected Riccati equation when arrivals follow a Markov chain: bursts (Gilbert-Elliott) and slow sensors.

The chain's mode i decides the patterns' probabilities. With X_j the mean of P_k while the mode is j, concavity gives

    X_j(k+1) <= sum_i Pr(mode before = i | mode now = j) g_i(X_i(k)),   g_i(X) = sum_p Pr(p | i) g_p(X)

so the fixed point of these coupled equations bounds each mode's mean of P from above, and sum_j pi_j X_j the mean over
all. They are the filtering equations of a Markov jump linear system (O. L. V. Costa, M. D. Fragoso, R. P. Marques,
"Discrete-Time Markov Jump Linear Systems", Springer 2005, chapter 5) in conditional form; stability of the scalar case:
M. Huang, S. Dey, "Stability of Kalman filtering with Markovian packet losses", Automatica 43(4), 2007.
"""

from math import lcm
from typing import NamedTuple

import numpy as np

from ortilo_drake.analysis.arrivals import Model
from ortilo_drake.analysis.expected_riccati import (
    ROTATION,
    TRANSLATION,
    coupled_lower_bound,
    solve_coupled,
    translation_noise,
)
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.settings.link import Link, Loss

_RARE = 1e-14  # a mode visited less often is not visited


class ArrivalChain(NamedTuple):
    """A Markov chain of modes, each with probabilities of the arrival patterns; only modes that recur.

    Attributes:
        T: Pr(mode j next | mode i now) (M, M).
        probabilities: of the patterns in each mode (M, P).
        stationary: share of time in each mode, pi = pi T (M).
        backward: Pr(mode before = i | mode now = j) = pi_i T_ij / pi_j (M, M).
    """

    T: np.ndarray
    probabilities: np.ndarray
    stationary: np.ndarray
    backward: np.ndarray


def arrival_chain(T: np.ndarray, probabilities: np.ndarray, start: int = 0) -> ArrivalChain:
    """Return the chain restricted to the modes in which it stays for ever, coming from one mode.

    Args:
        T: Pr(mode j next | mode i now) (M, M).
        probabilities: of the patterns in each mode (M, P).
        start: the mode it starts in.

    Raises:
        InputError: if a row of T is no probability distribution.
    """
    T = np.array(T, dtype=float)
    if not np.all(T >= 0.0) or not np.allclose(T.sum(axis=1), 1.0, rtol=0.0, atol=1e-9):
        raise InputError("Markov chain: the rows of T must be at least 0 and sum to 1")
    # The mean of T^k over time, row `start`; (I + T) / 2 has the same and is never periodic.
    limit = (np.eye(len(T)) + T) / 2.0
    for _ in range(60):
        limit = limit @ limit
        limit /= limit.sum(axis=1, keepdims=True)
    kept = limit[start] > _RARE
    T, pi = T[np.ix_(kept, kept)], limit[start, kept] / limit[start, kept].sum()
    backward = (pi[:, None] * T / pi[None, :]).T
    backward = np.ascontiguousarray(backward / backward.sum(axis=1, keepdims=True))
    return ArrivalChain(T, np.asarray(probabilities)[kept], pi, backward)


def loss_chain(loss: Loss) -> tuple[np.ndarray, np.ndarray]:
    """Return T and the arrival probability in each mode of a link's loss; the first mode is where it starts."""
    match loss.kind:
        case "gilbert_elliott":
            g, b = loss.good_to_bad, loss.bad_to_good
            return np.array([[1 - g, g], [b, 1 - b]]), 1.0 - np.array([loss.loss_good, loss.loss_bad])
        case "bernoulli":
            return np.ones((1, 1)), np.array([1.0 - loss.probability])
    return np.ones((1, 1)), np.ones(1)


def link_chain(uwb: Link | None, camera: Link | None) -> ArrivalChain:
    """Return the chain of uwb and camera as their links have it; patterns as arrivals.PATTERN_ROWS.

    Modes: tick within the senders' common period, times the loss chains of both, which step once a tick. Blackouts and
    delays are left out.

    Args:
        uwb: link of the uwb fixes, or None where the sensor does not fly.
        camera: link of the camera fixes, or None.
    """
    chains = [(np.ones((1, 1)), np.zeros(1)) if link is None else loss_chain(link.loss) for link in (uwb, camera)]
    (T_u, arrives_u), (T_c, arrives_c) = chains
    every = [1 if link is None else link.every for link in (uwb, camera)]
    period = lcm(*every)
    T = np.kron(np.roll(np.eye(period), 1, axis=1), np.kron(T_u, T_c))
    probabilities = []
    for tick in range(period):
        for u in arrives_u * (tick % every[0] == 0):
            for c in arrives_c * (tick % every[1] == 0):
                probabilities.append([(1 - u) * (1 - c), u * (1 - c), (1 - u) * c, u * c])
    return arrival_chain(T, np.array(probabilities))


def burst_loss(arrival_rate: float, burst: float) -> tuple[float, float]:
    """Return (good to bad, bad to good) of a chain that loses everything while bad and nothing while good.

    A stay in the bad mode lasts 1 / (bad to good) ticks on average; bad to good / (sum of both) of the time is good.

    Args:
        arrival_rate: share of ticks that arrive, in (0, 1].
        burst: mean length of a burst of losses [ticks], at least 1.

    Raises:
        InputError: if there is no such chain; bursts must be at least (1 - rate) / rate ticks long, since a good mode
            lasts at least one.
    """
    if not 0.0 < arrival_rate <= 1.0:
        raise InputError(f"arrival rate: {arrival_rate}: must lie in (0, 1] for bursts")
    if not 1.0 <= burst < np.inf:
        raise InputError(f"mean burst: {burst} ticks: must be at least 1 tick")
    good_to_bad = (1.0 - arrival_rate) / (arrival_rate * burst)
    if good_to_bad > 1.0:
        raise InputError(
            f"mean burst: {burst:g} ticks: must be at least {(1 - arrival_rate) / arrival_rate:g} at arrival rate "
            f"{arrival_rate:g}, for a good tick must lie between two bursts"
        )
    return good_to_bad, 1.0 / burst


def markov_upper_bound(model: Model, chain: ArrivalChain, start: np.ndarray | None = None) -> np.ndarray:
    """Return X (M, n, n), each mode's bound on the mean of P; average_over_modes gives the bound on E[P].

    Args:
        model: from expected_riccati.vehicle_model or arrivals.check_model.
        chain: from arrival_chain or link_chain.
        start: where to start the iteration (M, n, n), or None for W.

    Raises:
        InputError: if there is no fixed point; the modes of A concerned are named.
    """
    return solve_coupled(model, chain.probabilities, chain.backward, start, "coupled Riccati equations")


def average_over_modes(chain: ArrivalChain, X: np.ndarray) -> np.ndarray:
    """Return sum_j pi_j X_j (n, n) of X (M, n, n)."""
    return np.einsum("m,mij->ij", chain.stationary, X)


def markov_translation_lower_bound(model: Model, chain: ArrivalChain) -> np.ndarray:
    """Return each mode's bound from below on the mean of P of position and velocity (M, 6, 6).

    As expected_riccati.translation_lower_bound, mode by mode: an arrival can at best bring the error back to W_t.

    Args:
        model: of the vehicle, from expected_riccati.vehicle_model.
        chain: over arrivals.PATTERN_ROWS.
    """
    Phi_t = model.A[np.ix_(TRANSLATION, TRANSLATION)]
    if np.any(model.A[np.ix_(ROTATION, TRANSLATION)]):
        raise InputError("lower bound: attitude must not depend on position")
    return coupled_lower_bound(Phi_t, translation_noise(model.W), chain.probabilities[:, 0], chain.backward)
