"""Errors that last: constants, and noise that changes slowly, sampled exactly at the ticks.

    e_k = b + x_k,   x_{k+1} = a x_k + q w_k,   w standard normal.

First-order Gauss-Markov noise of standard deviation s and correlation time T has a = exp(-h / T), q = s sqrt(1 - a^2)
and x_0 = s w: stationary with E[x_j x_k] = s^2 a^|j - k|. A random walk that comes to the standard deviation r in 1 s
has a = 1, q = r sqrt(h) and x_0 = 0. (A. Gelb, ed., "Applied Optimal Estimation", 1974, section 3.8.)
"""

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from ortilo_drake.model.clock import tick_of
from ortilo_drake.model.placing import put
from ortilo_drake.world.noise import normals


class SlowNoise(NamedTuple):
    """The process of x_k, for each of its n components."""

    a: np.ndarray
    """decay over a tick (n)."""
    q: np.ndarray
    """standard deviation of what is new in a tick (n)."""
    start: np.ndarray
    """standard deviation of x_0 (n)."""


def gauss_markov(sd: np.ndarray, time: float, h: float) -> SlowNoise:
    """Return first-order Gauss-Markov noise of standard deviations (n), correlation time and tick [s]."""
    a = np.exp(-h / time)
    return SlowNoise(np.full(len(sd), a), sd * np.sqrt(1.0 - a * a), sd)


def random_walk(after_1_s: np.ndarray, h: float) -> SlowNoise:
    """Return a random walk of standard deviations after 1 s (n), and tick [s]."""
    return SlowNoise(np.ones(len(after_1_s)), after_1_s * np.sqrt(h), np.zeros(len(after_1_s)))


@njit(cache=True)
def slow_noise_after(
    x: np.ndarray, a: np.ndarray, q: np.ndarray, seed: int, stream: np.uint64, time: float, h: float
) -> np.ndarray:
    """Return x_{k+1} from x_k (n) at t_k [s]."""
    return a * x + q * normals(seed, stream, tick_of(time, h) + 1, len(a))


def slow_step(n: Any, k: int, seed: int, x: np.ndarray, a: np.ndarray, q: np.ndarray) -> None:
    """Go on to the slow part of the next tick, of an element with a stream and the tick h [s]."""
    put(slow_noise_after(x, a, q, seed, n.stream, k * n.h, n.h), x)
