"""Faults of ranges, each a function from a uwb message to the one that is said."""

from typing import NamedTuple

import numpy as np

from ortilo_drake.model.clock import tick_of
from ortilo_drake.model.geometry.line_of_sight import crosses_cylinder
from ortilo_drake.model.signals import PAYLOAD
from ortilo_drake.scenario.faults import (
    AnchorMoved,
    AnchorsDying,
    AnyFault,
    ClockJump,
    NlosStorm,
    OutlierBursts,
    People,
)
from ortilo_drake.world.faults.people import cylinders_at
from ortilo_drake.world.faults.timing import EARLY
from ortilo_drake.world.noise import normals, uniforms


class Moment(NamedTuple):
    """What a fault may know beside the message.

    Attributes:
        x: state as the sensor sees it (12).
        t: time [s].
        anchors: p_WA, where the anchors truly stand (n, 3).
        seed: seed of all noise.
        stream: number of the fault's noise stream.
        h: time from one message to the next [s].
    """

    x: np.ndarray
    t: float
    anchors: np.ndarray
    seed: int
    stream: np.uint64
    h: float


def longer(fault: AnyFault, moment: Moment) -> np.ndarray:
    """Return what a fault adds to each range (n) [m]."""
    n, tick = len(moment.anchors), tick_of(moment.t, moment.h)
    added = np.zeros(n)
    if isinstance(fault, ClockJump):
        added[:] = fault.by
    elif isinstance(fault, AnchorMoved):
        i, p_WB = fault.anchor, moment.x[:3]
        there = moment.anchors[i]
        added[i] = np.linalg.norm(p_WB - (there + np.array(fault.by))) - np.linalg.norm(p_WB - there)
    elif isinstance(fault, NlosStorm):
        u = uniforms(moment.seed, moment.stream, tick, 2 * n)
        added = np.where(u[:n] < fault.share, -fault.mean * np.log1p(-u[n:]), 0.0)
    elif isinstance(fault, OutlierBursts) and (moment.t - fault.start + EARLY) % fault.every < fault.length:
        added = fault.sd * normals(moment.seed, moment.stream, tick, n)
    return added


def silent(fault: AnyFault, moment: Moment) -> np.ndarray:
    """Return which anchors a fault takes away (n)."""
    gone = np.zeros(len(moment.anchors), dtype=bool)
    if isinstance(fault, AnchorsDying):
        dead = int((moment.t - fault.start + EARLY) // fault.every) + 1
        gone[list(fault.anchors[:dead])] = True
    elif isinstance(fault, People):
        p_WB, people = np.ascontiguousarray(moment.x[:3]), cylinders_at(fault, moment.t)
        for i, p_WA in enumerate(moment.anchors):
            gone[i] = any(crosses_cylinder(p_WB, np.ascontiguousarray(p_WA), person) for person in people)
    return gone


def with_range_fault(message: np.ndarray, fault: AnyFault, moment: Moment) -> np.ndarray:
    """Return a uwb message as it is under a fault; a range that is not there stays away, none is below 0."""
    said, n = message.copy(), len(moment.anchors)
    ranges, flags = said[PAYLOAD : PAYLOAD + n], said[PAYLOAD + n :]
    flags[silent(fault, moment)] = 0.0
    ranges[:] = np.where(flags > 0.0, np.maximum(ranges + longer(fault, moment), 0.0), 0.0)
    return said
