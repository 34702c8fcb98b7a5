"""Plain numbers of what may be Drake's AutoDiffXd: for what has no derivative, such as a tick or the walls between."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numba.extending import overload


def values_of(v: np.ndarray) -> np.ndarray:
    """Return an array without its derivatives, floats as they are; also inside compiled functions."""
    if v.dtype != object:
        return v
    return np.array([float(z.value()) if hasattr(z, "value") else float(z) for z in v.flat]).reshape(v.shape)


@overload(values_of, strict=False)  # strict compares annotations, which a lambda has not
def _compiled_values_of(v: Any) -> Callable[[Any], Any]:
    return lambda v: v


def time_in(context: Any) -> float:
    """Return the time [s] in a Context of any scalar; derivatives by time are not taken."""
    time = context.get_time()
    return time if isinstance(time, float) else float(time.value())
