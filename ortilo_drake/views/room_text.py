"""The plan of a room as text, for a terminal."""

import numpy as np
from pydrake.trajectories import Trajectory

from ortilo_drake.model.footprints import footprints
from ortilo_drake.model.room import Room

MOST = 110  # largest number of columns
LEGEND = "# wall  o obstacle  . path  S start  G goal  A anchor  L landmark"


def room_text(room: Room, path: Trajectory | None, width: int) -> str:
    """Return the plan of a room in at most `width` columns, north up, for characters twice as high as wide."""
    low, high = np.array(room.interior.min[:2]), np.array(room.interior.max[:2])
    columns = max(min(width, MOST) - 2, 10)
    step = (high[0] - low[0]) / columns
    rows = max(round((high[1] - low[1]) / (2.0 * step)), 1)
    x = low[0] + step * (np.arange(columns) + 0.5)
    y = low[1] + (high[1] - low[1]) / rows * (np.arange(rows) + 0.5)
    drawn = np.full((rows, columns), " ")
    for item in footprints(room):
        dx, dy = x - np.clip(x, item.low[0], item.high[0]), y - np.clip(y, item.low[1], item.high[1])
        drawn[np.hypot(dx[None, :], dy[:, None]) <= item.radius] = "#" if item.name == "wall" else "o"

    def put(points: np.ndarray, mark: str) -> None:
        for p in points:
            i, j = int((p[1] - low[1]) / (high[1] - low[1]) * rows), int((p[0] - low[0]) / step)
            if 0 <= i <= rows and 0 <= j <= columns:
                drawn[min(i, rows - 1), min(j, columns - 1)] = mark

    if path is not None:
        at = path.vector_values(np.linspace(0.0, path.end_time(), 4 * columns)).T
        put(at, ".")
        put(at[:1], "S")
        put(at[-1:], "G")
    put(room.landmark_positions, "L")
    put(room.anchor_positions, "A")
    edge = "+" + "-" * columns + "+"
    lines = ["|" + "".join(row) + "|" for row in drawn[::-1]]
    return "\n".join([edge, *lines, edge, f"{LEGEND}; a column is {step:.2g} m"])
