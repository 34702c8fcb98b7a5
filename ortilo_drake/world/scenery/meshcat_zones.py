"""Zones on the floor in Meshcat, such as those where a sensor is blacked out."""

from typing import NamedTuple

import numpy as np
from pydrake.geometry import Box, Meshcat, Rgba
from pydrake.math import RigidTransform

from ortilo_drake.model.room import Room

ABOVE_FLOOR = 0.012  # [m]; above the grid of the floor
OPACITY = 0.22


class Zone(NamedTuple):
    """A strip of the floor."""

    low: tuple[float, float]
    """its south-western corner (x, y) [m]."""
    high: tuple[float, float]
    """its north-eastern corner (x, y) [m]."""
    color: tuple[float, float, float]
    """red, green and blue, each 0 to 1."""


def draw_zones(meshcat: Meshcat, room: Room, zones: list[Zone]) -> None:
    """Draw zones on a room's floor as /room/zones/NN, each a little above the one before."""
    for i, zone in enumerate(zones):
        low, high = np.array(zone.low), np.array(zone.high)
        path = f"/room/zones/{i:02d}"
        meshcat.SetObject(path, Box(*(high - low), 0.004), Rgba(*zone.color, OPACITY))
        middle = (low + high) / 2
        height = room.interior.min[2] + ABOVE_FLOOR + 0.006 * i
        meshcat.SetTransform(path, RigidTransform([*middle, height]))
