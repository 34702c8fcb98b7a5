"""White noise at any rate: its density and the variance of a sample.

The mean over T seconds of noise with the density D [unit/sqrt(Hz)], two-sided spectrum D^2, has the standard deviation
D / sqrt(T). A sample every T seconds, or a value held for T seconds, has the same standard deviation. So the world is
the same at every control rate.
"""

from typing import Final

import numpy as np

USUAL_PERIOD: Final = 1.0 / 30.0  # [s], the tick of the ready-made scenarios
USUAL_ROOT: Final = float(np.sqrt(USUAL_PERIOD))  # times the sd of a sample every USUAL_PERIOD: the density


def white_sd(density: float, period: float) -> float:
    """Return the sd of samples taken every `period` seconds, of noise with a density [unit/sqrt(Hz)]."""
    return float(density / np.sqrt(period))


def white_variances(variances: tuple[float, ...], period: float) -> np.ndarray:
    """Rescale the variances of samples taken every USUAL_PERIOD to samples taken every `period` seconds."""
    return np.array(variances) * (USUAL_PERIOD / period)


def nees_of(e: np.ndarray, P: np.ndarray) -> np.ndarray:
    """Return e^T P^-1 e (n) of errors (n, m) and their covariances (n, m, m)."""
    return np.asarray(np.einsum("ki,ki->k", e, np.linalg.solve(P, e[:, :, np.newaxis])[:, :, 0]))
