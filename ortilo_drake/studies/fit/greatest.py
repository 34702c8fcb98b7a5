"""Positive numbers that maximise a likelihood, and their intervals.

The logarithms of the numbers are searched by Nelder and Mead's simplex, begun anew where it stopped.
"""

from collections.abc import Callable, Sequence

import numpy as np
from scipy.optimize import minimize

SIZES, MOST = (0.5, 0.5, 0.1), 300  # of the searches, in logarithms, and likelihoods of one
FALL = 0.5  # of the log-likelihood over a step: a standard deviation's
WIDEST = 1.0  # step, in logarithms


def greatest(
    likelihood: Callable[[np.ndarray], float],
    start: np.ndarray,
    limits: Sequence[tuple[float, float]],
    sizes: Sequence[float] = SIZES,
) -> np.ndarray:
    """Return the logarithms of the numbers.

    Args:
        likelihood: of the numbers' logarithms.
        start: the logarithms to start from.
        limits: beyond these a number is none.
        sizes: of the searches.
    """
    low, high = np.log(np.array(limits)).T

    def cost(logs: np.ndarray) -> float:
        beyond = float(np.sum(np.maximum(low - logs, 0.0) + np.maximum(logs - high, 0.0)))
        return -likelihood(np.clip(logs, low, high)) + 1e3 * beyond

    logs = start
    for size in sizes:
        simplex = np.vstack([logs, logs + size * np.eye(len(logs))])
        options = {"maxfev": MOST, "xatol": 2e-3, "fatol": 0.02, "initial_simplex": simplex, "adaptive": True}
        logs = minimize(cost, logs, method="Nelder-Mead", options=options).x
    return np.asarray(np.clip(logs, low, high))


def deviations(likelihood: Callable[[np.ndarray], float], x: np.ndarray) -> np.ndarray:
    """Return standard deviations by second derivatives (k), taken over about one."""

    def cost(at: np.ndarray) -> float:
        return -likelihood(at)

    k, middle = len(x), cost(x)
    h = np.zeros(k)
    for i in range(k):
        step = np.zeros(k)
        step[i] = 0.01
        while step[i] < WIDEST and 0.5 * (cost(x + step) + cost(x - step)) - middle < FALL:
            step[i] *= 1.5
        h[i] = step[i]
    H, steps = np.empty((k, k)), np.diag(h)
    for i in range(k):
        for j in range(i + 1):
            a, b = steps[i], steps[j]
            if i == j:
                H[i, i] = (cost(x + a) - 2.0 * middle + cost(x - a)) / h[i] ** 2
                continue
            corners = cost(x + a + b) - cost(x + a - b) - cost(x - a + b) + cost(x - a - b)
            H[i, j] = H[j, i] = corners / (4.0 * h[i] * h[j])
    values, vectors = np.linalg.eigh(H)
    return np.asarray(np.sqrt(np.sum(vectors**2 / np.maximum(values, 1.0 / (2.0 * WIDEST) ** 2), axis=1)))
