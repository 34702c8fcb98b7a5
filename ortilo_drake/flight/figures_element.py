"""What a flight leaves behind in every tick, as an element of the loop."""

import numpy as np

from ortilo_drake.flight.figures import NEES, TRACE_SIZE, position_nees
from ortilo_drake.flight.lost import Bounds, cause_of_loss
from ortilo_drake.loop.element import Array, Box, Element, Given
from ortilo_drake.model.signals import N_XBAR


def figures_out(
    state: np.ndarray,
    belief: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    walls: np.ndarray,
    out: np.ndarray,
) -> None:
    """Say a row of flight/figures.py, and the cause of the flight's loss, see lost.CAUSES (8)."""
    for i in range(3):
        out[i], out[3 + i] = state[i], belief[i]
    out[NEES] = position_nees(state, belief, belief[N_XBAR:])
    out[TRACE_SIZE] = cause_of_loss(state, Bounds(low, high, walls))


FIGURES = Element("figures", out=figures_out, tables=(Array("low"), Array("high"), Array("walls", 2)))


def figures_box(bounds: Bounds) -> Box:
    """Return what says how a flight goes: it reads the true state (12) and the belief (240)."""
    return Box("figures", FIGURES, TRACE_SIZE + 1, Given(tables=bounds._asdict()))
