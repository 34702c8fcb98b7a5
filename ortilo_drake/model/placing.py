"""Values put into an array one by one, for compiled functions: a slice assigned costs numba seconds of compilation."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numba.extending import overload, register_jitable


def place(i: int) -> int:
    """Return an index, which is not negative: compiled code then does not look whether it counts from the end."""
    return i


@overload(place, strict=False)
def _compiled_place(i: Any) -> Callable[[Any], Any]:
    return lambda i: np.uint64(i)


@register_jitable
def put(values: np.ndarray, into: np.ndarray, at: int = 0) -> None:
    """Write values (n) to an array, from an index on; of any scalar."""
    for i in range(len(values)):
        into[place(at + i)] = values[i]


@register_jitable
def fill(into: np.ndarray, value: float) -> None:
    """Write a value to all of an array (n)."""
    for i in range(len(into)):
        into[i] = value
