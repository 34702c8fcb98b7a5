"""The excess of a range over the distance at its message's stamp: its own earlier time, and the walls on its path.

In a round of ranging of length T, range i of 0 to n - 1 is taken s_i = T (1 - (i + 1) / n) before the stamp, at the
distance

    d_i = |p_WB - s_i v_WB - p_WA_i|.

A wall in the line of sight delays the signal and may leave only a reflection to be received: the range is longer, never
shorter. The excess of each wall is w_i = m (y_i^2 + z_i^2) / 2 with y_i, z_i standard normal, which is exponential of
mean m. y_i and z_i are first-order Gauss-Markov noise of correlation time t, so E[w_j w_k] - m^2 = m^2 exp(-2 |t_j -
t_k| / t): the excess lasts as long as the wall is in the way, and changes slowly. (I. Guvenc and C.-C. Chong, "A survey
on TOA based wireless localization and NLOS mitigation techniques", IEEE Communications Surveys and Tutorials 11(3),
2009: exponential excess.)
"""

from typing import Any

import numpy as np

from ortilo_drake.loop.element import Box, Element, Values
from ortilo_drake.model.geometry.line_of_sight import walls_crossed
from ortilo_drake.model.placing import put
from ortilo_drake.model.room import Room
from ortilo_drake.model.scalars import values_of
from ortilo_drake.model.signals import ARRIVED, PAYLOAD
from ortilo_drake.scenario import Uwb
from ortilo_drake.scenario.sensors import WallsExcess
from ortilo_drake.world.faults.fault_element import distance_to
from ortilo_drake.world.noise import gauss_markov, slow_step, stream_id

STREAM = "slow error/uwb_paths"


def paths_out(
    n: Any,
    message: np.ndarray,
    state: np.ndarray,
    anchors: np.ndarray,
    walls: np.ndarray,
    ages: np.ndarray,
    x: np.ndarray,
    out: np.ndarray,
) -> None:
    """Output a uwb message with ranges as long as their signals' paths; zeros for a missing range."""
    put(message, out)
    if message[ARRIVED] == 0.0:
        return
    count, p_WB = ages.size, state[:3]
    for i in range(count):
        if message[PAYLOAD + count + i] == 0.0:
            continue
        there = p_WB - ages[i] * state[6:9]
        longer = distance_to(there, anchors[i]) - distance_to(p_WB, anchors[i])
        crossed = walls_crossed(values_of(p_WB), values_of(anchors[i]), walls)
        longer += crossed * n.excess * (x[i] ** 2 + x[count + i] ** 2) / 2.0
        out[PAYLOAD + i] = max(message[PAYLOAD + i] + longer, 0.0)


PATHS = Element("range_paths", out=paths_out, step=slow_step, allocates=True)


def paths_box(settings: Uwb, room: Room, h: float) -> Box | None:
    """Return the box that lengthens a uwb message's ranges to their signals' paths; None if no range is lengthened.

    It reads `message` and the true state (12); its noise starts at 0 unless it is drawn.
    """
    walls, n = settings.walls, len(room.anchors)
    if settings.round == 0.0 and not isinstance(walls, WallsExcess):
        return None
    mean, time = (walls.mean, walls.time) if isinstance(walls, WallsExcess) else (0.0, 1.0)
    noise = gauss_markov(np.ones(2 * n), time, h)
    tables = {"anchors": room.anchor_positions, "ages": settings.ages(n), "a": noise.a, "q": noise.q}
    tables["walls"] = room.wall_boxes if mean > 0.0 else np.empty((0, 7))
    numbers = {"excess": mean, "stream": stream_id(STREAM), "h": h}
    return Box("uwb_paths", PATHS, PAYLOAD + 2 * n, Values(numbers, {"x": np.zeros(2 * n)}, tables))
