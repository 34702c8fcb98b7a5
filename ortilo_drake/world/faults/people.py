"""People who walk through the room, as cylinders that stand on the floor."""

import numpy as np

from ortilo_drake.scenario.faults import People


def cylinders_at(people: People, t: float) -> np.ndarray:
    """Return where people are at t [s], rows (x, y, radius, height) (n, 4) [m].

    Each walks from one end of its walk to the other and back at a steady speed, and is at the first end at the start.
    """
    rows = []
    for x_0, y_0, x_1, y_1 in people.walks:
        length = float(np.hypot(x_1 - x_0, y_1 - y_0))
        way = (people.speed * (t - people.start)) % (2.0 * length) if length else 0.0
        share = min(way, 2.0 * length - way) / length if length else 0.0
        rows.append([x_0 + share * (x_1 - x_0), y_0 + share * (y_1 - y_0), people.radius, people.height])
    return np.array(rows)
