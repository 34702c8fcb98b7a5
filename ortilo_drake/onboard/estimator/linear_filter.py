"""The Kalman filter of any linear model with intermittent measurements, as an element.

    x_{k+1} = Phi x_k + Gamma u_k + w_k,   y_{j,k} = C_j x_k + v_j where sensor j arrived

with w_k of covariance W and v_j of covariance V_j, all independent. The element's state is [xhat_{k|k-1}, P_k row by
row]. In a tick the filter measures with each sensor that arrived, then predicts, both with the kernel of kalman.py.
"""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from ortilo_drake.loop.element import Box, Element, Values
from ortilo_drake.onboard.estimator.kalman import Structure, measure, predict, propagate, structure_of


class LinearModel(NamedTuple):
    """A linear model with sensors, in arrays for compiled functions."""

    Gamma: np.ndarray
    """input matrix of the control (n, m)."""
    W: np.ndarray
    """process noise covariance (n, n)."""
    structure: Structure
    """nonzero entries of Phi."""
    states: np.ndarray
    """indices of the states in each row of y (p, w)."""
    weights: np.ndarray
    """coefficients of these states (p, w)."""
    first: np.ndarray
    """first row of each sensor in y, and p at the end (s + 1)."""
    V: np.ndarray
    """covariances of the sensors, each row by row (q)."""
    block: np.ndarray
    """index in V at which each sensor's covariance begins (s)."""


def linear_model(
    Phi: np.ndarray, Gamma: np.ndarray, W: np.ndarray, sensors: Iterable[tuple[np.ndarray, np.ndarray]]
) -> LinearModel:
    """Return the model with Phi (n, n), Gamma (n, m), W (n, n) and the pair C_j, V_j of each sensor."""
    Cs, Vs = zip(*sensors, strict=True)
    C, sizes = np.vstack(Cs), np.array([len(own) for own in Cs], dtype=np.int64)
    widest = max(1, int(np.count_nonzero(C, axis=1).max()))
    states, weights = np.zeros((len(C), widest), dtype=np.int64), np.zeros((len(C), widest))
    for i, row in enumerate(C):
        seen = np.flatnonzero(row)
        states[i, : seen.size], weights[i, : seen.size] = seen, row[seen]
    first = np.concatenate(([0], np.cumsum(sizes)))
    block = np.concatenate(([0], np.cumsum(sizes**2)))[:-1]
    return LinearModel(Gamma, W, structure_of(Phi), states, weights, first, np.hstack([V.ravel() for V in Vs]), block)


def linear_filter_step(
    u: np.ndarray, messages: np.ndarray, belief: np.ndarray, rows: np.ndarray, S: np.ndarray, model: LinearModel
) -> None:
    """Measure with the sensors that arrived in tick k, then predict; `messages` holds [arrived, y_j] of each sensor."""
    Gamma, W, structure, states, weights, first, V, block = model
    N = Gamma.shape[0]
    P = belief[N:].reshape((N, N))
    for j in range(block.size):
        if messages[first[j] + j] != 0.0:
            y = messages[j + 1 :]  # shifted so that y[i] is row i of all sensors
            measure(belief, P, y, V[block[j] :], first[j + 1] - first[j], first[j], states, weights, S, rows)
    predict(belief, u, Gamma, structure, rows[0])
    for i in range(N):
        belief[i] = rows[0, i]
    propagate(P, W, structure, rows)


LINEAR_FILTER = Element("linear_filter", step=linear_filter_step, shows="belief")


def linear_filter_box(name: str, model: LinearModel, x_0: np.ndarray, P_0: np.ndarray) -> Box:
    """Return the filter's box; it reads `u` and `messages` and outputs `estimate` (n) and `covariance` (n^2)."""
    n, p = len(model.W), len(model.states)
    given = Values(start={"belief": np.concatenate((x_0, P_0.ravel()))})
    parts = {"estimate": (0, n), "covariance": (n, n * n)}
    box = Box(name, LINEAR_FILTER, n + n * n, given, {"rows": (max(n, p), n + 1), "S": (p, p)}, parts=parts)
    return box.with_groups(model=model)
