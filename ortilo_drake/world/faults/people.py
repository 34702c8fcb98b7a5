"""People who walk through the room, as cylinders that stand on the floor."""

import numpy as np
from numba.extending import register_jitable


@register_jitable
def cylinders_at(values: np.ndarray, t: float) -> np.ndarray:
    """Return the cylinders of people t [s] after they came, rows (x, y, radius, height) (n, 4) [m]; values of table.py.

    Each walks from one end of its walk to the other and back at a steady speed, and is at the first end at the start.
    """
    speed, radius, height = values[0], values[1], values[2]
    walks = values[4:].reshape((-1, 4))
    rows = np.empty((walks.shape[0], 4))
    for j in range(walks.shape[0]):
        x_0, y_0, x_1, y_1 = walks[j, 0], walks[j, 1], walks[j, 2], walks[j, 3]
        length, share = np.hypot(x_1 - x_0, y_1 - y_0), 0.0
        if length > 0.0:
            way = (speed * t) % (2.0 * length)
            share = min(way, 2.0 * length - way) / length
        rows[j, 0], rows[j, 1] = x_0 + share * (x_1 - x_0), y_0 + share * (y_1 - y_0)
        rows[j, 2], rows[j, 3] = radius, height
    return rows
