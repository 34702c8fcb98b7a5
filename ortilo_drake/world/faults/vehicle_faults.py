"""Faults of the vehicle: a gust, a load dropped in flight, a weak rotor.

A body of c times the mass moves under thrust f and force d as a body of the old mass does under f / c and d / c with
the same torques, and its accelerometer reads the same. So a dropped load is a change of the forces on the body.
"""

from typing import Any

import numpy as np

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.loop.element import Box, Element, Values
from ortilo_drake.model.placing import put
from ortilo_drake.model.signals import N_U
from ortilo_drake.model.vehicle import Vehicle, mixing_inverse, mixing_matrix
from ortilo_drake.scenario.faults import AnyFault, Gust, LoadDropped, RotorWeak
from ortilo_drake.world.faults.table import GUST, LOAD_DROPPED, FaultTable, is_active, numbered, settings_of, table_of
from ortilo_drake.world.vehicle.rotors import times


def wrench_matrix(fault: AnyFault, vehicle: Vehicle) -> np.ndarray:
    """Return T (4 x 4): the control u = T u_c acts on a body of the old mass when u_c is commanded.

    A weak rotor i makes s times the thrust and drag: T = M diag(1, ..., s, ..., 1) M^+, M the mixing matrix.
    """
    if isinstance(fault, LoadDropped):
        return np.diag([1.0 / fault.mass_factor, 1.0, 1.0, 1.0])
    if isinstance(fault, RotorWeak):
        lift = np.ones(vehicle.rotor_count)
        lift[fault.rotor] = fault.factor
        return np.asarray(mixing_matrix(vehicle) @ (lift[:, np.newaxis] * mixing_inverse(vehicle)))
    return np.eye(N_U)


def wrench_table(faults: tuple[AnyFault, ...], vehicle: Vehicle) -> FaultTable:
    """Return a scenario's faults that change the rotors' wrench; their settings are T row by row."""
    its = [one for one in numbered(faults) if isinstance(one.fault, LoadDropped | RotorWeak)]
    return table_of(its, [wrench_matrix(one.fault, vehicle).ravel().tolist() for one in its])


def force_table(faults: tuple[AnyFault, ...]) -> FaultTable:
    """Return a scenario's faults that change the disturbance."""
    return table_of([one for one in numbered(faults) if isinstance(one.fault, Gust | LoadDropped)])


@cached_njit
def wrench_at(u: np.ndarray, faults: FaultTable, t: float) -> np.ndarray:
    """Return the control u = T_n ... T_1 u_c (4) that acts at t [s] on a body of the old mass when u_c is commanded."""
    acting = u.copy()
    for i in range(faults.kinds.size):
        if is_active(faults, i, t):
            acting = times(settings_of(faults, i).reshape((N_U, N_U)), acting)
    return acting


@cached_njit
def force_at(d: np.ndarray, faults: FaultTable, t: float) -> np.ndarray:
    """Return the disturbance (6) that acts at t [s] on a body of the old mass: d with gusts and dropped loads."""
    acting = d.copy()
    for i in range(faults.kinds.size):
        if faults.kinds[i] == GUST and is_active(faults, i, t):
            acting[:3] += settings_of(faults, i)
    for i in range(faults.kinds.size):
        if faults.kinds[i] == LOAD_DROPPED and is_active(faults, i, t):
            acting[:3] /= settings_of(faults, i)[0]
    return acting


def wrench_out(n: Any, k: int, control: np.ndarray, faults: FaultTable, out: np.ndarray) -> None:
    """Output u (4) of wrench_at."""
    put(wrench_at(control, faults, k * n.h), out)


def force_out(n: Any, k: int, disturbance: np.ndarray, faults: FaultTable, out: np.ndarray) -> None:
    """Output d (6) of force_at."""
    put(force_at(disturbance, faults, k * n.h), out)


WRENCH = Element("wrench_faults", out=wrench_out, allocates=True)
FORCE = Element("force_faults", out=force_out, allocates=True)


def wrench_faults_box(faults: FaultTable, h: float) -> Box:
    """Return the box of u under the faults of wrench_table, for rotors without dynamics; it reads u_c (4)."""
    return Box("wrench_faults", WRENCH, N_U, Values({"h": h})).with_groups(faults=faults)


def force_faults_box(faults: FaultTable, h: float) -> Box:
    """Return the box of the disturbance under the faults of force_table; it reads the drawn disturbance (6)."""
    return Box("force_faults", FORCE, 6, Values({"h": h})).with_groups(faults=faults)
