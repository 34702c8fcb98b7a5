"""Subsets of the sensors: the rows of y that they fill, and their noise."""

from itertools import combinations

import numpy as np

from ortilo_drake.model.signals import N_Y, SENSORS
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.studies.loop.hover_loop import arrivals_of


def sensor_subsets(sensors: tuple[str, ...]) -> dict[str, tuple[str, ...]]:
    """Return every subset of some sensors by name: 'none', 'uwb', ..., 'uwb+camera+imu'."""
    present = [s for s in SENSORS if s in sensors]
    return {"+".join(some) or "none": some for k in range(len(present) + 1) for some in combinations(present, k)}


def arrived_rows(sensors: tuple[str, ...], V: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return which of the nine rows of y arrive (9, bool), and their covariance.

    Args:
        sensors: of uwb, camera and imu.
        V: covariance of all nine (9 x 9).

    Raises:
        InputError: if no sensor is named or a name is unknown, or V is not positive definite where it is used.
    """
    V = np.asarray(V, dtype=float)
    if V.shape != (N_Y, N_Y):
        raise InputError(f"V: shape {V.shape}: must be ({N_Y}, {N_Y})")
    rows = np.repeat(arrivals_of(sensors), 3) > 0.0
    if not rows.any():
        raise InputError(f"sensors: none: at least one of {', '.join(SENSORS)} must arrive")
    V = V[np.ix_(rows, rows)]
    if not np.isfinite(V).all() or np.linalg.eigvalsh(V)[0] <= 0.0:
        raise InputError("V: must be finite and positive definite")
    return rows, V
