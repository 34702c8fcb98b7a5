"""The belief of [x; i] of an estimator that says its estimate and its covariance apart."""

import numpy as np

from ortilo_drake.loop.element import Box, Element, Values
from ortilo_drake.model.placing import fill, put
from ortilo_drake.model.signals import N_I, N_X, N_XBAR

SIZE = N_XBAR + N_XBAR * N_XBAR


def together_out(estimate: np.ndarray, covariance: np.ndarray, out: np.ndarray) -> None:
    """Output [xhat, P row by row] (240) of both (15, 225)."""
    put(estimate, out)
    put(covariance, out, N_XBAR)


def widened_out(estimate: np.ndarray, covariance: np.ndarray, i: np.ndarray, out: np.ndarray) -> None:
    """Output likewise of an estimate of x (12, 144); the integral is known: its rows and columns of P are 0."""
    fill(out, 0.0)
    put(estimate, out)
    put(i, out, N_X)
    for row in range(N_X):
        put(covariance[N_X * row : N_X * (row + 1)], out, N_XBAR * (row + 1))


def widened_step(estimate: np.ndarray, reference: np.ndarray, i: np.ndarray) -> None:
    """Go on to the next tick: i_{k+1} = i_k + r_k - p_hat_k, as in the authors' code."""
    for axis in range(N_I):
        i[axis] += reference[axis] - estimate[axis]


TOGETHER = Element("belief_together", out=together_out)
WIDENED = Element("belief_widened", out=widened_out, step=widened_step)


def together_box(name: str = "filter") -> Box:
    """Return the box of the belief of an estimator of [x; i]."""
    return Box(name, TOGETHER, SIZE)


def widened_box() -> Box:
    """Return the box of the belief of an estimator of x; it also reads the reference."""
    return Box("filter", WIDENED, SIZE, Values(start={"i": np.zeros(N_I)}))
