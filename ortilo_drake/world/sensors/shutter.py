"""The message that goes with a picture."""

from typing import Any

import numpy as np

from ortilo_drake.loop.element import Box, Element, Number, Values
from ortilo_drake.model.placing import fill
from ortilo_drake.model.signals import ARRIVED, SHUTTER_SIZE, STAMP


def shutter_out(n: Any, k: int, sent: np.ndarray, out: np.ndarray) -> None:
    """Output [arrived, stamp] of a picture taken in this tick, zeros where none is sent."""
    fill(out, 0.0)
    if sent[0] >= 0.0:
        out[ARRIVED], out[STAMP] = 1.0, k * n.h


SHUTTER = Element("shutter", out=shutter_out, numbers=(Number("h"),))


def shutter_box(h: float) -> Box:
    """Return the shutter of a camera that renders: it reads `sent` (1), not negative where its message is sent."""
    return Box("camera", SHUTTER, SHUTTER_SIZE, Values({"h": h}))
