"""Fisher information as rows; a row is one scalar measurement of the state.

A row stands for the measurement g^T x + a s + v in one tick, where v is noise of variance r and s is a slowly
changing error (or none). Its information g g^T / r may be unbounded (r = 0), because it is never formed. The rows of a
flight are one array (m, 16).
"""

import numpy as np

from ortilo_drake.model.signals import N_X

TICK = 0
GRADIENT = slice(1, 13)  # g [1/m, 1/rad of the measurement's unit]
VARIANCE = 13  # r
SLOW = 14  # number of the slowly changing error that is in it, -1 for none
AMPLITUDE = 15  # a, that error's standard deviation in the measurement's unit
ROW_SIZE = 16


def rows_of(ticks: np.ndarray, gradients: np.ndarray, variances: np.ndarray) -> np.ndarray:
    """Return rows without a slow error (m, 16).

    Args:
        ticks: the tick of each (m).
        gradients: g over the states (m, 12).
        variances: r (m).
    """
    rows = np.zeros((len(ticks), ROW_SIZE))
    rows[:, TICK], rows[:, GRADIENT], rows[:, VARIANCE], rows[:, SLOW] = ticks, gradients, variances, -1.0
    return rows


def by_tick(*parts: np.ndarray) -> np.ndarray:
    """Return all rows in one array, in the order of their ticks."""
    rows = np.concatenate([np.empty((0, ROW_SIZE)), *parts])
    return rows[np.argsort(rows[:, TICK], kind="stable")]


def information(rows: np.ndarray) -> np.ndarray:
    """Return J = sum g g^T / r (12 x 12) of rows without a slow error."""
    J = np.zeros((N_X, N_X))
    g = rows[:, GRADIENT]
    return J + g.T @ (g / rows[:, VARIANCE, np.newaxis])
