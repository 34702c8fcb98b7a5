"""Faults in a compiled flight: see world/faults. Without any all tables are None, and numba leaves this out."""

from typing import NamedTuple

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.model.placing import put
from ortilo_drake.world.faults.message_fault import held_after, stuck_says, with_fault
from ortilo_drake.world.faults.range_faults import Moment
from ortilo_drake.world.faults.scene_faults import Scene, scene_at
from ortilo_drake.world.faults.table import STUCK, FaultTable
from ortilo_drake.world.faults.timing import is_active, is_ahead
from ortilo_drake.world.faults.vehicle_faults import force_at, wrench_at
from ortilo_drake.world.sensors.landmark_view import Surroundings


class VehicleFaults(NamedTuple):
    """Faults of the vehicle, see world/faults/vehicle_faults.py.

    Attributes:
        wrench: those that change what the rotors do.
        force: those that change what the disturbance does.
    """

    wrench: FaultTable
    force: FaultTable


@register_jitable
def held_at_first(faults: FaultTable | None, payload: int) -> np.ndarray:
    """Return the payloads that a sensor which may be stuck holds at first, one for each of its faults."""
    if faults is None:
        return np.zeros((0, payload))
    return np.zeros((faults.kinds.size, payload))


@register_jitable
def is_read_anyway(faults: FaultTable | None, t: float) -> bool:
    """Return whether a sensor is read even where its link sends nothing, as it will be stuck at what it said last."""
    if faults is None:
        return False
    for i in range(faults.kinds.size):  # noqa: SIM110 - numba compiles no generator expression in any()
        if faults.kinds[i] == STUCK and is_ahead(faults, i, t):
            return True
    return False


@register_jitable
def spoil(
    message: np.ndarray,
    faults: FaultTable | None,
    held: np.ndarray,
    x: np.ndarray,
    t: float,
    anchors: np.ndarray,
    seed: int,
    h: float,
) -> None:
    """Change a sensor's message to what it says at t, and what is held.

    Args:
        message: what it would say without faults.
        faults: its own.
        held: of held_at_first.
        x: state as the sensor sees it (12).
        t: time [s].
        anchors: p_WA_i as they stand (n, 3).
        seed: of all noise.
        h: time from one message to the next [s].
    """
    if faults is None:
        return
    for i in range(faults.kinds.size):
        if faults.kinds[i] == STUCK:
            active = is_active(faults, i, t)
            said = stuck_says(message, held[i], active)
            put(held_after(message, held[i], active), held[i])
        else:
            said = with_fault(message, faults, i, Moment(x, t, anchors, seed, h))
        put(said, message)


@register_jitable
def scene_of_tick(room: Surroundings, faults: FaultTable | None, t: float) -> Scene:
    """Return what the camera looks at, at t [s]."""
    if faults is None:
        return Scene(room, np.zeros(0, dtype=np.bool_))
    return scene_at(room, faults, t)


@register_jitable
def of_those(values: np.ndarray, faults: FaultTable | None, there: np.ndarray) -> np.ndarray:
    """Return what belongs to the landmarks that are there."""
    if faults is None:
        return values
    return values[there]


@register_jitable
def spoil_wrench(u: np.ndarray, faults: VehicleFaults | None, t: float) -> None:
    """Change u to what acts on the body at t [s]."""
    if faults is None:
        return
    put(wrench_at(u, faults.wrench, t), u)


@register_jitable
def spoil_force(d: np.ndarray, faults: VehicleFaults | None, t: float) -> None:
    """Change a disturbance to what acts on the body at t [s]."""
    if faults is None:
        return
    put(force_at(d, faults.force, t), d)
