"""A fault between a sensor and its link: it changes the messages while it lasts, and nothing else."""

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from ortilo_drake.model.signals import ARRIVED, DETECTION_SIZE, N_X, PAYLOAD
from ortilo_drake.scenario.faults import AnyFault, CameraBlinded, GyroBias, Stuck, YawJump
from ortilo_drake.world.faults.range_faults import Moment, with_range_fault
from ortilo_drake.world.faults.timing import is_active
from ortilo_drake.world.noise import stream_id
from ortilo_drake.world.seeded_system import SeededSystem

_YAW, _RATES = PAYLOAD + 2, slice(PAYLOAD + 3, PAYLOAD + 6)  # in an imu message


def with_fault(message: np.ndarray, sensor: str, fault: AnyFault, moment: Moment) -> np.ndarray:
    """Return a message that is there as it is under a fault that lasts; arguments as MessageFault's and Moment's."""
    if sensor == "uwb":
        return with_range_fault(message, fault, moment)
    said = message.copy()
    if isinstance(fault, YawJump):
        said[_YAW] += fault.by
    elif isinstance(fault, GyroBias):
        said[_RATES] += fault.by
    elif isinstance(fault, CameraBlinded):
        said[PAYLOAD:] = 0.0
        said[PAYLOAD::DETECTION_SIZE] = -1.0
    return said


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
        sensor: its name.
        size: m.
        fault: the fault.
        number: which of the faults of its kind it is; its noise stream is 'fault/<kind>/<number>'.
        anchors: where the anchors stand (n, 3).
        seed: seed of all noise.
        h: time from one message to the next [s].
    """

    def __init__(
        self, name: str, sensor: str, size: int, fault: AnyFault, number: int, anchors: np.ndarray, seed: int, h: float
    ):
        super().__init__(seed)
        self.set_name(name)
        self._sensor, self._fault, self._h = sensor, fault, h
        self._stream = stream_id(f"fault/{fault.kind}/{number}")
        self._anchors = self.DeclareNumericParameter(BasicVector(anchors.ravel()))
        self._message = self.DeclareVectorInputPort("message", size)
        self._state = self.DeclareVectorInputPort("state", N_X)
        needs = {self._message.ticket(), self._state.ticket(), self.time_ticket(), self.all_parameters_ticket()}
        self.DeclareVectorOutputPort("said", size, self._calc_said, prerequisites_of_calc=needs)

    def set_anchors_in(self, context: Context, anchors: np.ndarray) -> None:
        """Set where the anchors stand (n, 3) in a context of this system."""
        context.get_mutable_numeric_parameter(self._anchors).SetFromVector(anchors.ravel())

    def _calc_said(self, context: Context, output: BasicVector) -> None:
        message, t = self._message.Eval(context), context.get_time()
        if message[ARRIVED] != 0.0 and is_active(self._fault, t):
            anchors = context.get_numeric_parameter(self._anchors).CopyToVector().reshape(-1, 3)
            moment = Moment(self._state.Eval(context), t, anchors, self.seed_in(context), self._stream, self._h)
            message = with_fault(message, self._sensor, self._fault, moment)
        output.set_value(message)


class StuckSensor(LeafSystem):
    """A sensor that is stuck: while the fault lasts, its payload is the last one from before.

    Ports:
        message (m): what the sensor would say.
        said (m, output): what it says; arrived and stamp go on.

    State (discrete, updated every h): the last payload that was there before the start (m - 2).

    Args:
        name: of the system.
        size: m.
        fault: when.
        h: time from one message to the next [s].
    """

    def __init__(self, name: str, size: int, fault: Stuck, h: float):
        super().__init__()
        self.set_name(name)
        self._fault = fault
        self._message = self.DeclareVectorInputPort("message", size)
        held = self.DeclareDiscreteState(size - PAYLOAD)
        self.DeclarePeriodicDiscreteUpdateEvent(h, 0.0, self._update)
        needs = {self._message.ticket(), self.time_ticket(), self.discrete_state_ticket(held)}
        self.DeclareVectorOutputPort("said", size, self._calc_said, prerequisites_of_calc=needs)

    def _update(self, context: Context, values: DiscreteValues) -> None:
        message, held = self._message.Eval(context), context.get_discrete_state().value()
        before = message[ARRIVED] != 0.0 and not is_active(self._fault, context.get_time())
        values.set_value(message[PAYLOAD:] if before else held)

    def _calc_said(self, context: Context, output: BasicVector) -> None:
        said = self._message.Eval(context).copy()
        if is_active(self._fault, context.get_time()):
            said[PAYLOAD:] = context.get_discrete_state().value()
        output.set_value(said)
