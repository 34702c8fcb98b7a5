"""Monte Carlo of the filter's covariance over drawn arrival sequences; the bounds must enclose its mean."""

from typing import NamedTuple

import numpy as np

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.theory.arrivals.arrivals import Model
from ortilo_drake.theory.arrivals.expected_riccati_kernel import averaged_update, predicted


class MeanCovariance(NamedTuple):
    """The mean of P (n, n) at the last tick over many arrival sequences, and the standard error of its diagonal (n)."""

    mean: np.ndarray
    standard_error: np.ndarray


def draw_independent(probabilities: np.ndarray, runs: int, ticks: int, seed: int) -> np.ndarray:
    """Draw the pattern of each run and tick (runs, ticks) independently, with the patterns' probabilities (P)."""
    return draw_markov(np.ones((1, 1)), np.atleast_2d(probabilities), np.ones(1), runs, ticks, seed)


def draw_markov(
    T: np.ndarray, probabilities: np.ndarray, initial: np.ndarray, runs: int, ticks: int, seed: int
) -> np.ndarray:
    """Draw the arrival pattern of each run and tick (runs, ticks), with the probabilities of a Markov chain's mode.

    T is Pr(mode j next | mode i now) (M, M), `probabilities` (M, P) are those of the patterns in each mode, and
    `initial` (M) those of the modes at tick 0.
    """
    rng = np.random.default_rng(seed)

    def choose(table: np.ndarray, rows: np.ndarray) -> np.ndarray:
        edges = np.cumsum(table, axis=1)[:, :-1]
        return np.sum(rng.random(len(rows))[:, None] >= edges[rows], axis=1)

    mode = choose(np.atleast_2d(initial), np.zeros(runs, dtype=int))
    patterns = np.empty((runs, ticks), dtype=np.int64)
    for k in range(ticks):
        patterns[:, k] = choose(probabilities, mode)
        mode = choose(T, mode)
    return patterns


@cached_njit(nogil=True)
def _last_covariances(
    P_0: np.ndarray,
    A: np.ndarray,
    C: np.ndarray,
    W: np.ndarray,
    V: np.ndarray,
    rows: np.ndarray,
    patterns: np.ndarray,
) -> np.ndarray:
    """Return P (runs, n, n) after the last tick of each sequence of patterns (runs, ticks)."""
    runs, ticks = patterns.shape
    last = np.empty((runs, A.shape[0], A.shape[0]))
    certain = np.ones(1)
    for r in range(runs):
        P = P_0.copy()
        for k in range(ticks):
            p = patterns[r, k]
            P = predicted(averaged_update(P, C, V, rows[p : p + 1], certain), A, W)
        last[r] = P
    return last


def simulate(model: Model, P_0: np.ndarray, patterns: np.ndarray) -> MeanCovariance:
    """Return mean and standard error of the last P over patterns (runs, ticks): P_{k+1} = g_p(P_k) from P_0 (n, n)."""
    last = _last_covariances(np.ascontiguousarray(P_0, dtype=float), *model, patterns)
    diagonals = np.diagonal(last, axis1=1, axis2=2)
    return MeanCovariance(last.mean(axis=0), diagonals.std(axis=0, ddof=1) / np.sqrt(len(patterns)))
