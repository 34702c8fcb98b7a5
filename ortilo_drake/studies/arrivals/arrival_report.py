"""The report on arrivals: the bounds over the arrival rates and the critical rate."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ortilo_drake.model.signals import STATE_NAMES
from ortilo_drake.studies.arrivals.arrival_map import riccati_map
from ortilo_drake.theory.arrivals.arrivals import never_seen, pattern_probabilities
from ortilo_drake.theory.arrivals.critical_rate import CriticalRate, critical_rate
from ortilo_drake.theory.arrivals.expected_riccati import vehicle_model


@dataclass(frozen=True)
class ArrivalReport:
    """Bounds of the expected Riccati equation over arrival rates.

    Attributes:
        states: names of the states.
        rates_uwb: (n).
        rates_camera: (m).
        upper: bound of each state's variance (n, m, 12), inf where it is unbounded.
        lower: the other bound.
        without_position_sensors: the modes that are then unseen, in words.
        critical_rate: the classical one.
    """

    states: tuple[str, ...]
    rates_uwb: np.ndarray
    rates_camera: np.ndarray
    upper: np.ndarray
    lower: np.ndarray
    without_position_sensors: list[str]
    critical_rate: CriticalRate


def arrival_report(
    W: np.ndarray,
    V: np.ndarray,
    h: float,
    rates_uwb: Sequence[float],
    rates_camera: Sequence[float],
    C: np.ndarray | None = None,
) -> ArrivalReport:
    """Return riccati_map with the classical critical rate.

    Arguments and errors as riccati_map.
    """
    grid = riccati_map(W, V, h, rates_uwb, rates_camera, C)
    model = vehicle_model(W, V, h, C)
    unseen = never_seen(model, pattern_probabilities(0.0, 0.0))
    return ArrivalReport(
        states=tuple(STATE_NAMES),
        rates_uwb=grid.rows,
        rates_camera=grid.columns,
        upper=grid.upper,
        lower=grid.lower,
        without_position_sensors=[str(mode) for mode in unseen],
        critical_rate=critical_rate(model.A, model.C),
    )
