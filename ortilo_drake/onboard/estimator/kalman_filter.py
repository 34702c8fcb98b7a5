"""The intermittent Kalman filter as a system, without and with a history for late measurements."""

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from ortilo_drake.model.clock import tick_of
from ortilo_drake.model.hover import discretize, disturbance_W, hover_A, hover_B
from ortilo_drake.model.measurement import Measurement
from ortilo_drake.model.signals import ARRIVED, N_U, REFERENCE_SIZE, STAMP
from ortilo_drake.model.vehicle import Vehicle
from ortilo_drake.onboard.estimator.filter_loops import filter_step
from ortilo_drake.onboard.estimator.intermittent_filter import INTEGRATORS, FilterModel
from ortilo_drake.onboard.estimator.late_measurements import N_BELIEF, empty_history, replay_step, row_of_past, slot_of
from ortilo_drake.scenario import DiagonalW
from ortilo_drake.scenario import IntermittentFilter as FilterSettings


def process_noise(settings: FilterSettings, vehicle: Vehicle, h: float) -> np.ndarray:
    """Return W (12 x 12) as the scenario gives it."""
    W = settings.W
    if isinstance(W, DiagonalW):
        return np.diag(np.repeat([W.position, W.angle, W.velocity, W.rate], 3))
    return disturbance_W(vehicle, h, W.force_sd, W.torque_sd)


def initial_covariance(settings: FilterSettings) -> np.ndarray:
    """Return P_0 (15 x 15): the scenario's variances, and 0 for the integrator, which is known."""
    return np.diag([*np.repeat(np.square(settings.initial_sd), 3), 0.0, 0.0, 0.0])


def filter_model(settings: FilterSettings, vehicle: Vehicle, integrator: str, h: float) -> FilterModel:
    """Return what the filter believes of the vehicle; integrator is 'literal', 'hold' or 'estimate'."""
    Phi, Gamma = discretize(hover_A(), hover_B(vehicle), h)
    return FilterModel(Phi, Gamma, process_noise(settings, vehicle, h), INTEGRATORS[integrator])


class KalmanFilter(LeafSystem):
    """The one-step predictor xhat_{k|k-1} of xbar = [x; i] and its covariance P_k.

    Ports:
        y (p), delta (s), V2 (q): the measurement of this tick, see model/measurement.py.
        control (4): u_k, f_T absolute.
        reference (9): r and its derivatives; r drives the integrator.
        belief (240, output): [xhat_{k|k-1}, P_k row by row].

    The output is a discrete state and depends on no input within a tick. Equations: intermittent_filter.py.

    Args:
        model: what the filter believes of the vehicle.
        measurement: the layout of y, delta and V2.
        hover_thrust: m g [N] of the vehicle as it is believed to be.
        xbar_0: initial estimate (15).
        P_0: its covariance (15 x 15).
        h: tick [s].
    """

    def __init__(
        self,
        model: FilterModel,
        measurement: Measurement,
        hover_thrust: float,
        xbar_0: np.ndarray,
        P_0: np.ndarray,
        h: float,
    ):
        super().__init__()
        self.set_name("kalman_filter")
        self._model, self._layout, self._h = tuple(model), tuple(measurement.layout), h  # plain, see filter_loops.py
        self._hover = np.array([hover_thrust, 0.0, 0.0, 0.0])
        self._measurement = [self.DeclareVectorInputPort(name, size) for name, size in measurement.sizes.items()]
        self._control = self.DeclareVectorInputPort("control", N_U)
        self._reference = self.DeclareVectorInputPort("reference", REFERENCE_SIZE)
        self._belief = self.DeclareDiscreteState(np.concatenate((xbar_0, P_0.ravel())))
        self.DeclareStateOutputPort("belief", self._belief)
        self.DeclarePeriodicDiscreteUpdateEvent(h, 0.0, self._update)

    def SetBelief(self, context: Context, xbar: np.ndarray, P: np.ndarray) -> None:
        """Set estimate (15) and covariance (15 x 15) in a context of this filter."""
        context.get_mutable_discrete_state().set_value(self._belief, np.concatenate((xbar, P.ravel())))

    def _inputs(self, context: Context) -> list[np.ndarray]:
        """Return y, delta, V2, the control less hover, and the reference."""
        signals = [port.Eval(context) for port in self._measurement]
        return [*signals, self._control.Eval(context) - self._hover, self._reference.Eval(context)]

    def _update(self, context: Context, values: DiscreteValues) -> None:
        belief = context.get_discrete_state(self._belief).value()
        values.set_value(self._belief, filter_step(belief, *self._inputs(context), self._model, self._layout))


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
        model, measurement, hover_thrust, xbar_0, P_0, h: as a KalmanFilter's.
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
    ):
        super().__init__(model, measurement, hover_thrust, xbar_0, P_0, h)
        self._slot = slot_of(measurement)
        self._stamps = self.DeclareVectorInputPort("stamps", measurement.sizes["delta"])
        self._history = self.DeclareDiscreteState(empty_history(ticks, self._slot).ravel())
        for sensor, size in messages.items():
            message = self.DeclareVectorInputPort(f"message_{sensor}", size)

            def calc(context: Context, output: BasicVector, message=message) -> None:  # type: ignore[no-untyped-def]
                output.set_value(self._past(context, message.Eval(context)))

            needs = {message.ticket(), self.xd_ticket()}
            self.DeclareVectorOutputPort(f"belief_{sensor}", N_BELIEF, calc, prerequisites_of_calc=needs)

    def HasHistory(self) -> bool:
        """Return whether there is more in the state than the belief."""
        return True

    def _past(self, context: Context, message: np.ndarray) -> np.ndarray:
        if message[ARRIVED]:
            history = context.get_discrete_state(self._history).value().reshape(-1, self._slot.size)
            row = row_of_past(history, tick_of(message[STAMP], self._h))
            if row >= 0:
                return np.asarray(history[row, self._slot.belief : self._slot.y])
        return np.asarray(context.get_discrete_state(self._belief).value())

    def _update(self, context: Context, values: DiscreteValues) -> None:
        y, delta, V2, u, r = self._inputs(context)
        belief = replay_step(
            values.get_mutable_value(self._history).reshape(-1, self._slot.size),  # a copy of the state's, changed here
            self._slot,
            context.get_discrete_state(self._belief).value(),
            tick_of(context.get_time(), self._h),
            y,
            delta,
            V2,
            self._stamps.Eval(context),
            self._h,
            u,
            r,
            self._model,
            self._layout,
        )
        values.set_value(self._belief, belief)
