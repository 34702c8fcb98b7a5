"""Faults as compiled functions take them: settings as plain numbers, when they last, and people on their walks.

Moved or missing landmarks and people in the way change the scene of a projected camera, not its message, since a box
does not tell which landmark it shows. Each landmark has its own noise, so the boxes of the other landmarks do not
change.
"""

from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.model.room import Room
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario
from ortilo_drake.scenario.faults import AnyFault, LandmarkGone, LandmarkMoved, People, sensors_of
from ortilo_drake.world.noise import stream_id
from ortilo_drake.world.sensors.landmark_view import Surroundings

# By kind, the settings that a table has beside the times; vehicle_faults.py has those of a rotor.
SETTINGS: Final[dict[str, tuple[str, ...]]] = {
    "nlos_storm": ("share", "mean"),
    "outlier_bursts": ("every", "length", "sd"),
    "stuck": (),
    "anchor_moved": ("anchor", "by"),
    "anchors_dying": ("every", "anchors"),
    "clock_jump": ("by",),
    "yaw_jump": ("by",),
    "gyro_bias": ("by",),
    "camera_blinded": (),
    "landmark_moved": ("landmark", "by"),
    "landmark_gone": ("landmark",),
    "people": ("speed", "radius", "height", "excess", "walks"),
    "gust": ("force",),
    "load_dropped": ("mass_factor",),
    "rotor_weak": (),
}
KINDS: Final = tuple(SETTINGS)
# A fault's kind as a number, its index in KINDS.
NLOS_STORM, OUTLIER_BURSTS, STUCK, ANCHOR_MOVED, ANCHORS_DYING, CLOCK_JUMP, YAW_JUMP, GYRO_BIAS = range(8)
CAMERA_BLINDED, LANDMARK_MOVED, LANDMARK_GONE, PEOPLE, GUST, LOAD_DROPPED, ROTOR_WEAK = range(8, 15)
OWN: Final = -1


class FaultTable(NamedTuple):
    """Several faults as arrays."""

    kinds: np.ndarray
    """index of each fault's kind in KINDS, OWN for a registered fault (n)."""
    starts: np.ndarray
    """start of each fault [s] (n)."""
    ends: np.ndarray
    """end of each fault [s], inf if it does not end (n)."""
    streams: np.ndarray
    """number of each fault's noise stream (n)."""
    first: np.ndarray
    """index in `values` at which each fault's settings begin, and at which the last one's end (n + 1)."""
    values: np.ndarray
    """settings of all faults, one after the other, see values_of_fault."""


class Numbered(NamedTuple):
    """A fault among those of a scenario."""

    i: int
    """its index among all faults."""
    number: int
    """its index among the faults of its kind; its noise stream is 'fault/<kind>/<number>'."""
    fault: AnyFault
    """the fault."""


def numbered(faults: Sequence[AnyFault]) -> Iterator[Numbered]:
    """Yield the faults of a scenario, each with its numbers."""
    for i, fault in enumerate(faults):
        yield Numbered(i, sum(other.kind == fault.kind for other in faults[:i]), fault)


def values_of_fault(fault: AnyFault) -> list[float]:
    """Return the SETTINGS of a fault as numbers, one after the other, 0 for null; none of a registered fault."""
    values = [getattr(fault, name) for name in SETTINGS.get(fault.kind, ())]
    return [float(v or 0.0) for its in values for v in np.ravel(its)]


def table_of(faults: Sequence[Numbered], values: Sequence[Sequence[float]] | None = None) -> FaultTable:
    """Return some of a scenario's faults as a table; `values`, if given, replace the settings of values_of_fault."""
    settings = [values_of_fault(its.fault) for its in faults] if values is None else values
    ends = [getattr(its.fault, "end", None) for its in faults]
    return FaultTable(
        np.array([KINDS.index(kind) if (kind := its.fault.kind) in KINDS else OWN for its in faults], dtype=np.int64),
        np.array([its.fault.start for its in faults], dtype=float),
        np.array([np.inf if end is None else end for end in ends], dtype=float),
        np.array([stream_id(f"fault/{its.fault.kind}/{its.number}") for its in faults], dtype=np.uint64),
        np.cumsum([0, *map(len, settings)], dtype=np.int64),
        np.array([v for its in settings for v in its], dtype=float),
    )


@register_jitable
def settings_of(faults: FaultTable, i: int) -> np.ndarray:
    """Return the settings of fault i, see values_of_fault."""
    return faults.values[faults.first[i] : faults.first[i + 1]]


EARLY: Final = 1e-6  # tolerance of a tick's time, which is a sum of floats [s]


@register_jitable
def is_ahead(faults: FaultTable, i: int, t: float) -> bool:
    """Return whether fault i begins after t [s]."""
    return t < faults.starts[i] - EARLY


@register_jitable
def is_active(faults: FaultTable, i: int, t: float) -> bool:
    """Return whether fault i lasts at t [s]: from its start on, and before its end."""
    return not is_ahead(faults, i, t) and t < faults.ends[i] - EARLY


@register_jitable
def cylinders_at(values: np.ndarray, t: float) -> np.ndarray:
    """Return the cylinders of people t [s] after they came, rows (x, y, radius, height) (n, 4) [m].

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


class Scene(NamedTuple):
    """The scene in front of a camera."""

    room: Surroundings
    """landmarks that are there, and what may hide them."""
    there: np.ndarray
    """mask of the room's landmarks that are there (n)."""


def is_of_scene(fault: AnyFault) -> bool:
    """Return whether a fault changes the scene."""
    return isinstance(fault, LandmarkGone | LandmarkMoved | People)


def message_faults(faults: tuple[AnyFault, ...], sensor: str) -> list[Numbered]:
    """Return a scenario's faults that change a sensor's messages, in their order."""
    concern = [its for its in numbered(faults) if sensor in sensors_of(its.fault)]
    return [its for its in concern if not (sensor == "camera" and is_of_scene(its.fault))]


def scene_table(faults: tuple[AnyFault, ...]) -> FaultTable:
    """Return a scenario's faults that change the scene."""
    return table_of([its for its in numbered(faults) if is_of_scene(its.fault)])


@cached_njit
def scene_at(room: Surroundings, faults: FaultTable, t: float) -> Scene:
    """Return the scene at t [s], given the room without faults."""
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
