"""The closed forms of every part's matrices at hover and yaw 0, and their distance from Drake's."""

import numpy as np

from ortilo_drake.model.hover import discretize, hover_A, hover_B
from ortilo_drake.model.signals import N_I, N_U, N_X, N_XBAR, REFERENCE_SIZE
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.model.vehicle import GRAVITY, Vehicle, mixing_inverse, mixing_matrix
from ortilo_drake.onboard.estimator.extra_states import D
from ortilo_drake.scenario import Scenario
from ortilo_drake.studies.linearization.linearize import PARTS, linearize
from ortilo_drake.studies.linearization.operating_point import LAGS, frozen_gain, heading_ahead, with_one_lag
from ortilo_drake.studies.loop.hover_loop import closed_loop_matrix, hover_loop, loop_gain

DIFFERENTIATED = tuple(part for part in PARTS if part != "estimator")  # that one's matrices are written down


def rotors_and_plant_matrices(vehicle: Vehicle, lag: str) -> tuple[np.ndarray, np.ndarray]:
    """Return A (12 + n square) and B (12 + n x 4) of [x; W] at hover in closed form, of n rotors with lag up or down.

    The wrench is M [W^2], the commanded speed sqrt(M^+ u), W_0 the speeds at hover. With 2 W_0 dW = M^+ du:
        x_dot = A x + B (M 2 W_0) W,   W_dot = (M^+ u / (2 W_0) - W) / tau
    """
    tau = with_one_lag(vehicle, lag).rotor_time_constant[0]
    n, slope = vehicle.rotor_count, 2.0 * vehicle.hover_rotor_speeds
    A, B = np.zeros((N_X + n, N_X + n)), np.zeros((N_X + n, N_U))
    A[:N_X, :N_X], A[:N_X, N_X:] = hover_A(), hover_B(vehicle) @ (mixing_matrix(vehicle) * slope)
    A[N_X:, N_X:] = -np.eye(n) / tau
    B[N_X:] = mixing_inverse(vehicle) / slope[:, np.newaxis] / tau
    return A, B


def servo_matrix(scenario: Scenario) -> np.ndarray:
    """Return D (4 x 24, or more) of the servo at yaw 0 in closed form.

    u = -L [xhat - x_ref; i] + u_ff with x_ref = [r, -r_ddot_y / g, r_ddot_x / g, 0, r_dot, 0], u_ff = m r_ddot_z; in
    the paper's form without x_ref and u_ff. A force (3) that it is told, and true velocities (6) that it is given, have
    their columns behind those of estimate and reference.
    """
    loop = hover_loop(scenario)
    by_reference = np.zeros((N_X, REFERENCE_SIZE))
    by_reference[0:3, 0:3] = by_reference[6:9, 3:6] = np.eye(3)
    by_reference[3, 7], by_reference[4, 6] = -1.0 / GRAVITY, 1.0 / GRAVITY
    feed = loop.L[:, :N_X] @ by_reference
    feed[0, 8] += scenario.vehicle.mass
    if scenario.servo.form == "paper":
        feed[:] = 0.0
    L = loop_gain(loop)
    by_estimate, integral = L[:, loop.hats], L[:, loop.hats.stop :]
    told = [loop.names.index(d) for d in D if d in loop.names]
    true = L[:, list(loop.true_states)]
    return np.hstack([-by_estimate[:, :N_X], -integral, feed, -by_estimate[:, told], -true])


def closed_loop_input(scenario: Scenario, delta: np.ndarray) -> np.ndarray:
    """Return B (27 x 9), from the reference to [x; xhat; i], beside hover_loop.closed_loop_matrix, at yaw 0."""
    loop = hover_loop(scenario)
    by_control = np.vstack([loop.Gamma[list(loop.world)], loop.Gamma, np.zeros((N_I, N_U))])
    B = by_control @ servo_matrix(scenario)[:, N_XBAR : N_XBAR + REFERENCE_SIZE]
    if loop.integrator != "hold" or (delta * loop.measurement.layout.is_position).any():
        B[loop.hats.stop :, :N_I] += np.eye(N_I)
    return B


def closed_form(scenario: Scenario, part: str, lag: str = "down") -> tuple[np.ndarray, ...]:
    """Return A, B, C, D of a part at hover and yaw 0 without Drake, as linearize orders them."""
    if part == "servo":
        D = servo_matrix(scenario)
        return np.zeros((0, 0)), np.zeros((0, D.shape[1])), np.zeros((N_U, 0)), D
    if part == "closed_loop":
        K, delta = frozen_gain(scenario)
        A, B = closed_loop_matrix(hover_loop(scenario), K, delta), closed_loop_input(scenario, delta)
    elif part == "rotors_and_plant":
        A, B = rotors_and_plant_matrices(scenario.vehicle, lag)
    elif part == "plant":
        A, B = hover_A(), hover_B(scenario.vehicle)
    elif part == "sampled_plant":
        A, B = discretize(hover_A(), hover_B(scenario.vehicle), scenario.h)
    else:
        raise InputError(f"part: {part!r}: must be one of {', '.join(DIFFERENTIATED)}")
    return A, B, np.eye(N_X, len(A)), np.zeros((N_X, B.shape[1]))


def agreement(scenario: Scenario) -> dict[str, dict[str, float]]:
    """Return the largest difference |Drake - closed form| in each matrix of each part at hover and yaw 0."""
    level = heading_ahead(scenario)
    figures = {}
    for part in DIFFERENTIATED:
        for lag in LAGS if part == "rotors_and_plant" else ("down",):
            by_drake, by_hand = linearize(level, part, lag=lag), closed_form(level, part, lag)
            name = f"{part} ({lag})" if part == "rotors_and_plant" else part
            figures[name] = {
                matrix: float(np.max(np.abs(ours - its), initial=0.0))
                for matrix, ours, its in zip("ABCD", by_drake, by_hand, strict=False)
            }
    return figures
