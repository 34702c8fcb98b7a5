"""The true velocities as a message, for the scenarios that lend them to the servo as the authors did."""

from typing import Any

import numpy as np

from ortilo_drake.loop.element import Box, Element, Number, Values
from ortilo_drake.model.placing import put
from ortilo_drake.model.signals import ARRIVED, N_X, PAYLOAD, STAMP, VELOCITY_SIZE


def velocity_out(n: Any, k: int, state: np.ndarray, out: np.ndarray) -> None:
    """Output [1, t_k, v_WB, Euler rates] (8), without noise or loss."""
    out[ARRIVED], out[STAMP] = 1.0, k * n.h
    put(state[6:N_X], out, PAYLOAD)


VELOCITY = Element("true_velocity", out=velocity_out, numbers=(Number("h"),))


def velocity_box(h: float) -> Box:
    """Return the box that sends the true velocities; it reads the true state (12)."""
    return Box("velocity", VELOCITY, VELOCITY_SIZE, Values({"h": h}))
