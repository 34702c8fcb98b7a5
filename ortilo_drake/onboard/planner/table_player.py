"""The reference as a row of a table at each tick."""

import numpy as np

from ortilo_drake.loop.element import Box, Element, Values
from ortilo_drake.model.placing import put
from ortilo_drake.model.signals import REFERENCE_SIZE


def reference_out(k: int, path: np.ndarray, out: np.ndarray) -> None:
    """Output r, r_dot and r_ddot of tick k (9); those of the last after it."""
    put(path[min(k, path.shape[0] - 1)], out)


REFERENCE = Element("reference", out=reference_out)


def reference_box(path: np.ndarray) -> Box:
    """Return the box that plays a path: r, r_dot and r_ddot at every tick (ticks, 9)."""
    return Box("reference", REFERENCE, REFERENCE_SIZE, Values(tables={"path": path}))
