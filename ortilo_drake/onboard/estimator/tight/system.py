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
    STAMP,
    samples_in,
    size_of_samples,
    uwb_size,
)
from ortilo_drake.onboard.estimator.tight.aids import Aids
from ortilo_drake.onboard.estimator.tight.attitude_rows import take_angles, take_fix
from ortilo_drake.onboard.estimator.tight.inertial import quaternion_of
from ortilo_drake.onboard.estimator.tight.layout import ADDITIVE, Layout, P, Q, V, nominal_size
from ortilo_drake.onboard.estimator.tight.pixels import pose_belief, take_boxes
from ortilo_drake.onboard.estimator.tight.ranges import take_ranges
from ortilo_drake.onboard.estimator.tight.tick import N_KEPT, RATES, THRUST, Motion, go_on, keep_pose, one_ahead
from ortilo_drake.onboard.estimator.tight.watch import LAST, says_again, watch_angles, watch_ranges
from ortilo_drake.onboard.landmarks.landmark_association import associate

N_AHEAD = N_X + N_X * N_X


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
        x, kept = np.zeros(nominal_size(layout)), np.zeros(N_KEPT)
        x[P : P + 3], x[V : V + 3], x[Q : Q + 4] = xbar_0[0:3], xbar_0[6:9], quaternion_of(xbar_0[3:6])
        for c in range(layout.clones):
            at = layout.core + 1 + 7 * c
            x[at : at + 3], x[at + 3 : at + 7] = x[P : P + 3], x[Q : Q + 4]
        kept[5], kept[THRUST] = 9.81, motion.mass * 9.81
        ahead = np.zeros(N_AHEAD)
        ahead[:N_X] = xbar_0[:N_X]
        T = np.zeros((N_X, layout.n))
        T[0:3, 0:3], T[3:6, 6:9], T[6:9, 3:6], T[9:12, 9:12] = (np.eye(3),) * 4
        ahead[N_X:] = (T @ C_0 @ T.T).ravel()
        self._nominal = self.DeclareDiscreteState(x)
        self._covariance = self.DeclareDiscreteState(C_0.ravel())
        self._kept = self.DeclareDiscreteState(kept)
        self._ahead = self.DeclareDiscreteState(ahead)
        watched = [name for name in ("uwb", "camera") if name in sensors]
        ends = np.cumsum([LAST, *(sizes[name] - PAYLOAD for name in watched)])
        self._last = {name: slice(ends[i], ends[i + 1]) for i, name in enumerate(watched)}
        self._watched = self.DeclareDiscreteState(int(ends[-1]))
        self._groups = self._nominal, self._covariance, self._kept, self._ahead, self._watched
        self.DeclarePeriodicDiscreteUpdateEvent(motion.h, 0.0, self._update)
        own = {self.discrete_state_ticket(self._ahead)}
        self.DeclareVectorOutputPort("estimate", N_X, self._calc_estimate, own)
        self.DeclareVectorOutputPort("covariance", N_X * N_X, self._calc_covariance, own)
        self.DeclareVectorOutputPort("wide", N_XBAR + N_XBAR**2, self._calc_wide, own)
        messages = {port.ticket() for port in self._ports.values()}
        self.DeclareVectorOutputPort("y", measurement.sizes["y"], self._calc_y, messages)
        self.DeclareVectorOutputPort("delta", measurement.sizes["delta"], self._calc_delta, messages)
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

    def _calc_delta(self, context: Context, output: BasicVector) -> None:
        delta = np.zeros(output.size())
        for name, port in self._ports.items():
            delta[self._measurement.sensors.index(name)] = port.Eval(context)[ARRIVED]
        output.SetFromVector(delta)

    def _calc_y(self, context: Context, output: BasicVector) -> None:
        y = np.zeros(output.size())
        for name, port in self._ports.items():
            its, message = self._measurement.rows_of(name), port.Eval(context)
            if name in ("uwb", "camera"):
                y[its] = np.nan if message[ARRIVED] else 0.0
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
            if name == "imu" and self._aids.angle_sd is not None:
                V2[block] = (self._aids.angle_sd**2 * np.eye(m)).ravel()
            elif name in self._rows:
                V2[block] = port.Eval(context)[PAYLOAD + m :]
        output.SetFromVector(V2)

    def _update(self, context: Context, values: DiscreteValues) -> None:
        now, motion, layout, aids = context.get_time(), self._motion, self._layout, self._aids
        x = context.get_discrete_state(self._nominal).CopyToVector()
        C = context.get_discrete_state(self._covariance).CopyToVector().reshape(layout.n, layout.n)
        kept = context.get_discrete_state(self._kept).CopyToVector()
        watched, watch = context.get_discrete_state(self._watched).CopyToVector(), aids.watch
        messages = {name: port.Eval(context) for name, port in self._ports.items()}
        samples = np.zeros((1, IMU_SIZE))
        if "imu" in messages:
            imu = messages["imu"]
            samples = samples_in(imu, self._samples) if self._samples > 1 else imu[np.newaxis]
            samples = np.ascontiguousarray(samples)
        residual, normalized = np.empty(3), np.zeros(3)
        count = go_on(x, C, kept, samples, now, motion, residual)
        single = aids.gates[0]
        if count and aids.angle_sd is not None:
            variance = aids.angle_sd**2 / count
            take_angles(x, C, layout, residual, variance, single, aids.huber, normalized)
            if watch is not None:
                watch_angles(C, watched, normalized, watch)
        for name, message in messages.items():
            clone = self._clone_of(message, now)
            if name == "imu" or clone is None:
                continue
            if watch is not None and name in self._last and says_again(message, watched[self._last[name]]):
                continue
            if name == "uwb":
                noise = aids.range_noise, single, aids.huber, clone, aids.differences
                used, refused, _, longer = take_ranges(x, C, layout, message, aids.anchors, aids.lever, *noise)
                if watch is not None:
                    watch_ranges(C, watched, layout, used, refused, longer, watch)
            elif name == "camera":
                self._take_boxes(x, C, message, kept[RATES : RATES + 3], clone)
            elif clone < 0:
                m = len(self._rows[name])
                value, V = message[PAYLOAD : PAYLOAD + m], message[PAYLOAD + m :].reshape(m, m)
                rates = kept[RATES : RATES + 3]
                take_fix(x, C, layout, value.copy(), V.copy(), self._rows[name], rates, single, aids.huber)
        ahead = np.empty(N_AHEAD)
        one_ahead(x, C, kept, self._control.Eval(context), motion, ahead)
        keep_pose(x, C, layout)
        groups = (x, C.ravel(), kept, ahead, watched)
        for group, value in zip(self._groups, groups, strict=True):
            values.set_value(group, value)

    def _clone_of(self, message: np.ndarray, now: float) -> int | None:
        """Return the clone of a message's stamp, -1 for the present, None if it did not arrive or is too old."""
        if message[ARRIVED] == 0.0 or not np.isfinite(message).all():
            return None
        late = round((now - message[STAMP]) / self._motion.h)
        return late - 1 if 0 <= late <= self._layout.clones else None

    def _take_boxes(self, x: np.ndarray, C: np.ndarray, message: np.ndarray, w: np.ndarray, clone: int) -> None:
        aids, settings, layout = self._aids, self._aids.association, self._layout
        xhat, P_pose = pose_belief(x, C, layout, clone)
        landmarks = aids.room.landmark_positions, aids.room.landmark_outlines
        chosen, centers = associate(
            message,
            xhat,
            P_pose,
            *landmarks,
            aids.room.landmark_labels,
            aids.camera,
            float(aids.pixel_noise[0]),
            aids.gates[2],
            float(aids.pixel_noise[1]),
            settings.margin,
            -np.inf if settings.inside is None else settings.inside,
        )
        rates = w - x[ADDITIVE : ADDITIVE + 3]
        noise = aids.camera, aids.pixel_noise, rates, aids.gates[1], aids.huber, clone
        take_boxes(x, C, layout, chosen, centers, *landmarks, *noise)
