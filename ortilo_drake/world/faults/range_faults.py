"""Faults of ranges, each a function from a uwb message to the faulty one."""

from typing import NamedTuple

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.model.clock import tick_of
from ortilo_drake.model.geometry.line_of_sight import crosses_cylinder
from ortilo_drake.model.signals import PAYLOAD
from ortilo_drake.world.faults.table import (
    ANCHOR_MOVED,
    ANCHORS_DYING,
    CLOCK_JUMP,
    EARLY,
    NLOS_STORM,
    OUTLIER_BURSTS,
    PEOPLE,
    FaultTable,
    cylinders_at,
    settings_of,
)
from ortilo_drake.world.noise import normals, uniforms


class Moment(NamedTuple):
    """The data that a fault may use beside the message."""

    x: np.ndarray
    """state as the sensor sees it (12)."""
    t: float
    """time [s]."""
    anchors: np.ndarray
    """p_WA, where the anchors truly stand (n, 3)."""
    seed: int
    """seed of all noise."""
    h: float
    """time from one message to the next [s]."""


@register_jitable
def distance_to(p: np.ndarray, q: np.ndarray) -> float:
    """Return the distance of two points (3) [m]."""
    return np.sqrt((p[0] - q[0]) ** 2 + (p[1] - q[1]) ** 2 + (p[2] - q[2]) ** 2)


@register_jitable
def behind_people(faults: FaultTable, i: int, moment: Moment) -> np.ndarray:
    """Return a mask (n) of the anchors that are behind the people of fault i."""
    people = cylinders_at(settings_of(faults, i), moment.t - faults.starts[i])
    hidden = np.zeros(moment.anchors.shape[0], dtype=np.bool_)
    for j in range(hidden.size):
        for person in people:
            if crosses_cylinder(moment.x[:3], moment.anchors[j], person):
                hidden[j] = True
    return hidden


@register_jitable
def longer(faults: FaultTable, i: int, moment: Moment) -> np.ndarray:
    """Return the excess that fault i adds to each range (n) [m]."""
    kind, values, stream = faults.kinds[i], settings_of(faults, i), faults.streams[i]
    n, tick = moment.anchors.shape[0], tick_of(moment.t, moment.h)
    added = np.zeros(n)
    if kind == CLOCK_JUMP:
        added[:] = values[0]
    elif kind == ANCHOR_MOVED:
        j, p_WB = int(values[0]), moment.x[:3]
        there = moment.anchors[j]
        added[j] = distance_to(p_WB, there + values[1:4]) - distance_to(p_WB, there)
    elif kind == NLOS_STORM:
        u = uniforms(moment.seed, stream, tick, 2 * n)
        for j in range(n):
            if u[j] < values[0]:
                added[j] = -values[1] * np.log1p(-u[n + j])
    elif kind == PEOPLE and values[3] > 0.0:
        hidden, u = behind_people(faults, i, moment), uniforms(moment.seed, stream, tick, n)
        for j in range(n):
            if hidden[j]:
                added[j] = -values[3] * np.log1p(-u[j])
    elif kind == OUTLIER_BURSTS and (moment.t - faults.starts[i] + EARLY) % values[0] < values[1]:
        added[:] = values[2] * normals(moment.seed, stream, tick, n)
    return added


@register_jitable
def silent(faults: FaultTable, i: int, moment: Moment) -> np.ndarray:
    """Return a mask (n) of the anchors that fault i takes away."""
    kind, values = faults.kinds[i], settings_of(faults, i)
    gone = np.zeros(moment.anchors.shape[0], dtype=np.bool_)
    if kind == ANCHORS_DYING:
        dead = int((moment.t - faults.starts[i] + EARLY) // values[0]) + 1
        for anchor in values[1 : 1 + dead]:
            gone[int(anchor)] = True
    elif kind == PEOPLE and values[3] == 0.0:
        return behind_people(faults, i, moment)
    return gone


@register_jitable
def with_range_fault(message: np.ndarray, faults: FaultTable, i: int, moment: Moment) -> np.ndarray:
    """Return a uwb message as it is under fault i; a range that is not there stays away, none is below 0."""
    said, n = message.copy(), moment.anchors.shape[0]
    gone, added = silent(faults, i, moment), longer(faults, i, moment)
    for j in range(n):
        there = said[PAYLOAD + n + j] > 0.0 and not gone[j]
        said[PAYLOAD + j] = max(said[PAYLOAD + j] + added[j], 0.0) if there else 0.0
        if gone[j]:
            said[PAYLOAD + n + j] = 0.0
    return said
