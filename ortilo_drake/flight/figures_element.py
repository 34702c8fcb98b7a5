"""The figures recorded in every tick of a flight, as an element of the loop."""

import numpy as np

from ortilo_drake.flight.figures import NEES, REFERENCE, TRACE_SIZE, position_nees
from ortilo_drake.flight.lost import Bounds, cause_of_loss
from ortilo_drake.loop.element import Box, Element
from ortilo_drake.model.signals import N_XBAR

_R = REFERENCE.start


def figures_out(
    state: np.ndarray,
    belief: np.ndarray,
    reference: np.ndarray,
    bounds: Bounds,
    out: np.ndarray,
) -> None:
    """Output a row of flight/figures.py, and the cause of the flight's loss, see lost.CAUSES (11)."""
    for i in range(3):
        out[i], out[3 + i], out[_R + i] = state[i], belief[i], reference[i]
    out[NEES] = position_nees(state, belief, belief[N_XBAR:])
    out[TRACE_SIZE] = cause_of_loss(state, bounds)


FIGURES = Element("figures", out=figures_out)


def figures_box(bounds: Bounds) -> Box:
    """Return the box of a flight's figures; it reads the true state (12), the belief (240) and the reference."""
    return Box("figures", FIGURES, TRACE_SIZE + 1).with_groups(bounds=bounds)
