"""The samples of a sensor faster than the tick: their times, their noise, and the states that they measure.

Sample i = 1 .. n of tick k is taken at t_k - h + h i / n. The plant keeps the states at these instants inside the tick
(vehicle/continuous.py), the oldest first; sample n measures the state at t_k itself.
"""

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.model.signals import N_X
from ortilo_drake.world.vehicle.continuous import PASSED


def rows_of(n: int, instants: np.ndarray) -> np.ndarray:
    """Return which of the instants are those of a sensor's first n - 1 samples in a tick (n - 1)."""
    return np.searchsorted(instants, [i / n for i in range(1, n)])


@register_jitable
def sample_time(k: int, i: int, n: int, h: float) -> float:
    """Return the time of sample i of n in tick k [s]."""
    return k * h if i == n else h * (i / n) + (k - 1) * h


@register_jitable
def seed_of_sample(seeds: np.ndarray, k: int, i: int, n: int) -> int:
    """Return the seed of the noise of sample i of n in tick k: inside a tick it is the seed of the tick before."""
    return seeds[min(k if i == n else k - 1, seeds.size - 1)]


@register_jitable
def passed_at(passed: np.ndarray, row: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the state (12) and v_dot (3) at an instant inside the last tick."""
    at = row * PASSED
    return passed[at : at + N_X], passed[at + N_X : at + PASSED]
