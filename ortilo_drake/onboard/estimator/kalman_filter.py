"""The intermittent Kalman filter as a system, without and with a history for late measurements."""

from functools import partial

import numpy as np
from numba import njit
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, InputPort, LeafSystem

from ortilo_drake.model.clock import tick_of
from ortilo_drake.model.measurement import Measurement
from ortilo_drake.model.signals import ARRIVED, IMU_SIZE, N_I, N_U, N_X, N_XBAR, REFERENCE_SIZE, STAMP
from ortilo_drake.onboard.estimator.extra_states import ACCELEROMETER
from ortilo_drake.onboard.estimator.filter_loops import filter_step
from ortilo_drake.onboard.estimator.intermittent_filter import FilterModel
from ortilo_drake.onboard.estimator.late_measurements import N_BELIEF, empty_history, replay_step, row_of_past, slot_of
from ortilo_drake.onboard.estimator.specific_force import with_specific_force


@njit(cache=True)
def known_part(belief: np.ndarray, n: int) -> np.ndarray:
    """Return [xhat, P row by row] (240) of [x; i] alone from that of [x; e; i] (n + n^2)."""
    out = np.empty(N_XBAR + N_XBAR * N_XBAR)
    for i in range(N_XBAR):
        row = i if i < N_X else n - N_XBAR + i
        out[i] = belief[row]
        for j in range(N_XBAR):
            out[N_XBAR * (i + 1) + j] = belief[n * (row + 1) + (j if j < N_X else n - N_XBAR + j)]
    return out


@njit(cache=True)
def extra_part(belief: np.ndarray, n: int) -> np.ndarray:
    """Return [e_hat, standard deviations] (2 e) of the states between x and i, from [x; e; i] (n + n^2)."""
    e = n - N_XBAR
    out = np.empty(2 * e)
    for i in range(e):
        out[i] = belief[N_X + i]
        out[e + i] = np.sqrt(belief[n + (n + 1) * (N_X + i)])
    return out


def with_known_part(belief: np.ndarray, n: int, xbar: np.ndarray, P: np.ndarray) -> np.ndarray:
    """Return [xhat, P row by row] of [x; e; i] with this [x; i] (15), of covariance P (15 x 15).

    The states between keep their values and covariance, uncorrelated with the new ones.
    """
    known = np.concatenate((np.arange(N_X), np.arange(n - N_I, n)))
    x, P_whole = belief[:n].copy(), belief[n:].reshape(n, n).copy()
    x[known] = xbar
    P_whole[known], P_whole[:, known] = 0.0, 0.0
    P_whole[np.ix_(known, known)] = P
    return np.concatenate((x, P_whole.ravel()))


def _handed_over(measurement: Measurement) -> dict[str, int]:
    """Return sizes of y, delta and V2 as the handler hands them over: without the accelerometer's rows."""
    sizes = measurement.sizes
    if ACCELEROMETER not in measurement.sensors:
        return sizes
    return {"y": sizes["y"] - 3, "delta": sizes["delta"] - 1, "V2": sizes["V2"] - 9}


class KalmanFilter(LeafSystem):
    """The one-step predictor xhat_{k|k-1} of xbar = [x; e; i] and its covariance P_k.

    Ports:
        y (p), delta (s), V2 (q): the measurement of this tick, see model/measurement.py.
        imu (11): the imu message; only where the accelerometer's rows are made of it.
        control (4): u_k, f_T absolute.
        reference (9): r and its derivatives; r drives the integrator.
        belief (240, output): [xhat_{k|k-1}, P_k row by row] of [x; i].
        extra (2 e, output): the same of the states e between them, of P_k the standard deviations; only where there
            are any.

    The outputs are discrete states and depend on no input within a tick. Equations: intermittent_filter.py.

    Args:
        model: what the filter believes of the vehicle.
        measurement: the layout of y, delta and V2, over x and e, with the accelerometer's rows if it has any.
        hover_thrust: m g [N] of the vehicle as it is believed to be.
        xbar_0: initial estimate of [x; i] (15); that of e is 0.
        P_0: covariance of [x; e; i].
        h: tick [s].
        specific_force: variances of the accelerometer's rows [m^2/s^4] (3); None where there are none.
    """

    def __init__(
        self,
        model: FilterModel,
        measurement: Measurement,
        hover_thrust: float,
        xbar_0: np.ndarray,
        P_0: np.ndarray,
        h: float,
        specific_force: np.ndarray | None = None,
    ):
        super().__init__()
        self.set_name("kalman_filter")
        self._n, self._specific_force = len(P_0), specific_force
        self._model, self._layout, self._h = tuple(model), tuple(measurement.layout), h  # plain, see filter_loops.py
        self._hover = np.array([hover_thrust, 0.0, 0.0, 0.0])
        self._measurement = [
            self.DeclareVectorInputPort(name, size) for name, size in _handed_over(measurement).items()
        ]
        if specific_force is not None:
            self._imu, self._imu_number = self.DeclareVectorInputPort("imu", IMU_SIZE), measurement.sensors.index("imu")
        self._control = self.DeclareVectorInputPort("control", N_U)
        self._reference = self.DeclareVectorInputPort("reference", REFERENCE_SIZE)
        whole = np.concatenate((xbar_0[:N_X], np.zeros(self._n - N_XBAR), xbar_0[N_X:], P_0.ravel()))
        self._known = self._belief = self.DeclareDiscreteState(known_part(whole, self._n))
        if self._n > N_XBAR:
            self._extra = self.DeclareDiscreteState(extra_part(whole, self._n))
            self._belief = self.DeclareDiscreteState(whole)
            self.DeclareStateOutputPort("extra", self._extra)
        self.DeclareStateOutputPort("belief", self._known)
        self.DeclarePeriodicDiscreteUpdateEvent(h, 0.0, self._update)

    def SetBelief(self, context: Context, xbar: np.ndarray, P: np.ndarray) -> None:
        """Set estimate (15) and covariance (15 x 15) of [x; i] in a context of this filter; e stays as it is."""
        values = context.get_mutable_discrete_state()
        self._set_belief(values, with_known_part(values.value(self._belief), self._n, xbar, P))

    def _set_belief(self, values: DiscreteValues, belief: np.ndarray) -> None:
        values.set_value(self._belief, belief)
        if self._n > N_XBAR:
            values.set_value(self._known, known_part(belief, self._n))
            values.set_value(self._extra, extra_part(belief, self._n))

    def _inputs(self, context: Context) -> list[np.ndarray]:
        """Return y, delta, V2, the control less hover, and the reference."""
        signals = [port.Eval(context) for port in self._measurement]
        if self._specific_force is not None:
            imu = self._imu.Eval(context)
            signals = with_specific_force(*signals, imu, self._imu_number, self._specific_force)
        return [*signals, self._control.Eval(context) - self._hover, self._reference.Eval(context)]

    def _update(self, context: Context, values: DiscreteValues) -> None:
        belief = context.get_discrete_state(self._belief).value()
        self._set_belief(values, filter_step(belief, *self._inputs(context), self._model, self._layout))


class ReplayKalmanFilter(KalmanFilter):
    """A KalmanFilter that puts a late measurement into the tick of its stamp and runs again from there.

    Ports, beside those of a KalmanFilter:
        stamps (s): when each sensor's measurement was true [s].
        message_<sensor> (n): the stamped message of each sensor whose fix is made about an estimate.
        belief_<sensor> (240, output): the belief of the tick of that stamp, by all that has arrived since; the present
            one where no message arrived or its stamp is of this tick (or of a later one), that of the oldest tick kept
            where the stamp is older.

    The last N ticks are a discrete state of their own. Equations: late_measurements.py.

    Args:
        model, measurement, hover_thrust, xbar_0, P_0, h, specific_force: as a KalmanFilter's.
        ticks: N.
        messages: size of the message of each sensor whose fix is made about an estimate.
    """

    def __init__(
        self,
        model: FilterModel,
        measurement: Measurement,
        hover_thrust: float,
        xbar_0: np.ndarray,
        P_0: np.ndarray,
        h: float,
        ticks: int,
        messages: dict[str, int],
        specific_force: np.ndarray | None = None,
    ):
        super().__init__(model, measurement, hover_thrust, xbar_0, P_0, h, specific_force)
        self._slot = slot_of(measurement, self._n)
        self._stamps = self.DeclareVectorInputPort("stamps", _handed_over(measurement)["delta"])
        self._history = self.DeclareDiscreteState(empty_history(ticks, self._slot).ravel())
        for sensor, size in messages.items():
            message = self.DeclareVectorInputPort(f"message_{sensor}", size)
            needs = {message.ticket(), self.xd_ticket()}
            calc = partial(self._calc_past, message)
            self.DeclareVectorOutputPort(f"belief_{sensor}", N_BELIEF, calc, prerequisites_of_calc=needs)

    def HasHistory(self) -> bool:
        """Return whether there is more in the state than the belief."""
        return True

    def _calc_past(self, port: InputPort, context: Context, output: BasicVector) -> None:
        """Compute the belief of the tick of the message on a port."""
        message = port.Eval(context)
        if message[ARRIVED]:
            history = context.get_discrete_state(self._history).value().reshape(-1, self._slot.size)
            row = row_of_past(history, tick_of(message[STAMP], self._h))
            if row >= 0:
                output.set_value(known_part(history[row, self._slot.belief : self._slot.y], self._n))
                return
        output.set_value(context.get_discrete_state(self._known).value())

    def _update(self, context: Context, values: DiscreteValues) -> None:
        y, delta, V2, u, r = self._inputs(context)
        stamps = self._stamps.Eval(context)
        if self._specific_force is not None:
            stamps = np.append(stamps, stamps[self._imu_number])
        belief = replay_step(
            values.get_mutable_value(self._history).reshape(-1, self._slot.size),  # a copy of the state's, changed here
            self._slot,
            context.get_discrete_state(self._belief).value(),
            tick_of(context.get_time(), self._h),
            y,
            delta,
            V2,
            stamps,
            self._h,
            u,
            r,
            self._model,
            self._layout,
        )
        self._set_belief(values, belief)
