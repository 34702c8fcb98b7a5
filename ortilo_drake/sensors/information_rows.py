"""Fisher information as rows; a row is one scalar measurement of the state.

A row stands for the measurement g^T x + a s + v in one tick, where v is noise of variance r, and s is a slowly
changing error, if there is one. The information g g^T / r may be unbounded (r = 0), because the code never computes it.
The rows of a flight are one array (l, 5 + m), with m states in x.
"""

from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np

from ortilo_drake.model.measurement import Row, rows_matrix, seen_earlier
from ortilo_drake.model.parts import Sensor
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import N_X
from ortilo_drake.scenario import Scenario

TICK = 0
VARIANCE = 1  # r
SLOW = 2  # number of the slowly changing error in the measurement, -1 for none
AMPLITUDE = 3  # a, the standard deviation of this error in the measurement's unit
SOURCE = 4  # index of the source: of the anchor, twice the landmark's (+ 1 for v), or of the sensor's row
GRADIENT = slice(5, None)  # g [1/m, 1/rad of the measurement's unit]
ROW_SIZE = 5 + N_X


class Information(NamedTuple):
    """The Fisher information of a sensor's messages."""

    rows: dict[str, np.ndarray]
    """rows by the name of their kind, such as the sensor's name (l, 17 each)."""
    spacing: int = 1
    """number of ticks between the nodes of the slowly changing errors, 1 without such errors."""
    with_errors: Mapping[str, np.ndarray] = {}
    """rows, by name as in `rows`, that count only together with unknown errors: they are added to `rows`, and replace
    those of the same name."""


def rows_of(
    ticks: np.ndarray, gradients: np.ndarray, variances: np.ndarray, sources: np.ndarray | int = 0
) -> np.ndarray:
    """Return rows without a slow error (l, 17), given ticks (l), g over the states (l, 12), r (l) and sources (l)."""
    rows = np.zeros((len(ticks), ROW_SIZE))
    rows[:, TICK], rows[:, GRADIENT], rows[:, VARIANCE], rows[:, SLOW] = ticks, gradients, variances, -1.0
    rows[:, SOURCE] = sources
    return rows


def by_tick(*parts: np.ndarray) -> np.ndarray:
    """Return all rows in one array, sorted by tick."""
    rows = np.concatenate(parts) if parts else np.empty((0, ROW_SIZE))
    return rows[np.argsort(rows[:, TICK], kind="stable")]


def information(rows: np.ndarray) -> np.ndarray:
    """Return the information J = sum g g^T / r (m x m) of rows without a slow error."""
    g = rows[:, GRADIENT]
    J: np.ndarray = g.T @ (g / rows[:, VARIANCE, np.newaxis])
    return J


def linear_rows(
    scenario: Scenario, samples: int, seen_rows: Iterable[Row], seen: np.ndarray, sd: np.ndarray
) -> np.ndarray:
    """Return the rows of y = C x + v; for a sensor faster than the tick, the rows of each sample with its age at t_k.

    seen_rows are the m rows of C; sd is the standard deviation of v (k, m) in the k ticks marked in `seen` (n), NaN
    without a measurement.
    """
    ticks, (i, j) = np.flatnonzero(seen), np.nonzero(np.isfinite(sd))
    parts, seen_rows = [], list(seen_rows)
    for age in scenario.h * np.arange(samples) / samples:
        C = rows_matrix([seen_earlier(its, age, scenario.yaw) for its in seen_rows])
        parts.append(rows_of(ticks[i], C[j], sd[i, j] ** 2, j))
    return np.concatenate(parts)


def own_rows(sensor: Sensor, scenario: Scenario, room: Room, truth: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Return the rows of a sensor whose noise is given by `sd`, at true states (n, 12), in the ticks in `seen` (n)."""
    assert sensor.sd is not None
    sd = sensor.sd(scenario, room, truth[np.flatnonzero(seen)])
    return linear_rows(scenario, scenario.samples(sensor.name), sensor.rows, seen, sd)
