"""Ranges prepared for the solver: moved to one instant, without those that a wall of the map blocks.

Range i of a round was measured s_i before its message's stamp (uwb.round). Since then the distance to the anchor has
changed along the unit vector u_i from the anchor, with the estimated velocity: r_i + s_i u_i . v_WB is the range at the
stamp. The remaining error is about s_i^2 times the acceleration plus s_i times the velocity's error. A range through a
wall of the map has an unknown extra length, so it is left out.
"""

import numpy as np

from ortilo_drake.loop.element import Box, Element, Values
from ortilo_drake.model.geometry.line_of_sight import walls_crossed
from ortilo_drake.model.placing import put
from ortilo_drake.model.room import Room
from ortilo_drake.model.scalars import values_of
from ortilo_drake.model.signals import ARRIVED, PAYLOAD
from ortilo_drake.scenario.sensors import UwbSetup


def sighted_out(
    message: np.ndarray, belief: np.ndarray, anchors: np.ndarray, walls: np.ndarray, ages: np.ndarray, out: np.ndarray
) -> None:
    """Output a uwb message with its ranges moved to the stamp and without those behind walls."""
    put(message, out)
    if message[ARRIVED] == 0.0:
        return
    n = ages.size
    for i in range(n):
        if message[PAYLOAD + n + i] == 0.0:
            continue
        if walls_crossed(values_of(belief[:3]), values_of(anchors[i]), walls) > 0:
            out[PAYLOAD + i] = out[PAYLOAD + n + i] = 0.0
            continue
        squared = along = 0.0
        for j in range(3):
            d = belief[j] - anchors[i, j]
            squared += d * d
            along += d * belief[6 + j]
        if squared > 0.0:
            out[PAYLOAD + i] += ages[i] * along / np.sqrt(squared)


def sighted_box(settings: UwbSetup, room: Room) -> Box | None:
    """Return the box that moves ranges to their stamp and leaves out those behind walls; None if neither is needed."""
    n = len(room.anchors)
    if settings.round == 0.0 and settings.behind_walls != "left_out":
        return None
    walls = room.wall_boxes if settings.behind_walls == "left_out" else np.empty((0, 7))
    tables = {"anchors": room.anchor_positions, "walls": walls, "ages": settings.ages(n)}
    return Box("uwb_sighted", Element("sighted", out=sighted_out), PAYLOAD + 2 * n, Values(tables=tables))
