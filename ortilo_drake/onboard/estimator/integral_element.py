"""The integral of the position error beside a belief of the vehicle's twelve states, as an element of the loop."""

import numpy as np

from ortilo_drake.loop.element import Array, Box, Element, Given
from ortilo_drake.model.placing import fill, put
from ortilo_drake.model.signals import N_I, N_X, N_XBAR


def integral_out(belief: np.ndarray, i: np.ndarray, out: np.ndarray) -> None:
    """Say the belief of [x; i] (240): i is known, its rows and columns of P are 0."""
    fill(out, 0.0)
    put(belief[:N_X], out)
    put(i, out, N_X)
    for row in range(N_X):
        put(belief[N_X * (row + 1) : N_X * (row + 2)], out, N_XBAR * (row + 1))


def integral_step(belief: np.ndarray, reference: np.ndarray, i: np.ndarray) -> None:
    """Go on to i_{k+1} = i_k + r_k - p_hat_k."""
    for axis in range(N_I):
        i[axis] += reference[axis] - belief[axis]


INTEGRAL = Element("integral", out=integral_out, step=integral_step, state=(Array("i"),))


def integral_box(name: str) -> Box:
    """Return what says the belief of [x; i] (240): it reads that of x (156) and the reference."""
    return Box(name, INTEGRAL, N_XBAR + N_XBAR * N_XBAR, Given(start={"i": np.zeros(N_I)}))
