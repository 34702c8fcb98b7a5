"""Faults as compiled functions take them: their settings as plain numbers."""

from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.scenario.faults import (
    AnchorMoved,
    AnchorsDying,
    AnyFault,
    ClockJump,
    Gust,
    GyroBias,
    LandmarkGone,
    LandmarkMoved,
    LoadDropped,
    NlosStorm,
    OutlierBursts,
    People,
    YawJump,
)
from ortilo_drake.world.noise import stream_id

# A fault's kind as a number.
NLOS_STORM, OUTLIER_BURSTS, STUCK, ANCHOR_MOVED, ANCHORS_DYING, CLOCK_JUMP, YAW_JUMP, GYRO_BIAS = range(8)
CAMERA_BLINDED, LANDMARK_MOVED, LANDMARK_GONE, PEOPLE, GUST, LOAD_DROPPED, ROTOR_WEAK = range(8, 15)
KINDS: Final = (
    *("nlos_storm", "outlier_bursts", "stuck", "anchor_moved", "anchors_dying", "clock_jump", "yaw_jump", "gyro_bias"),
    *("camera_blinded", "landmark_moved", "landmark_gone", "people", "gust", "load_dropped", "rotor_weak"),
)
OWN: Final = -1


class FaultTable(NamedTuple):
    """Some faults, one after the other.

    Attributes:
        kinds: of each, an index in KINDS, OWN of one's own (n).
        starts: when each begins [s] (n).
        ends: when each ends [s], inf if it does not (n).
        streams: number of each one's noise stream (n).
        first: where each one's settings begin in values, and where the last one's end (n + 1).
        values: the settings of all, see values_of_fault.
    """

    kinds: np.ndarray
    starts: np.ndarray
    ends: np.ndarray
    streams: np.ndarray
    first: np.ndarray
    values: np.ndarray


class Numbered(NamedTuple):
    """A fault among those of a scenario.

    Attributes:
        i: which of all it is.
        number: which of its kind; its noise stream is 'fault/<kind>/<number>'.
        fault: the fault.
    """

    i: int
    number: int
    fault: AnyFault


def numbered(faults: Sequence[AnyFault]) -> Iterator[Numbered]:
    """Yield the faults of a scenario, each with its numbers."""
    for i, fault in enumerate(faults):
        yield Numbered(i, sum(other.kind == fault.kind for other in faults[:i]), fault)


def values_of_fault(fault: AnyFault) -> list[float]:
    """Return a fault's settings beside its times as numbers; a rotor's are the wrench's, see vehicle_faults.py."""
    match fault:
        case NlosStorm():
            return [fault.share, fault.mean]
        case OutlierBursts():
            return [fault.every, fault.length, fault.sd]
        case AnchorMoved():
            return [float(fault.anchor), *fault.by]
        case AnchorsDying():
            return [fault.every, *map(float, fault.anchors)]
        case ClockJump() | YawJump():
            return [fault.by]
        case GyroBias():
            return [*fault.by]
        case LandmarkMoved():
            return [float(fault.landmark), *fault.by]
        case LandmarkGone():
            return [float(fault.landmark)]
        case People():
            said = [fault.speed, fault.radius, fault.height, fault.excess or 0.0]
            return [*said, *(v for walk in fault.walks for v in walk)]
        case Gust():
            return [*fault.force]
        case LoadDropped():
            return [fault.mass_factor]
    return []


def table_of(faults: Sequence[Numbered], values: Sequence[Sequence[float]] | None = None) -> FaultTable:
    """Return some of a scenario's faults as a table, with values in place of those of values_of_fault, if given."""
    settings = [values_of_fault(its.fault) for its in faults] if values is None else values
    ends = [getattr(its.fault, "end", None) for its in faults]
    return FaultTable(
        np.array([_number_of(its.fault.kind) for its in faults], dtype=np.int64),
        np.array([its.fault.start for its in faults], dtype=float),
        np.array([np.inf if end is None else end for end in ends], dtype=float),
        np.array([stream_id(f"fault/{its.fault.kind}/{its.number}") for its in faults], dtype=np.uint64),
        np.cumsum([0, *map(len, settings)], dtype=np.int64),
        np.array([v for its in settings for v in its], dtype=float),
    )


def _number_of(kind: str) -> int:
    return KINDS.index(kind) if kind in KINDS else OWN


@register_jitable
def settings_of(faults: FaultTable, i: int) -> np.ndarray:
    """Return the settings of fault i, see values_of_fault."""
    return faults.values[faults.first[i] : faults.first[i + 1]]
