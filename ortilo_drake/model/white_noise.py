"""White noise at any rate: its density, and what a sample has of it.

Noise of density D [unit/sqrt(Hz)], two-sided spectrum D^2, has over T seconds a mean of standard deviation D / sqrt(T).
So has a sample every T seconds, or a value held so long: the world is the same at every control rate.
"""

from typing import Final

import numpy as np

USUAL_PERIOD: Final = 1.0 / 30.0  # s: the tick of the ready-made scenarios
USUAL_ROOT: Final = float(np.sqrt(USUAL_PERIOD))  # times the sd of a sample of theirs: the density


def white_sd(density: float, period: float) -> float:
    """Return the standard deviation of a sample every so many seconds, of noise of a density [unit/sqrt(Hz)]."""
    return float(density / np.sqrt(period))


def white_variances(variances: tuple[float, ...], period: float) -> np.ndarray:
    """Return the variances of a sample every so many seconds, of those of one every USUAL_PERIOD."""
    return np.array(variances) * (USUAL_PERIOD / period)
