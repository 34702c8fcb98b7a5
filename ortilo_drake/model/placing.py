"""Values put into an array one by one, for compiled functions: a slice assigned costs numba seconds of compilation."""

import numpy as np
from numba.extending import register_jitable


@register_jitable
def put(values: np.ndarray, into: np.ndarray, at: int = 0) -> None:
    """Write values (n) to an array, from an index on; of any scalar."""
    for i in range(len(values)):
        into[at + i] = values[i]


@register_jitable
def fill(into: np.ndarray, value: float) -> None:
    """Write a value to all of an array (n)."""
    for i in range(len(into)):
        into[i] = value
