"""The report on arrivals: the bounds over the arrival rates and the critical rate, as plain data."""

from collections.abc import Sequence

import numpy as np

from ortilo_drake.model.signals import STATE_NAMES
from ortilo_drake.studies.arrivals.arrival_map import riccati_map
from ortilo_drake.theory.arrivals.arrivals import never_seen, pattern_probabilities
from ortilo_drake.theory.arrivals.critical_rate import critical_rate
from ortilo_drake.theory.arrivals.expected_riccati import vehicle_model


def arrival_report(
    W: np.ndarray,
    V: np.ndarray,
    h: float,
    rates_uwb: Sequence[float],
    rates_camera: Sequence[float],
    C: np.ndarray | None = None,
) -> dict[str, object]:
    """Return riccati_map as plain lists for JSON, with the classical critical rate; unbounded variances are None.

    Arguments and errors as riccati_map.
    """
    grid = riccati_map(W, V, h, rates_uwb, rates_camera, C)
    model = vehicle_model(W, V, h, C)
    unseen = never_seen(model, pattern_probabilities(0.0, 0.0))

    def plain(variances: np.ndarray) -> list[object]:
        finite = variances.astype(object)
        finite[~np.isfinite(variances)] = None
        return finite.tolist()

    return {
        "states": list(STATE_NAMES),
        "rates_uwb": grid.rows.tolist(),
        "rates_camera": grid.columns.tolist(),
        "upper": plain(grid.upper),
        "lower": plain(grid.lower),
        "without_position_sensors": [str(mode) for mode in unseen],
        "critical_rate": critical_rate(model.A, model.C)._asdict(),
    }
