"""Messages without a measurement: true velocities, as the authors gave them to the servo, and a picture's shutter."""

from typing import Any

import numpy as np

from ortilo_drake.loop.element import Box, Element, Values
from ortilo_drake.model.placing import fill, put
from ortilo_drake.model.signals import ARRIVED, N_X, PAYLOAD, SHUTTER_SIZE, STAMP, VELOCITY_SIZE


def velocity_out(n: Any, k: int, state: np.ndarray, out: np.ndarray) -> None:
    """Output [1, t_k, v_WB, Euler rates] (8), without noise or loss."""
    out[ARRIVED], out[STAMP] = 1.0, k * n.h
    put(state[6:N_X], out, PAYLOAD)


def velocity_box(h: float) -> Box:
    """Return the box that sends the true velocities; it reads the true state (12)."""
    return Box("velocity", Element("true_velocity", out=velocity_out), VELOCITY_SIZE, Values({"h": h}))


def shutter_out(n: Any, k: int, sent: np.ndarray, out: np.ndarray) -> None:
    """Output [arrived, stamp] of a picture taken in this tick, zeros where none is sent."""
    fill(out, 0.0)
    if sent[0] >= 0.0:
        out[ARRIVED], out[STAMP] = 1.0, k * n.h


def shutter_box(h: float) -> Box:
    """Return the shutter of a camera that renders: it reads `sent` (1), not negative where its message is sent."""
    return Box("camera", Element("shutter", out=shutter_out), SHUTTER_SIZE, Values({"h": h}))
