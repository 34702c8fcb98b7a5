"""The belief about which a message is solved in a compiled flight."""

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.onboard.estimator.late_measurements import Slot, past_belief


@register_jitable
def belief_about(
    slot: Slot | None, history: np.ndarray, n: int, message: np.ndarray, known: np.ndarray, h: float
) -> np.ndarray:
    """Return the belief of [x; i] about which a message is solved: the present one where no history is kept."""
    if slot is None:
        return known
    return past_belief(history, slot, n, message, known, h)
