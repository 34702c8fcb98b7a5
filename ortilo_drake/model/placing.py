"""Functions that write to an array element by element: numba takes seconds to compile an assignment to a slice."""

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.model.signals import PAYLOAD


@register_jitable
def put(values: np.ndarray, into: np.ndarray, at: int = 0) -> None:
    """Write values (n) to the array `into`, from the index `at` on; for any scalar type."""
    for i in range(len(values)):
        into[at + i] = values[i]


@register_jitable
def fill(into: np.ndarray, value: float) -> None:
    """Write one value to all elements of an array (n)."""
    for i in range(len(into)):
        into[i] = value


@register_jitable
def sample_of(message: np.ndarray, i: int, n: int) -> np.ndarray:
    """Return sample i of the n in a message, [arrived, stamp, payload]; with one sample, the message itself."""
    if n == 1:
        return message
    size = (message.size - PAYLOAD) // n
    return message[PAYLOAD + i * size : PAYLOAD + (i + 1) * size]
