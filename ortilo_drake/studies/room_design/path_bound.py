"""The Cramer-Rao bound along a path in long steps: fast enough to try thousands of rooms.

It is the recursion of floor/cramer_rao.py,

    P_{j+1} = Phi^m (P_j^-1 + J_j)^-1 Phi^mT + W_m,   W_m = sum_{i<m} Phi^i W Phi^iT,   P_0 = 0,

over steps of m ticks, with all information of a step's ticks at its start. It serves to compare rooms: the reported
bound of a room is that of every tick.
"""

from typing import NamedTuple

import numpy as np

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.onboard.estimator.kalman import measure, propagate, structure_of
from ortilo_drake.sensors.information_rows import AMPLITUDE, GRADIENT, SLOW, TICK, VARIANCE

STEPS = 200  # approximate number of steps in a path


class PathModel(NamedTuple):
    """The part of the bound that all rooms with the same path share: dynamics and noise of a step (12, 12 each).

    rows (l, 12) are the information that does not come from ranges, g / sqrt(r), ordered by steps; first (steps + 1)
    holds the index of each step's first row, then the number of rows.
    """

    Phi: np.ndarray
    W: np.ndarray
    rows: np.ndarray
    first: np.ndarray


def path_model(Phi: np.ndarray, W: np.ndarray, rows: np.ndarray, ticks: int, m: int) -> PathModel:
    """Return the model of a path of `ticks` ticks in steps of m; Phi and W (12, 12 each) are those of a tick.

    The rows (l, 17) are the information beside the ranges (sensors/information_rows.py).
    """
    steps, W_m = -(-ticks // m), np.zeros_like(W)
    for _ in range(m):
        W_m = Phi @ W_m @ Phi.T + W
    parts = []
    for J in step_information(rows, steps, m):
        values, vectors = np.linalg.eigh(J)
        keep = values > 1e-12 * max(values[-1], 1e-300)
        parts.append((vectors[:, keep] * np.sqrt(values[keep])).T)
    first = np.concatenate([[0], np.cumsum([len(part) for part in parts])])
    return PathModel(np.linalg.matrix_power(Phi, m), W_m, np.concatenate(parts), first)


def step_information(rows: np.ndarray, steps: int, m: int) -> np.ndarray:
    """Return J of every step (steps, 12, 12) from rows of information (l, 17).

    A slowly changing error of standard deviation a in n rows of a step does not average out: each row counts with the
    variance r + n a^2.
    """
    J = np.zeros((steps, 12, 12))
    step = rows[:, TICK].astype(int) // m
    _, which, counts = np.unique(
        np.column_stack([step, rows[:, SLOW]]), axis=0, return_inverse=True, return_counts=True
    )
    slow = np.where(rows[:, SLOW] >= 0.0, counts[which.ravel()] * rows[:, AMPLITUDE] ** 2, 0.0)
    g = rows[:, GRADIENT] / np.sqrt(np.maximum(rows[:, VARIANCE] + slow, 1e-24))[:, None]
    np.add.at(J, step, g[:, :, None] * g[:, None, :])
    return J


@cached_njit
def position_variance(model: PathModel, J: np.ndarray, there: np.ndarray, least: int) -> np.ndarray:
    """Return the trace of the position's bound at the start of every step [m^2] (steps).

    J (steps, 3, 3) is the ranges' information on p_WB, which may be singular. It counts in steps with at least `least`
    anchors heard; there (steps) is the number heard.
    """
    P, g, out = np.zeros((12, 12)), np.zeros((1, 12)), np.empty(J.shape[0])
    x, y, V, states = np.zeros(12), np.zeros(1), np.ones(1), np.arange(12).reshape((1, 12))  # x does not enter P
    S, GT, structure = np.empty((1, 1)), np.empty((12, 13)), structure_of(model.Phi)
    for step in range(J.shape[0]):
        out[step] = P[0, 0] + P[1, 1] + P[2, 2]
        for row in range(model.first[step], model.first[step + 1]):
            measure(x, P, y, V, 1, 0, states, model.rows[row : row + 1], S, GT)
        if there[step] >= least:
            values, vectors = np.linalg.eigh(J[step])
            for i in range(3):
                g[0, :3] = vectors[:, i] * np.sqrt(max(values[i], 0.0))
                measure(x, P, y, V, 1, 0, states, g, S, GT)
        propagate(P, model.W, structure, GT)
    return out
