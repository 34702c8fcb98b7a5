"""Faults of what a projected camera looks at: landmarks moved or gone, and people in the way.

A box tells no landmark's identity, so these are not faults of the message but of the scene. Each landmark's noise is
its own, so what the others give stays as it was.
"""

from typing import NamedTuple

import numpy as np

from ortilo_drake.scenario.faults import AnyFault, LandmarkGone, LandmarkMoved, People
from ortilo_drake.world.faults.people import cylinders_at
from ortilo_drake.world.faults.timing import is_active
from ortilo_drake.world.sensors.landmark_view import Surroundings


class Scene(NamedTuple):
    """What a camera looks at.

    Attributes:
        room: landmarks that are there, and what may hide them.
        there: which of the room's landmarks these are (n).
    """

    room: Surroundings
    there: np.ndarray


def scene_faults(faults: tuple[AnyFault, ...]) -> tuple[AnyFault, ...]:
    """Return the faults that change the scene."""
    return tuple(fault for fault in faults if isinstance(fault, LandmarkGone | LandmarkMoved | People))


def scene_at(room: Surroundings, faults: tuple[AnyFault, ...], t: float) -> Scene:
    """Return the scene at t [s] of a room without faults."""
    positions, cylinders = room.positions.copy(), [room.cylinders]
    there = np.ones(len(positions), dtype=bool)
    for fault in faults:
        if not is_active(fault, t):
            continue
        if isinstance(fault, LandmarkMoved):
            positions[fault.landmark] += fault.by
        elif isinstance(fault, LandmarkGone):
            there[fault.landmark] = False
        elif isinstance(fault, People):
            cylinders.append(cylinders_at(fault, t))
    changed = Surroundings(
        positions[there], room.outlines[there], room.sizes[there], room.boxes, np.concatenate(cylinders)
    )
    return Scene(changed, there)
