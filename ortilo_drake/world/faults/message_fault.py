"""A fault between a sensor and its link: it changes the messages while it lasts, and nothing else."""

import numpy as np
from numba import njit
from numba.extending import register_jitable
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from ortilo_drake.model.signals import ARRIVED, DETECTION_SIZE, N_X, PAYLOAD
from ortilo_drake.world.faults.range_faults import Moment, with_range_fault
from ortilo_drake.world.faults.table import (
    CAMERA_BLINDED,
    GYRO_BIAS,
    YAW_JUMP,
    FaultTable,
    Numbered,
    settings_of,
    table_of,
)
from ortilo_drake.world.faults.timing import is_active
from ortilo_drake.world.seeded_system import SeededSystem

_YAW, _RATES = PAYLOAD + 2, PAYLOAD + 3  # in an imu message


@njit(cache=True)
def with_fault(message: np.ndarray, faults: FaultTable, i: int, moment: Moment) -> np.ndarray:
    """Return a sensor's message as it is said under fault i, which is not that of a sensor that is stuck."""
    if message[ARRIVED] == 0.0 or not is_active(faults, i, moment.t):
        return message.copy()
    kind, values = faults.kinds[i], settings_of(faults, i)
    if kind in (YAW_JUMP, GYRO_BIAS, CAMERA_BLINDED):
        said = message.copy()
        if kind == YAW_JUMP:
            said[_YAW] += values[0]
        elif kind == GYRO_BIAS:
            said[_RATES : _RATES + 3] += values
        else:
            said[PAYLOAD:] = 0.0
            said[PAYLOAD::DETECTION_SIZE] = -1.0
        return said
    return with_range_fault(message, faults, i, moment)


@register_jitable
def stuck_says(message: np.ndarray, held: np.ndarray, active: bool) -> np.ndarray:
    """Return what a sensor that may be stuck says: while it is, its payload is the held one."""
    said = message.copy()
    if active:
        said[PAYLOAD:] = held
    return said


@register_jitable
def held_after(message: np.ndarray, held: np.ndarray, active: bool) -> np.ndarray:
    """Return the payload that is held after a message: the last one that was there while it was not stuck."""
    return message[PAYLOAD:] if message[ARRIVED] != 0.0 and not active else held


class MessageFault(SeededSystem):
    """Memoryless: a sensor's message under a fault.

    Ports:
        message (m): what the sensor would say.
        state (12): x as the sensor sees it.
        said (m, output): what it says.

    Parameters of the Context, beside the seed:
        anchors (3 n): p_WA row by row [m], of a fault of the ranges; as given by default.

    Args:
        name: of the system.
        size: m.
        fault: the fault.
        anchors: where the anchors stand (n, 3).
        seed: seed of all noise.
        h: time from one message to the next [s].
    """

    def __init__(self, name: str, size: int, fault: Numbered, anchors: np.ndarray, seed: int, h: float):
        super().__init__(seed)
        self.set_name(name)
        self._table, self._h = table_of([fault]), h
        self._anchors = self.DeclareNumericParameter(BasicVector(anchors.ravel()))
        self._message = self.DeclareVectorInputPort("message", size)
        self._state = self.DeclareVectorInputPort("state", N_X)
        needs = {self._message.ticket(), self._state.ticket(), self.time_ticket(), self.all_parameters_ticket()}
        self.DeclareVectorOutputPort("said", size, self._calc_said, prerequisites_of_calc=needs)

    def set_anchors_in(self, context: Context, anchors: np.ndarray) -> None:
        """Set where the anchors stand (n, 3) in a context of this system."""
        context.get_mutable_numeric_parameter(self._anchors).SetFromVector(anchors.ravel())

    def _calc_said(self, context: Context, output: BasicVector) -> None:
        anchors = context.get_numeric_parameter(self._anchors).CopyToVector().reshape(-1, 3)
        moment = Moment(self._state.Eval(context), context.get_time(), anchors, self.seed_in(context), self._h)
        output.set_value(with_fault(self._message.Eval(context), self._table, 0, moment))


class StuckSensor(LeafSystem):
    """A sensor that is stuck: while the fault lasts, its payload is the last one from before.

    Ports:
        message (m): what the sensor would say.
        said (m, output): what it says; arrived and stamp go on.

    State (discrete): the last payload that was there before the start (m - 2); updated every h, of a sensor faster than
    the tick at the offsets h (i / n), as world/sensors/sample_collector.py samples it: no event falls between two.

    Args:
        name: of the system.
        size: m.
        fault: when.
        h: tick [s].
        n: messages of the sensor in a tick.
    """

    def __init__(self, name: str, size: int, fault: Numbered, h: float, n: int = 1):
        super().__init__()
        self.set_name(name)
        self._table = table_of([fault])
        self._message = self.DeclareVectorInputPort("message", size)
        held = self.DeclareDiscreteState(size - PAYLOAD)
        for i in range(n):
            self.DeclarePeriodicDiscreteUpdateEvent(h, h * (i / n), self._update)
        needs = {self._message.ticket(), self.time_ticket(), self.discrete_state_ticket(held)}
        self.DeclareVectorOutputPort("said", size, self._calc_said, prerequisites_of_calc=needs)

    def _is_active(self, context: Context) -> bool:
        return is_active(self._table, 0, context.get_time())

    def _update(self, context: Context, values: DiscreteValues) -> None:
        message, held = self._message.Eval(context), context.get_discrete_state().value()
        values.set_value(held_after(message, held, self._is_active(context)))

    def _calc_said(self, context: Context, output: BasicVector) -> None:
        held = context.get_discrete_state().value()
        output.set_value(stuck_says(self._message.Eval(context), held, self._is_active(context)))
