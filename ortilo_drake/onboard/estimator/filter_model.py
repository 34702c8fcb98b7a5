"""The filter's model of the vehicle, made from the scenario: the paper's twelve states and any extra states."""

import numpy as np

from ortilo_drake.model.hover import discretize, disturbance_W, hover_A, hover_B, hover_B_d
from ortilo_drake.model.measurement import IMU
from ortilo_drake.model.signals import N_I, N_U, N_X
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.model.vehicle import Vehicle
from ortilo_drake.model.white_noise import USUAL_PERIOD, white_variances
from ortilo_drake.onboard.estimator.at_rest import Rest, zero_accelerometer, zero_gyroscope
from ortilo_drake.onboard.estimator.extra_states import B, C, Extra, names_of
from ortilo_drake.onboard.estimator.intermittent_filter import INTEGRATORS, FilterModel
from ortilo_drake.scenario import Belief, DiagonalW, DisturbanceW
from ortilo_drake.scenario import IntermittentFilter as FilterSettings

IMU_BIASES = tuple(f"bias_{row.name}" for row in IMU)  # of roll, pitch and yaw


def why_no_filter(scenario: Belief) -> str | None:
    """Return why the linear theory does not cover the scenario's estimator, None if it does."""
    if scenario.linear_filter is not None:
        return None
    kind = scenario.estimator.kind
    return f"estimator.kind: {kind}: must be intermittent, or registered with its linear filter at hover"


def filter_of(scenario: Belief) -> FilterSettings:
    """Return the settings of the paper's filter to which the estimator is equal about hover; InputError if none is."""
    if why := why_no_filter(scenario):
        raise InputError(why)
    found = scenario.linear_filter
    assert found is not None
    return found


def process_noise(settings: FilterSettings, vehicle: Vehicle, h: float, yaw: float = 0.0) -> np.ndarray:
    """Return the process noise covariance W (12 x 12) of the scenario's filter for a tick h [s] and a yaw [rad]."""
    W = settings.W
    if isinstance(W, DiagonalW):
        return np.diag(np.repeat([W.position, W.angle, W.velocity, W.rate], 3)) * (h / USUAL_PERIOD)
    return disturbance_W(vehicle, h, *W.sds(h), yaw)


def initial_covariance(
    settings: FilterSettings, extras: tuple[Extra, ...] = (), rest: Rest | None = None, yaw: float = 0.0
) -> np.ndarray:
    """Return P_0 of [x; e; i] (15 x 15 without e): the scenario's variances, and 0 for the integral, which is known.

    A state that follows another one, as the force f of the last step follows d, equals that state before the first
    tick. The imu's biases get their covariance from the rest before take-off, if any. yaw is the heading held [rad].
    """
    variances = [e.walk.initial_sd**2 for e in extras for _ in e.names]
    P = np.diag([*np.repeat(np.square(settings.initial_sd), 3), *variances, 0.0, 0.0, 0.0])
    names = names_of(extras)
    from_ = np.arange(len(P))
    from_[N_X : N_X + len(names)] = [N_X + names.index(name) for e in extras for name in e.follows]
    P = P[np.ix_(from_, from_)]
    V, walks = settings.V, settings.walks
    if rest is not None and B[0] in names:
        beta = [N_X + names.index(name) if name in names else -1 for name in IMU_BIASES]
        variance = rest.variance(white_variances(V.specific_force, rest.period), walks.accelerometer_rate)
        level_rate = settings.biases.level_sd * np.sqrt(2.0 / settings.biases.imu_time)
        level = rest.variance(white_variances(V.imu, rest.period), level_rate)
        zero_accelerometer(P, N_X + names.index(B[0]), beta, variance, level, yaw)
    if rest is not None and C[0] in names:
        variance = rest.variance(white_variances(V.rates, rest.period), walks.gyroscope_rate)
        zero_gyroscope(P, N_X + names.index(C[0]), variance)
    return P


def filter_model(
    settings: FilterSettings, vehicle: Vehicle, integrator: str, h: float, yaw: float = 0.0
) -> FilterModel:
    """Return the model of the paper's filter for the believed vehicle, ticks of h [s] and a heading yaw [rad].

    The integrator is 'literal', 'hold' or 'estimate'.
    """
    Phi, Gamma = discretize(hover_A(yaw), hover_B(vehicle), h)
    W = process_noise(settings, vehicle, h, yaw)
    return FilterModel.of(Phi, Gamma, W, INTEGRATORS[integrator])


def augmented_model(
    settings: FilterSettings, vehicle: Vehicle, integrator: str, h: float, extras: tuple[Extra, ...], yaw: float = 0.0
) -> FilterModel:
    """Return the filter's model of [x; e], see extra_states.py; without extra states, the one of filter_model."""
    model = filter_model(settings, vehicle, integrator, h, yaw)
    if not extras:
        return model
    names = names_of(extras)
    N = N_X + len(names)
    _, Gamma_d = discretize(hover_A(yaw), hover_B_d(vehicle), h)
    Phi, Gamma, W = np.zeros((N, N)), np.zeros((N, N_U)), np.zeros((N, N))
    by_force = np.zeros((N, 6))  # input matrix of the new part of the disturbance's force and torque into [x; e]
    Phi[:N_X, :N_X], Gamma[:N_X], by_force[:N_X] = model.Phi, model.Gamma, Gamma_d
    at = N_X
    for extra in extras:
        own = slice(at, at + len(extra.names))
        Phi[:N_X, own], Gamma[own], by_force[own] = extra.G, extra.Gamma, extra.Gamma_d
        for i, followed in enumerate(extra.follows):
            Phi[at + i, N_X + names.index(followed)] = extra.walk.keeps
            W[at + i, at + i] = extra.walk.step_sd**2
        at = own.stop
    if isinstance(settings.W, DisturbanceW):
        sd = np.repeat(settings.W.sds(h), 3)
        W += by_force @ np.diag(sd**2) @ by_force.T
    W[:N_X, :N_X] = model.W
    Gamma_a = np.zeros((N, N_I))
    Gamma_a[:N_X] = vehicle.mass * Gamma_d[:, :3]
    return FilterModel.of(Phi, Gamma, W, model.integrator, Gamma_a, vehicle.mass, yaw)
