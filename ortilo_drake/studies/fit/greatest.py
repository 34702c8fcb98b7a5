"""Positive numbers that maximise a likelihood, and intervals that hold them with 95 % probability.

The logarithms of the numbers are searched by Nelder and Mead's simplex, begun anew where it stopped.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize
from scipy.stats import t as student

SIZES, MOST = (0.5, 0.5, 0.1), 300  # steps of the searches, in logarithms, and most likelihoods of one search
FALL = 0.5  # fall of the log-likelihood over a step: that of a standard deviation
WIDEST = 1.0  # widest step, in logarithms
TIMES = 1.959964  # standard deviations of a normal number to either side


class Interval(NamedTuple):
    """A number, and the ends of its interval."""

    value: float
    low: float
    high: float

    def holds(self, value: float) -> bool:
        """Return whether a number lies in the interval."""
        return self.low <= value <= self.high


def normal_interval(value: float, sd: float) -> Interval:
    """Return the 95 % interval of a number whose error is normal with this sd."""
    return Interval(float(value), float(value - TIMES * sd), float(value + TIMES * sd))


def half_width(values: np.ndarray) -> np.ndarray:
    """Return half the width of the interval of a mean, by Student's t over its values (m, ...)."""
    m = len(values)
    return np.asarray(student.ppf(0.975, m - 1) * np.std(values, axis=0, ddof=1) / np.sqrt(m))


def log_interval(log_value: float, sd: float) -> Interval:
    """Return the 95 % interval of a positive number whose logarithm has a normal error of this sd."""
    return Interval(*(float(np.exp(end)) for end in normal_interval(log_value, sd)))


def greatest(
    likelihood: Callable[[np.ndarray], float],
    start: np.ndarray,
    limits: Sequence[tuple[float, float]],
    sizes: Sequence[float] = SIZES,
) -> np.ndarray:
    """Return the logarithms of the numbers, within the limits, by searches of these step sizes from `start`."""
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
    """Return standard deviations (k) from second derivatives, taken over about one standard deviation."""

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
