"""The tight filter as a System: messages in, the paper's states one tick ahead out."""

from collections.abc import Mapping

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from ortilo_drake.model.measurement import Measurement
from ortilo_drake.model.signals import (
    ARRIVED,
    DETECTIONS_SIZE,
    IMU_SIZE,
    N_U,
    N_X,
    N_XBAR,
    PAYLOAD,
    samples_in,
    size_of_samples,
    uwb_size,
)
from ortilo_drake.onboard.estimator.tight.aids import Aids
from ortilo_drake.onboard.estimator.tight.attitude_rows import take_fix
from ortilo_drake.onboard.estimator.tight.layout import Layout
from ortilo_drake.onboard.estimator.tight.model import first_states
from ortilo_drake.onboard.estimator.tight.sense import NOT_TAKEN, PRESENT, clone_of, take_messages
from ortilo_drake.onboard.estimator.tight.tick import N_AHEAD, RATES, Motion, keep_pose, one_ahead
from ortilo_drake.onboard.estimator.tight.watch import LAST

_NOTHING = np.zeros(PAYLOAD)  # the message of a sensor that does not fly


class TightFilter(LeafSystem):
    """The tightly coupled filter.

    In a tick it goes through the imu's samples to t_k, takes what arrived, each message at its stamp, and predicts the
    next tick with the control that acts from now on.

    Ports:
        imu (2 + 9, or 2 + n (2 + 9)): the imu message.
        uwb (2 + 2 n), detections (DETECTIONS_SIZE): messages, of sensors that fly.
        <name> (2 + m + m^2): the fix of a sensor of one's own, linear in the paper's states.
        control (4): u_k.
        estimate (12, output): xhat_{k|k-1}.
        covariance (144, output): its covariance row by row.
        wide (240, output): both as the paper's filter has them (15, 225), for solvers of fixes.
        y (p), delta (s), V2 (q) (outputs): which sensors' messages are there in this tick. No fix is made of ranges and
            boxes: y is NaN there.

    State (discrete):
        nominal, covariance: see layout.py.
        kept (N_KEPT): of imu and control, see tick.py.
        ahead (156): the prediction for this tick.
        watched: what the watch keeps, see watch.py.

    Args:
        layout: of the states.
        motion: imu and vehicle.
        C_0: first covariance (n, n).
        aids: the other sensors.
        sensors: those that fly.
        measurement: of the scenario.
        samples: of the imu in a message.
        rows: C of each sensor of one's own (m, 12).
        xbar_0: first estimate (15).
    """

    def __init__(
        self,
        layout: Layout,
        motion: Motion,
        C_0: np.ndarray,
        aids: Aids,
        sensors: tuple[str, ...],
        measurement: Measurement,
        samples: int,
        rows: Mapping[str, np.ndarray],
        xbar_0: np.ndarray,
    ):
        super().__init__()
        self.set_name("tight")
        self._layout, self._motion, self._aids, self._rows = layout, motion, aids, dict(rows)
        self._measurement, self._samples, self._sensors = measurement, samples, sensors
        sizes = {
            "imu": IMU_SIZE if samples == 1 else size_of_samples(IMU_SIZE, samples),
            "uwb": uwb_size(len(aids.anchors)),
            "camera": DETECTIONS_SIZE,
        }
        sizes |= {name: PAYLOAD + len(C) + len(C) ** 2 for name, C in rows.items()}
        self._ports = {
            name: self.DeclareVectorInputPort("detections" if name == "camera" else name, sizes[name])
            for name in sensors
        }
        self._control = self.DeclareVectorInputPort("control", N_U)
        x, kept, ahead = first_states(layout, motion, C_0, xbar_0)
        self._nominal = self.DeclareDiscreteState(x)
        self._covariance = self.DeclareDiscreteState(C_0.ravel())
        self._kept = self.DeclareDiscreteState(kept)
        self._ahead = self.DeclareDiscreteState(ahead)
        payloads = sum(sizes[name] - PAYLOAD for name in ("uwb", "camera") if name in sensors)
        self._watched = self.DeclareDiscreteState(LAST + payloads)
        self._groups = self._nominal, self._covariance, self._kept, self._ahead, self._watched
        self.DeclarePeriodicDiscreteUpdateEvent(motion.h, 0.0, self._update)
        own = {self.discrete_state_ticket(self._ahead)}
        self.DeclareVectorOutputPort("estimate", N_X, self._calc_estimate, own)
        self.DeclareVectorOutputPort("covariance", N_X * N_X, self._calc_covariance, own)
        self.DeclareVectorOutputPort("wide", N_XBAR + N_XBAR**2, self._calc_wide, own)
        messages = {port.ticket() for port in self._ports.values()}
        stamped = messages | {self.time_ticket()}
        self.DeclareVectorOutputPort("y", measurement.sizes["y"], self._calc_y, stamped)
        self.DeclareVectorOutputPort("delta", measurement.sizes["delta"], self._calc_delta, stamped)
        self.DeclareVectorOutputPort("V2", measurement.sizes["V2"], self._calc_V2, messages)

    def _calc_estimate(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(context.get_discrete_state(self._ahead).value()[:N_X])

    def _calc_covariance(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(context.get_discrete_state(self._ahead).value()[N_X:])

    def _calc_wide(self, context: Context, output: BasicVector) -> None:
        ahead = context.get_discrete_state(self._ahead).value()
        P_wide = np.zeros((N_XBAR, N_XBAR))
        P_wide[:N_X, :N_X] = ahead[N_X:].reshape(N_X, N_X)
        output.SetFromVector(np.concatenate((ahead[:N_X], np.zeros(N_XBAR - N_X), P_wide.ravel())))

    def _is_taken(self, name: str, message: np.ndarray, context: Context) -> bool:
        """Return whether a message is there, and not older than the poses that are kept."""
        if name == "imu":
            return bool(message[ARRIVED])
        clones = self._layout.clones if name in ("uwb", "camera") else 0
        return clone_of(message, context.get_time(), self._motion.h, clones) != NOT_TAKEN

    def _calc_delta(self, context: Context, output: BasicVector) -> None:
        delta = np.zeros(output.size())
        for name, port in self._ports.items():
            delta[self._measurement.sensors.index(name)] = self._is_taken(name, port.Eval(context), context)
        output.SetFromVector(delta)

    def _calc_y(self, context: Context, output: BasicVector) -> None:
        y = np.zeros(output.size())
        for name, port in self._ports.items():
            its, message = self._measurement.rows_of(name), port.Eval(context)
            if name in ("uwb", "camera"):
                y[its] = np.nan if self._is_taken(name, message, context) else 0.0
            elif name == "imu":
                newest = samples_in(message, self._samples)[-1] if self._samples > 1 else message
                y[its] = newest[PAYLOAD : PAYLOAD + 3] * message[ARRIVED]
            else:
                y[its] = message[PAYLOAD : PAYLOAD + len(self._rows[name])]
        output.SetFromVector(y)

    def _calc_V2(self, context: Context, output: BasicVector) -> None:
        V2 = np.zeros(output.size())
        for name, port in self._ports.items():
            block, rows = self._measurement.block_of(name), self._measurement.rows_of(name)
            m = rows.stop - rows.start
            if name == "imu" and self._aids.angle_sd > 0.0:
                V2[block] = (self._aids.angle_sd**2 * np.eye(m)).ravel()
            elif name in self._rows:
                V2[block] = port.Eval(context)[PAYLOAD + m :]
        output.SetFromVector(V2)

    def _update(self, context: Context, values: DiscreteValues) -> None:
        now, motion, layout, aids = context.get_time(), self._motion, self._layout, self._aids
        x = context.get_discrete_state(self._nominal).CopyToVector()
        C = context.get_discrete_state(self._covariance).CopyToVector().reshape(layout.n, layout.n)
        kept = context.get_discrete_state(self._kept).CopyToVector()
        watched = context.get_discrete_state(self._watched).CopyToVector()
        messages = {name: port.Eval(context) for name, port in self._ports.items()}
        samples = np.zeros((1, IMU_SIZE))
        if "imu" in messages:
            imu = messages["imu"]
            samples = samples_in(imu, self._samples) if self._samples > 1 else imu[np.newaxis]
        uwb, detections = messages.get("uwb", _NOTHING), messages.get("camera", _NOTHING)
        take_messages(x, C, kept, watched, np.ascontiguousarray(samples), uwb, detections, now, layout, motion, aids)
        for name, C_own in self._rows.items():
            message = messages[name]
            if clone_of(message, now, motion.h, layout.clones) != PRESENT:
                continue
            m = len(C_own)
            value, V = message[PAYLOAD : PAYLOAD + m], message[PAYLOAD + m :].reshape(m, m)
            rates = kept[RATES : RATES + 3]
            take_fix(x, C, layout, value.copy(), V.copy(), C_own, rates, float(aids.gates[0]), aids.huber)
        ahead = np.empty(N_AHEAD)
        one_ahead(x, C, kept, self._control.Eval(context), motion, ahead)
        keep_pose(x, C, layout)
        groups = (x, C.ravel(), kept, ahead, watched)
        for group, value in zip(self._groups, groups, strict=True):
            values.set_value(group, value)
