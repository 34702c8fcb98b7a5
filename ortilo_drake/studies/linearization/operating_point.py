"""Operating points of the linearisations: state and control, the rotors' lag, the filter's gain.

Rotors. A rotor's lag is (commanded - speed) / tau with one tau speeding up and another slowing down: at error 0 it has
a derivative to either side and none in between, and the motion nearby follows one or the other, rotor by rotor. So the
linearisation is that of a vehicle with one of the two for all rotors, 'up' or 'down'. 'down', the slower, is what
is taken unless asked: it leaves the larger phase lag, and a loop is to be stable with either.
"""

import numpy as np
from pydrake.trajectories import Trajectory

from ortilo_drake.model.signals import N_U, N_X, N_Y
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.model.vehicle import GRAVITY, Vehicle
from ortilo_drake.scenario import Scenario
from ortilo_drake.studies.linearization.observability import check_sensors
from ortilo_drake.studies.loop.hover_loop import arrivals_of, hover_loop, steady_predictor

LAGS = ("up", "down")
# A position sensor whose covariance comes with each fix: the paper's printed variances stand in [m^2].
PRINTED_V = {"uwb": (0.05, 0.05, 0.05), "camera": (0.08, 0.08, 0.08)}


def reference_at(trajectory: Trajectory, t: float) -> np.ndarray:
    """Return r, r_dot, r_ddot (9) of a planned path at time t [s]."""
    return np.concatenate([trajectory.value(t)[:, 0]] + [trajectory.EvalDerivative(t, k)[:, 0] for k in (1, 2)])


def operating_point(
    vehicle: Vehicle, kinematics: str, reference: np.ndarray, yaw: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return x (12) and u (4) with which the vehicle accelerates as planned, its angular rates 0.

    The thrust carries a + g z: f_T = m |a + g z_W|, and the body's z axis points along it; at heading yaw,
    R_z(-yaw) z_B = [cos phi sin theta, -sin phi, cos phi cos theta]. The model linearised at hover ('linear') has
    x_ddot = g theta, y_ddot = -g phi and f_T = m (g + a_z) in place of that.

    Args:
        vehicle: its mass.
        kinematics: see world/vehicle/quadrotor.py.
        reference: r, r_dot, r_ddot (9).
        yaw: heading [rad].
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


def frozen_gain(scenario: Scenario, V: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Return K (12 x 9) of the steady predictor with every sensor of the scenario in every tick, and delta (3).

    Args:
        scenario: the scenario.
        V: covariance of the measurements (9 x 9); by default the scenario's, or PRINTED_V where it comes with each fix.

    Raises:
        InputError: naming the modes that the sensors do not see.
    """
    check_sensors(scenario)
    loop, delta, believed = hover_loop(scenario), arrivals_of(scenario.sensors), scenario.estimator.V
    if V is None:
        V = np.diag([*(believed.uwb or PRINTED_V["uwb"]), *(believed.camera or PRINTED_V["camera"]), *believed.imu])
    rows = np.repeat(delta, 3) > 0.0
    K = np.zeros((N_X, N_Y))
    K[:, rows], _ = steady_predictor(loop.Phi, loop.C[rows], loop.W, V[np.ix_(rows, rows)])
    return K, delta


def heading_ahead(scenario: Scenario) -> Scenario:
    """Return the scenario at yaw 0, where the closed forms are."""
    return scenario.model_copy(update={"servo": scenario.servo.model_copy(update={"yaw": 0.0})})
