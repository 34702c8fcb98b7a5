"""Information on the position in UWB ranges.

A range r = d + s(d) v, v standard normal, has the log-likelihood -ln s - (r - d)^2 / (2 s^2), and its Fisher
information about d is 1 / s^2 + 2 (s' / s)^2 (Kay, "Fundamentals of Statistical Signal Processing: Estimation Theory",
1993, eq. 3.31): noise that grows with the distance holds information about it. With s = s_0 + s_1 d it is
(1 + 2 s_1^2) / s^2.

In a round of ranging range i is taken s_i before its message's stamp, where d = |p - s_i v - a_i|.
"""

import numpy as np

from ortilo_drake.model.geometry.line_of_sight import walls_crossed
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import N_X
from ortilo_drake.scenario import Uwb
from ortilo_drake.sensors.information_rows import rows_of
from ortilo_drake.world.sensors.uwb import ranging_settings


def range_rows(settings: Uwb, room: Room, truth: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Return the rows of the ranges that there are, to every anchor, in the ticks in which uwb is seen (n).

    True states are (n, 12). The excess of a range behind a wall is taken as known.
    """
    s_0, s_1, _, most_walls, max_distance = ranging_settings(settings)
    ticks = np.flatnonzero(seen)
    p_AB = truth[ticks, np.newaxis, :3] - room.anchor_positions  # (ticks, anchors, 3)
    d = np.linalg.norm(p_AB, axis=2)
    there = (d <= max_distance) & (d > 0.0)
    if np.isfinite(most_walls):
        for k, i in np.argwhere(there):
            p_WB = np.ascontiguousarray(truth[ticks[k], :3])
            there[k, i] = walls_crossed(p_WB, room.anchor_positions[i], room.wall_boxes) <= most_walls
    k, i = np.nonzero(there)
    gradients = np.zeros((len(k), N_X))
    gradients[:, :3] = p_AB[k, i] / d[k, i, np.newaxis]
    gradients[:, 6:9] = -settings.ages(len(room.anchors))[i, np.newaxis] * gradients[:, :3]
    return rows_of(ticks[k], gradients, (s_0 + s_1 * d[k, i]) ** 2 / (1.0 + 2.0 * s_1**2), i)
