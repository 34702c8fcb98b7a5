"""The Kalman filter of any linear model whose measurements arrive now and then, as an element.

    x_{k+1} = Phi x_k + Gamma u_k + w_k,   y_{j,k} = C_j x_k + v_j where sensor j arrived

with w_k of covariance W and v_j of covariance V_j, all independent. The element's state is [xhat_{k|k-1}, P_k row by
row]. A tick measures with each sensor that arrived, and then predicts, both by the kernel of kalman.py.
"""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from ortilo_drake.loop.element import Box, Element, Values
from ortilo_drake.onboard.estimator.kalman import Structure, measure, predict, propagate, structure_of


class LinearModel(NamedTuple):
    """A linear model with sensors, as compiled functions take it."""

    Gamma: np.ndarray
    """how the control enters (n, m)."""
    W: np.ndarray
    """process noise covariance (n, n)."""
    structure: Structure
    """where Phi is not 0."""
    states: np.ndarray
    """which states each row of y sees (p, w)."""
    weights: np.ndarray
    """with which coefficients (p, w)."""
    first: np.ndarray
    """first row of each sensor in y, and p (s + 1)."""
    V: np.ndarray
    """the sensors' covariances, each row by row (q)."""
    block: np.ndarray
    """where each sensor's covariance begins in V (s)."""


def linear_model(
    Phi: np.ndarray, Gamma: np.ndarray, W: np.ndarray, sensors: Iterable[tuple[np.ndarray, np.ndarray]]
) -> LinearModel:
    """Return the model of these matrices and of each sensor's C_j and V_j."""
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
    """Measure with what arrived in tick k, and predict tick k + 1; `messages` has [arrived, y_j] of each sensor."""
    Gamma, W, structure, states, weights, first, V, block = model
    N = Gamma.shape[0]
    P = belief[N:].reshape((N, N))
    for j in range(block.size):
        if messages[first[j] + j] != 0.0:
            y = messages[j + 1 :]  # so that row i of all sensors stands at i
            measure(belief, P, y, V[block[j] :], first[j + 1] - first[j], first[j], states, weights, S, rows)
    predict(belief, u, Gamma, structure, rows[0])
    for i in range(N):
        belief[i] = rows[0, i]
    propagate(P, W, structure, rows)


LINEAR_FILTER = Element("linear_filter", step=linear_filter_step, shows="belief")


def linear_filter_box(name: str, model: LinearModel, x_0: np.ndarray, P_0: np.ndarray) -> Box:
    """Return the filter; it reads `u` and `messages`, and says its `estimate` (n) and its `covariance` (n^2)."""
    n, p = len(model.W), len(model.states)
    given = Values(start={"belief": np.concatenate((x_0, P_0.ravel()))})
    parts = {"estimate": (0, n), "covariance": (n, n * n)}
    box = Box(name, LINEAR_FILTER, n + n * n, given, {"rows": (max(n, p), n + 1), "S": (p, p)}, parts=parts)
    return box.with_groups(model=model)
