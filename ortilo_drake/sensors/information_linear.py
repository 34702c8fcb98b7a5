"""Fisher information of a sensor whose value is linear in the state, from its rows of C and its noise."""

from collections.abc import Iterable

import numpy as np

from ortilo_drake.model.measurement import Row, rows_matrix, seen_earlier
from ortilo_drake.model.parts import Sensor
from ortilo_drake.model.room import Room
from ortilo_drake.scenario import Scenario
from ortilo_drake.sensors.information_rows import rows_of


def linear_rows(
    scenario: Scenario, samples: int, seen_rows: Iterable[Row], seen: np.ndarray, sd: np.ndarray
) -> np.ndarray:
    """Return the rows of y = C x + v; a sensor faster than the tick gives each sample, which sees t_k at its age.

    C has rows (m), and v of ticks that are seen (n) an sd (k, m), NaN where there is nothing.
    """
    ticks, (i, j) = np.flatnonzero(seen), np.nonzero(np.isfinite(sd))
    parts, seen_rows = [], list(seen_rows)
    for age in scenario.h * np.arange(samples) / samples:
        C = rows_matrix([seen_earlier(its, age, scenario.yaw) for its in seen_rows])
        parts.append(rows_of(ticks[i], C[j], sd[i, j] ** 2, j))
    return np.concatenate(parts)


def own_rows(sensor: Sensor, scenario: Scenario, room: Room, truth: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Return the rows of a sensor that tells its noise by `sd`, at true states (n, 12) in the ticks that are seen."""
    assert sensor.sd is not None
    sd = sensor.sd(scenario, room, truth[np.flatnonzero(seen)])
    return linear_rows(scenario, scenario.samples(sensor.name), sensor.rows, seen, sd)
