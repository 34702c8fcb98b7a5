"""The intermittent Kalman filter that honours stamps, as a system."""

import numpy as np
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

from ortilo_drake.model.clock import tick_of
from ortilo_drake.model.hover import discretize, hover_A, hover_B
from ortilo_drake.model.signals import MEASUREMENT_SIZE, N_U, N_XBAR, REFERENCE_SIZE, SENSORS
from ortilo_drake.model.vehicle import Vehicle
from ortilo_drake.onboard.estimator.intermittent_filter import INTEGRATORS
from ortilo_drake.onboard.estimator.kalman_filter import initial_covariance, process_noise
from ortilo_drake.onboard.estimator.late_measurements import SLOT_SIZE, empty_history, history_ticks, replay_step
from ortilo_drake.scenario import IntermittentFilter as FilterSettings


class ReplayKalmanFilter(LeafSystem):
    """A KalmanFilter that puts a late measurement into the tick of its stamp and runs again from there.

    Ports:
        measurement (39): y, delta and V2 of what arrived in this tick, see model/signals.py.
        stamps (3): when each sensor's measurement was true [s].
        control (4): u_k, f_T absolute.
        reference (9): r and its derivatives; r drives the integrator.
        estimate (15, output): xhat_{k|k-1} by all that arrived before tick k.
        covariance (225, output): P_k row by row.
        history (N SLOT_SIZE, output): the last N ticks, see late_measurements.py.

    All outputs are discrete states and depend on no input within a tick. Equations: late_measurements.py.

    Args:
        settings: W, the initial covariance and the horizon.
        vehicle: mass and inertia of the model.
        integrator: 'literal', 'hold' or 'estimate': what the last three states integrate.
        xbar_0: initial estimate (15).
        h: tick [s].
    """

    def __init__(self, settings: FilterSettings, vehicle: Vehicle, integrator: str, xbar_0: np.ndarray, h: float):
        super().__init__()
        self.set_name("kalman_filter")
        Phi, Gamma = discretize(hover_A(), hover_B(vehicle), h)
        self._model = Phi, Gamma, process_noise(settings, vehicle, h), INTEGRATORS[integrator]
        self._hover = np.array([vehicle.hover_thrust, 0.0, 0.0, 0.0])
        self._h = h
        self._measurement = self.DeclareVectorInputPort("measurement", MEASUREMENT_SIZE)
        self._stamps = self.DeclareVectorInputPort("stamps", len(SENSORS))
        self._control = self.DeclareVectorInputPort("control", N_U)
        self._reference = self.DeclareVectorInputPort("reference", REFERENCE_SIZE)
        xhat = self.DeclareDiscreteState(xbar_0)
        P = self.DeclareDiscreteState(initial_covariance(settings).ravel())
        history = self.DeclareDiscreteState(empty_history(history_ticks(settings.horizon, h)).ravel())
        self.DeclareStateOutputPort("estimate", xhat)
        self.DeclareStateOutputPort("covariance", P)
        self.DeclareStateOutputPort("history", history)
        self.DeclarePeriodicDiscreteUpdateEvent(h, 0.0, self._update)

    def _update(self, context: Context, values: DiscreteValues) -> None:
        state = context.get_discrete_state()
        predicted = replay_step(
            values.get_mutable_value(2).reshape(-1, SLOT_SIZE),  # comes as a copy of the state's, is changed in place
            state.value(0),
            state.value(1),
            tick_of(context.get_time(), self._h),
            self._measurement.Eval(context),
            self._stamps.Eval(context),
            self._h,
            self._control.Eval(context) - self._hover,
            self._reference.Eval(context),
            *self._model,
        )
        values.set_value(0, predicted[:N_XBAR])
        values.set_value(1, predicted[N_XBAR:])
