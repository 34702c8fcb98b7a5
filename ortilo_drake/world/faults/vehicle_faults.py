"""Faults of the vehicle: a gust, a load dropped in flight, a weak rotor.

A body of c times the mass moves under thrust f and force d as the one of the old mass does under f / c and d / c,
torques as they are; so does its accelerometer. So a dropped load is a change of what acts on the body.
"""

import numpy as np
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from ortilo_drake.model.signals import N_U
from ortilo_drake.model.vehicle import Vehicle, mixing_inverse, mixing_matrix
from ortilo_drake.scenario.faults import AnyFault, Gust, LoadDropped, RotorWeak
from ortilo_drake.world.faults.timing import is_active


def of_wrench(faults: tuple[AnyFault, ...]) -> tuple[AnyFault, ...]:
    """Return the faults that change what the rotors do."""
    return tuple(fault for fault in faults if isinstance(fault, LoadDropped | RotorWeak))


def of_force(faults: tuple[AnyFault, ...]) -> tuple[AnyFault, ...]:
    """Return the faults that change what the disturbance does."""
    return tuple(fault for fault in faults if isinstance(fault, Gust | LoadDropped))


def wrench_matrix(fault: AnyFault, vehicle: Vehicle) -> np.ndarray:
    """Return T (4 x 4): u = T u_c as it acts on a body of the old mass, of the commanded u_c.

    A weak rotor i makes s times the thrust and drag: T = M diag(1, ..., s, ..., 1) M^+, M the mixing matrix.
    """
    if isinstance(fault, LoadDropped):
        return np.diag([1.0 / fault.mass_factor, 1.0, 1.0, 1.0])
    if isinstance(fault, RotorWeak):
        lift = np.ones(vehicle.rotor_count)
        lift[fault.rotor] = fault.factor
        return np.asarray(mixing_matrix(vehicle) @ (lift[:, np.newaxis] * mixing_inverse(vehicle)))
    return np.eye(N_U)


def force_at(d: np.ndarray, faults: tuple[AnyFault, ...], t: float) -> np.ndarray:
    """Return a disturbance d (6) with the faults at t [s], as it acts on a body of the old mass."""
    acting = d.copy()
    active = [fault for fault in faults if is_active(fault, t)]
    for fault in active:
        if isinstance(fault, Gust):
            acting[:3] += fault.force
    for fault in active:
        if isinstance(fault, LoadDropped):
            acting[:3] /= fault.mass_factor
    return acting


class WrenchFaults(LeafSystem):
    """Memoryless: u = T_1 ... T_n u_c of the faults that last.

    Ports:
        commanded (4): u_c.
        wrench (4, output): u as it acts on a body of the old mass.

    Args:
        faults: of the vehicle, see of_wrench.
        vehicle: its mixing.
    """

    def __init__(self, faults: tuple[AnyFault, ...], vehicle: Vehicle):
        super().__init__()
        self.set_name("wrench_faults")
        self._faults = tuple((fault, wrench_matrix(fault, vehicle)) for fault in faults)
        self._commanded = self.DeclareVectorInputPort("commanded", N_U)
        needs = {self._commanded.ticket(), self.time_ticket()}
        self.DeclareVectorOutputPort("wrench", N_U, self._calc_wrench, prerequisites_of_calc=needs)

    def _calc_wrench(self, context: Context, output: BasicVector) -> None:
        u, t = self._commanded.Eval(context), context.get_time()
        for fault, matrix in self._faults:
            if is_active(fault, t):
                u = matrix @ u
        output.set_value(u)


class ForceFaults(LeafSystem):
    """Memoryless: the disturbance with gusts, after a load was dropped the stronger for it.

    Ports:
        drawn (6): force in W [N], torque in B [N m].
        disturbance (6, output): as it acts on a body of the old mass.

    Args:
        faults: of the vehicle, see of_force.
    """

    def __init__(self, faults: tuple[AnyFault, ...]):
        super().__init__()
        self.set_name("force_faults")
        self._faults = faults
        self._drawn = self.DeclareVectorInputPort("drawn", 6)
        needs = {self._drawn.ticket(), self.time_ticket()}
        self.DeclareVectorOutputPort("disturbance", 6, self._calc_disturbance, prerequisites_of_calc=needs)

    def _calc_disturbance(self, context: Context, output: BasicVector) -> None:
        output.set_value(force_at(self._drawn.Eval(context), self._faults, context.get_time()))
