"""Subsets of the sensors: the rows of y that they fill, and their noise."""

from itertools import combinations

import numpy as np

from ortilo_drake.model.measurement import Measurement
from ortilo_drake.model.parts import measurement_of
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.studies.loop.hover_loop import arrivals_of


def sensor_subsets(sensors: tuple[str, ...]) -> dict[str, tuple[str, ...]]:
    """Return every subset of some sensors by name: 'none', then each, then their names joined by '+'."""
    present = [s for s in measurement_of(sensors).sensors if s in sensors]
    return {"+".join(some) or "none": some for k in range(len(present) + 1) for some in combinations(present, k)}


def arrived_rows(
    sensors: tuple[str, ...], V: np.ndarray, measurement: Measurement | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return a mask of the rows of y that arrive (p), and their covariance.

    Args:
        sensors: those that arrive.
        V: covariance of all rows (p x p).
        measurement: of all sensors; by default the paper's three and those named.

    Raises:
        InputError: if no sensor is named or a name is unknown, or V is not positive definite where it is used.
    """
    V = np.asarray(V, dtype=float)
    measurement = measurement or measurement_of(sensors)
    p = measurement.sizes["y"]
    if V.shape != (p, p):
        raise InputError(f"V: shape {V.shape}: must be ({p}, {p})")
    rows = measurement.by_row(arrivals_of(sensors, measurement)) > 0.0
    if not rows.any():
        raise InputError(f"sensors: none: at least one of {', '.join(measurement.sensors)} must arrive")
    V = V[np.ix_(rows, rows)]
    if not np.isfinite(V).all() or np.linalg.eigvalsh(V)[0] <= 0.0:
        raise InputError("V: must be finite and positive definite")
    return rows, V
