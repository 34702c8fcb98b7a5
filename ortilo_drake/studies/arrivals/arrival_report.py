"""The report on arrivals: the bounds over the arrival rates and the critical rate."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ortilo_drake.model.signals import STATE_NAMES
from ortilo_drake.studies.arrivals.arrival_map import rate_map
from ortilo_drake.studies.loop.hover_loop import HoverLoop
from ortilo_drake.theory.arrivals.arrivals import Model, check_model, never_seen, pattern_probabilities
from ortilo_drake.theory.arrivals.critical_rate import CriticalRate, critical_rate

PATTERNS = ((False, False), (True, False), (False, True), (True, True))  # of uwb and camera, as arrivals.PATTERN_ROWS


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


def filter_model(loop: HoverLoop, V: np.ndarray) -> Model:
    """Return the model of a scenario's filter for the bounds: none, uwb, camera and both arrive, with all else.

    Args:
        loop: of the scenario.
        V: covariance of all measurements that the filter gets (p x p), see hover_loop.filter_V.
    """
    sensors, mapped = loop.measurement.sensors, loop.measurement.positions[:2]
    patterns = [[arrive[mapped.index(s)] if s in mapped else True for s in sensors] for arrive in PATTERNS]
    return check_model(Model(loop.Phi, loop.C, loop.W, V, loop.measurement.by_row(np.array(patterns))))


def arrival_report(
    loop: HoverLoop, V: np.ndarray, rates_uwb: Sequence[float], rates_camera: Sequence[float]
) -> ArrivalReport:
    """Return the bounds over the arrival rates per tick of uwb and camera, with the classical critical rate.

    Args:
        loop: of the scenario.
        V: covariance of all measurements that the filter gets (p x p).
        rates_uwb: in [0, 1] (n).
        rates_camera: in [0, 1] (m).

    Raises:
        InputError: if a rate lies outside [0, 1], or V is no covariance.
    """
    model = filter_model(loop, V)
    grid = rate_map(model, rates_uwb, rates_camera)
    unseen = never_seen(model, pattern_probabilities(0.0, 0.0), loop.names)
    return ArrivalReport(
        states=tuple(STATE_NAMES),
        rates_uwb=grid.rows,
        rates_camera=grid.columns,
        upper=grid.upper,
        lower=grid.lower,
        without_position_sensors=[str(mode) for mode in unseen],
        critical_rate=critical_rate(model.A, model.C),
    )
