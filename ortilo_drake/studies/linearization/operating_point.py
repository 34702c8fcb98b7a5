"""Operating points of the linearisations: state and control, the rotors' lag, the filter's gain.

Rotors. A rotor's lag is (commanded - speed) / tau, with one tau for speeding up and another for slowing down. At error
0 it therefore has two one-sided derivatives and no derivative. The linearisation takes one tau for all rotors, 'up' or
'down'. The default is 'down', the slower one: it has the larger phase lag. A loop must be stable with either.
"""

import numpy as np
from pydrake.trajectories import Trajectory
from scipy.linalg import block_diag

from ortilo_drake.model.hover import discretize, hover_A, hover_B
from ortilo_drake.model.signals import N_U, N_X
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.model.vehicle import GRAVITY, Vehicle
from ortilo_drake.scenario import Scenario
from ortilo_drake.scenario.belief import measurement_of
from ortilo_drake.sensors.described import covariance_at, described_per_tick
from ortilo_drake.studies.loop.hover_loop import arrivals_of, filter_V, hover_loop, steady_predictor, why_no_gain
from ortilo_drake.theory.modes.modes import check_detectable, tick_scaling

LAGS = ("up", "down")


def reference_at(trajectory: Trajectory, t: float) -> np.ndarray:
    """Return r, r_dot, r_ddot (9) of a planned path at time t [s]."""
    return np.concatenate([trajectory.value(t)[:, 0]] + [trajectory.EvalDerivative(t, k)[:, 0] for k in (1, 2)])


def operating_point(
    vehicle: Vehicle, kinematics: str, reference: np.ndarray, yaw: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return x (12) and u (4) of a vehicle that follows a reference r, r_dot, r_ddot (9), with its body rates 0.

    The thrust carries a + g z: f_T = m |a + g z_W|, and the body's z axis points along it; at heading yaw [rad],
    R_z(-yaw) z_B = [cos phi sin theta, -sin phi, cos phi cos theta]. The model linearised at hover (kinematics
    'linear') has x_ddot = g theta, y_ddot = -g phi and f_T = m (g + a_z) instead.
    """
    a = reference[6:9]
    x, u = np.zeros(N_X), np.zeros(N_U)
    x[0:3], x[5], x[6:9] = reference[0:3], yaw, reference[3:6]
    if kinematics == "linear":
        x[3], x[4], u[0] = -a[1] / GRAVITY, a[0] / GRAVITY, vehicle.mass * (GRAVITY + a[2])
        return x, u
    thrust = a + [0.0, 0.0, GRAVITY]
    along = thrust[0] * np.cos(yaw) + thrust[1] * np.sin(yaw)
    across = -thrust[0] * np.sin(yaw) + thrust[1] * np.cos(yaw)
    x[3] = -np.arcsin(across / np.linalg.norm(thrust))
    x[4] = np.arctan2(along, thrust[2])
    u[0] = vehicle.mass * np.linalg.norm(thrust)
    return x, u


def with_one_lag(vehicle: Vehicle, lag: str) -> Vehicle:
    """Return the vehicle with the time constant of 'up' or 'down' in both directions; InputError if neither."""
    if lag not in LAGS:
        raise InputError(f"lag: {lag!r}: must be one of {', '.join(LAGS)}")
    tau = vehicle.rotor_time_constant[LAGS.index(lag)]
    return vehicle.model_copy(update={"rotor_time_constant": (tau, tau)})


def rows_of(sensors: tuple[str, ...]) -> np.ndarray:
    """Return the rows of C (m x 12) of the sensors named, in the order of the measurement."""
    measurement = measurement_of(sensors)
    return measurement.layout.C[measurement.by_row(np.isin(measurement.sensors, sensors))]


def check_sensors(scenario: Scenario) -> None:
    """Raise InputError naming the modes that the scenario's sensors leave unseen: all modes if it has no sensor."""
    Phi, _ = discretize(hover_A(scenario.yaw), hover_B(scenario.vehicle), scenario.h)
    what = f"sensors: [{', '.join(scenario.sensors)}]"
    check_detectable(Phi, rows_of(scenario.sensors), what, scale=tick_scaling(scenario.h))


def believed_V(scenario: Scenario) -> np.ndarray:
    """Return the covariance of the measurements (p x p) as the scenario gives it.

    For a sensor whose covariance comes with each fix it is the stated one, else the one of its noise in the middle of
    the room; InputError if the sensor gives nothing there.
    """
    room, blocks = scenario.load_room(), []
    middle = np.zeros(N_X)
    middle[:3] = (np.array(room.interior.min) + np.array(room.interior.max)) / 2.0
    for name in scenario.measurement.sensors:
        sensor = described_per_tick(name, scenario)
        V = sensor.V(scenario)
        if V is None and sensor.nominal_variances is not None:
            V = np.diag(sensor.nominal_variances[: len(scenario.measurement.C_of(name))])
        if V is None:
            V = covariance_at(name, scenario, room, middle)
        if V is None:
            raise InputError(f"sensors: {name}: gives no measurement in the middle of the room, {middle[:3].tolist()}")
        blocks.append(V)
    return block_diag(*blocks)


def frozen_gain(scenario: Scenario, V: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Return K (N x p) of the steady predictor with every sensor of the scenario in every tick, and delta (s).

    Both are over the rows that the filter gets, see hover_loop.filter_measurement. V is the covariance of the
    measurements (p x p), by default what the scenario believes, see believed_V. InputError naming the modes that the
    sensors do not see, or the states that never change.
    """
    check_sensors(scenario)
    loop = hover_loop(scenario)
    if why := why_no_gain(loop):
        raise InputError(why)
    delta = arrivals_of(scenario.sensors, loop.measurement)
    V = filter_V(scenario, believed_V(scenario) if V is None else V)
    rows = loop.measurement.by_row(delta) > 0.0
    K = np.zeros((len(loop.names), len(rows)))
    K[:, rows], _ = steady_predictor(loop.Phi, loop.C[rows], loop.W, V[np.ix_(rows, rows)])
    return K, delta


def heading_ahead(scenario: Scenario) -> Scenario:
    """Return the scenario at yaw 0, for which the closed forms hold."""
    return scenario.model_copy(update={"servo": scenario.servo.model_copy(update={"yaw": 0.0})})
