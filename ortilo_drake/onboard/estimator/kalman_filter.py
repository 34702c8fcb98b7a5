"""The intermittent Kalman filter as a system."""

import numpy as np
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

from ortilo_drake.model.hover import discretize, disturbance_W, hover_A, hover_B
from ortilo_drake.model.signals import MEASUREMENT_SIZE, N_U, N_XBAR, REFERENCE_SIZE
from ortilo_drake.model.vehicle import Vehicle
from ortilo_drake.onboard.estimator.intermittent_filter import INTEGRATORS, filter_step
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


class KalmanFilter(LeafSystem):
    """The one-step predictor xhat_{k|k-1} of xbar = [x; i] and its covariance P_k.

    Ports:
        measurement (39): y, delta and V2 of this tick, see model/signals.py.
        control (4): u_k, f_T absolute.
        reference (9): r and its derivatives; r drives the integrator.
        estimate (15, output): xhat_{k|k-1}.
        covariance (225, output): P_k row by row.

    Both outputs are discrete states and depend on no input within a tick. Equations: intermittent_filter.py.

    Args:
        settings: W and the initial covariance.
        vehicle: mass and inertia of the model.
        integrator: 'literal', 'hold' or 'estimate': what the last three states integrate.
        xbar_0: initial estimate (15).
        h: tick [s].
    """

    def __init__(self, settings: FilterSettings, vehicle: Vehicle, integrator: str, xbar_0: np.ndarray, h: float):
        super().__init__()
        self.set_name("kalman_filter")
        self._Phi, self._Gamma = discretize(hover_A(), hover_B(vehicle), h)
        self._W = process_noise(settings, vehicle, h)
        self._integrator = INTEGRATORS[integrator]
        self._hover = np.array([vehicle.hover_thrust, 0.0, 0.0, 0.0])
        self._measurement = self.DeclareVectorInputPort("measurement", MEASUREMENT_SIZE)
        self._control = self.DeclareVectorInputPort("control", N_U)
        self._reference = self.DeclareVectorInputPort("reference", REFERENCE_SIZE)
        xhat = self.DeclareDiscreteState(xbar_0)
        P = self.DeclareDiscreteState(initial_covariance(settings).ravel())
        self.DeclareStateOutputPort("estimate", xhat)
        self.DeclareStateOutputPort("covariance", P)
        self.DeclarePeriodicDiscreteUpdateEvent(h, 0.0, self._update)

    def _update(self, context: Context, values: DiscreteValues) -> None:
        state = context.get_discrete_state()
        predicted = filter_step(
            state.value(0),
            state.value(1),
            self._measurement.Eval(context),
            self._control.Eval(context) - self._hover,
            self._reference.Eval(context),
            self._Phi,
            self._Gamma,
            self._W,
            self._integrator,
        )
        values.set_value(0, predicted[:N_XBAR])
        values.set_value(1, predicted[N_XBAR:])
