"""Faults of a projected camera's scene: landmarks moved or gone, and people in the way.

A box tells no landmark's identity, so these are not faults of the message but of the scene. Each landmark's noise is
its own, so what the others give stays as it was.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from ortilo_drake.model.room import Room
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario
from ortilo_drake.scenario.faults import AnyFault, LandmarkGone, LandmarkMoved, People, sensors_of
from ortilo_drake.world.faults.table import (
    LANDMARK_GONE,
    LANDMARK_MOVED,
    PEOPLE,
    FaultTable,
    Numbered,
    cylinders_at,
    is_active,
    numbered,
    settings_of,
    table_of,
)
from ortilo_drake.world.sensors.landmark_view import Surroundings


class Scene(NamedTuple):
    """The scene in front of a camera."""

    room: Surroundings
    """landmarks that are there, and what may hide them."""
    there: np.ndarray
    """which of the room's landmarks these are (n)."""


def is_of_scene(fault: AnyFault) -> bool:
    """Return whether a fault changes the scene."""
    return isinstance(fault, LandmarkGone | LandmarkMoved | People)


def message_faults(faults: tuple[AnyFault, ...], sensor: str) -> list[Numbered]:
    """Return those of a scenario's faults that change a sensor's messages, in their order."""
    concern = [its for its in numbered(faults) if sensor in sensors_of(its.fault)]
    return [its for its in concern if not (sensor == "camera" and is_of_scene(its.fault))]


def scene_table(faults: tuple[AnyFault, ...]) -> FaultTable:
    """Return those of a scenario's faults that change the scene."""
    return table_of([its for its in numbered(faults) if is_of_scene(its.fault)])


@njit(cache=True)
def scene_at(room: Surroundings, faults: FaultTable, t: float) -> Scene:
    """Return the scene at t [s] of a room without faults."""
    there = np.ones(room.positions.shape[0], dtype=np.bool_)
    if faults.kinds.size == 0:
        return Scene(room, there)
    positions, cylinders = room.positions.copy(), room.cylinders.copy()
    for i in range(faults.kinds.size):
        if not is_active(faults, i, t):
            continue
        kind, values = faults.kinds[i], settings_of(faults, i)
        if kind == LANDMARK_MOVED:
            positions[int(values[0])] += values[1:4]
        elif kind == LANDMARK_GONE:
            there[int(values[0])] = False
        elif kind == PEOPLE:
            cylinders = np.concatenate((cylinders, cylinders_at(values, t - faults.starts[i])))
    seen = Surroundings(positions[there], room.outlines[there], room.sizes[there], room.boxes, cylinders)
    return Scene(seen, there)


def check_room(scenario: Scenario, room: Room) -> None:
    """Raise InputError for faults of anchors, landmarks and rotors that are not there."""
    counts = {"anchor": len(room.anchors), "landmark": len(room.landmarks), "rotor": scenario.vehicle.rotor_count}
    for i, fault in enumerate(scenario.faults):
        for name, count in counts.items():
            for index in (*getattr(fault, f"{name}s", ()), getattr(fault, name, 0)):
                if index >= count:
                    raise InputError(f"faults.{i}: {fault.kind}: {name} {index}: must be below {count}, their number")
