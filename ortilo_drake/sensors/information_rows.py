"""Fisher information as rows; a row is one scalar measurement of the state.

A row stands for the measurement g^T x + a s + v in one tick, where v is noise of variance r and s is a slowly
changing error (or none). Its information g g^T / r may be unbounded (r = 0), because it is never formed. The rows of a
flight are one array (l, 5 + m), m states in x.
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
SLOW = 2  # number of the slowly changing error that is in it, -1 for none
AMPLITUDE = 3  # a, that error's standard deviation in the measurement's unit
SOURCE = 4  # what gave it: the number of the anchor, twice that of the landmark (+ 1 for v), or of the sensor's row
GRADIENT = slice(5, None)  # g [1/m, 1/rad of the measurement's unit]
ROW_SIZE = 5 + N_X


class Information(NamedTuple):
    """The Fisher information of a sensor's messages."""

    rows: dict[str, np.ndarray]
    """by what gave them, such as the sensor's name (l, 17 each)."""
    spacing: int = 1
    """ticks between the nodes of its slowly changing errors, 1 where it has none."""
    with_errors: Mapping[str, np.ndarray] = {}
    """rows that are information only beside those of unknown errors, likewise: they join `rows`, and replace those of
    the same name."""


def rows_of(
    ticks: np.ndarray, gradients: np.ndarray, variances: np.ndarray, sources: np.ndarray | int = 0
) -> np.ndarray:
    """Return rows without a slow error (l, 17): of each its tick, g over the states (l, 12), r and its source."""
    rows = np.zeros((len(ticks), ROW_SIZE))
    rows[:, TICK], rows[:, GRADIENT], rows[:, VARIANCE], rows[:, SLOW] = ticks, gradients, variances, -1.0
    rows[:, SOURCE] = sources
    return rows


def by_tick(*parts: np.ndarray) -> np.ndarray:
    """Return all rows in one array, in the order of their ticks."""
    rows = np.concatenate(parts) if parts else np.empty((0, ROW_SIZE))
    return rows[np.argsort(rows[:, TICK], kind="stable")]


def information(rows: np.ndarray) -> np.ndarray:
    """Return J = sum g g^T / r (m x m) of rows without a slow error."""
    g = rows[:, GRADIENT]
    J: np.ndarray = g.T @ (g / rows[:, VARIANCE, np.newaxis])
    return J


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
