"""The flying loop at hover as matrices. All linear studies use these.

All values are per tick of h, as deviations from hover. The state of the whole loop is [x; xhat; i] (27): the vehicle,
the filter's prediction of it, and the integral of the position error.
"""

from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_discrete_are

from ortilo_drake.model.hover import discretize, hover_A, hover_B
from ortilo_drake.model.measurement import Measurement
from ortilo_drake.model.parts import measurement_of
from ortilo_drake.model.signals import N_I, N_U, N_X, N_XBAR
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.estimator.filter_model import process_noise
from ortilo_drake.onboard.servo.lq_gain import servo_gain
from ortilo_drake.scenario import Scenario
from ortilo_drake.theory.margins.loop_response import OpenLoop, closed

N_LOOP = N_X + N_XBAR
VELOCITIES = tuple(range(N_X // 2, N_X))  # numbers of the states that are velocities or Euler rates


class HoverLoop(NamedTuple):
    """The matrices of a scenario's vehicle, filter and servo at hover.

    Attributes:
        Phi: x_{k+1} = Phi x_k + Gamma u_k + w_k (12 x 12).
        Gamma: (12 x 4).
        C: y = C x + v (p x 12).
        W: covariance of w as the filter believes it (12 x 12), of rank 6 where it follows from the disturbance.
        L: servo gain, u = -L [xhat; i], or as loop_gain has it (4 x 15).
        h: tick [s].
        integrator: 'literal', 'hold' or 'estimate'.
        true_states: numbers of the states that the servo gets from the truth in place of the estimate; VELOCITIES in
            the paper's scenarios.
        measurement: the sensors and their rows of C.
    """

    Phi: np.ndarray
    Gamma: np.ndarray
    C: np.ndarray
    W: np.ndarray
    L: np.ndarray
    h: float
    integrator: str
    true_states: tuple[int, ...]
    measurement: Measurement


def check_filter(scenario: Scenario) -> None:
    """Raise an InputError unless the filter's states are the paper's, which is what the linear studies know."""
    force = getattr(scenario.estimator, "force", "none")
    if force != "none":
        raise InputError(
            f"estimator.force: {force}: must be none here: the linear studies know the paper's filter alone"
        )


def hover_loop(scenario: Scenario) -> HoverLoop:
    """Return the loop of a scenario; InputError if it has no servo gain, or if its filter estimates a force."""
    check_filter(scenario)
    Phi, Gamma = discretize(hover_A(), hover_B(scenario.vehicle), scenario.h)
    W = process_noise(scenario.estimator, scenario.vehicle, scenario.h)
    L = servo_gain(scenario.vehicle, scenario.servo.weights, scenario.h)
    true_states = VELOCITIES if scenario.servo.velocities == "truth" else ()
    measurement = scenario.measurement
    integrator = scenario.estimator.integrator
    return HoverLoop(Phi, Gamma, measurement.layout.C, W, L, scenario.h, integrator, true_states, measurement)


def arrivals_of(sensors: tuple[str, ...], measurement: Measurement | None = None) -> np.ndarray:
    """Return delta (s), 1 for each sensor of a measurement that is named; by default of that of the sensors named."""
    measurement = measurement or measurement_of(sensors)
    unknown = set(sensors) - set(measurement.sensors)
    if unknown:
        raise InputError(f"sensors: {', '.join(sorted(unknown))}: must be among {', '.join(measurement.sensors)}")
    return np.array([float(s in sensors) for s in measurement.sensors])


def steady_predictor(Phi: np.ndarray, C: np.ndarray, W: np.ndarray, V: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return K = Phi P C^T (C P C^T + V)^-1 and P, the steady one-step predictor of x.

    P = Phi P Phi^T + W - Phi P C^T (C P C^T + V)^-1 C P Phi^T, the filter's DARE. (Phi, C) must be detectable and V
    positive definite; theory/riccati/riccati.py checks both.
    """
    P = solve_discrete_are(Phi.T, C.T, W, V)
    K = np.linalg.solve(C @ P @ C.T + V, C @ P @ Phi.T).T
    return K, P


def loop_gain(loop: HoverLoop) -> np.ndarray:
    """Return the servo gain on the whole loop's state, u = -L [x; xhat; i] (4 x 27).

    The columns of the true states stand at x, all others at xhat.
    """
    at_xhat, of_integral = loop.L[:, :N_X].copy(), loop.L[:, N_X:]
    at_x = np.zeros_like(at_xhat)
    true = list(loop.true_states)
    at_x[:, true], at_xhat[:, true] = at_xhat[:, true], 0.0
    return np.hstack([at_x, at_xhat, of_integral])


def open_loop(loop: HoverLoop, K: np.ndarray, delta: np.ndarray) -> OpenLoop:
    """Return the loop opened at the plant's input, in a tick with those arrivals, reference 0 and no noise.

    The state is z = [x; xhat; i] (27), the input is a, the control that reaches the plant, and the output is v = L z,
    L of loop_gain. The filter knows the command -v alone:

        x_{k+1}    = Phi x + Gamma a
        xhat_{k+1} = Phi xhat - Gamma v + K Delta C (x - xhat)
        i_{k+1}    = i - E C x, or i - p_hat with the integrator 'estimate'  (paper, equations of servo and filter)

    Where all states are true the integral takes the true position.

    Args:
        loop: the matrices at hover.
        K: predictor gain (12 x p) at full size; columns of sensors that did not arrive are ignored.
        delta: arrivals (s).
    """
    Phi, Gamma, L = loop.Phi, loop.Gamma, loop_gain(loop)
    KDC, EC = K @ loop.measurement.arrival_matrix(delta) @ loop.C, loop.measurement.selection_matrix(delta) @ loop.C
    p, none, eye = np.eye(N_I, N_X), np.zeros((N_I, N_X)), np.eye(N_I)
    no_x, no_i = np.zeros((N_X, N_X)), np.zeros((N_X, N_I))
    if len(loop.true_states) == N_X:
        i_rows = [-p, none, eye]
    elif loop.integrator == "estimate":
        i_rows = [none, -p, eye]
    else:
        i_rows = [-EC, none, eye]
    A = np.block([[Phi, no_x, no_i], [KDC, Phi - KDC, no_i], i_rows])
    A[N_X : 2 * N_X] -= Gamma @ L
    B = np.vstack([Gamma, np.zeros((N_XBAR, N_U))])
    return OpenLoop(A, B, L)


def closed_loop_matrix(loop: HoverLoop, K: np.ndarray, delta: np.ndarray) -> np.ndarray:
    """Return A_cl (27 x 27) of [x; xhat; i] in a tick with those arrivals; arguments as open_loop, closed by a = -v."""
    return closed(open_loop(loop, K, delta))
