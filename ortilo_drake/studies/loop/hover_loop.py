"""The flying loop at hover as matrices. All linear studies use these.

All values are per tick of h, as deviations from hover. The state of the whole loop is [x; xhat; i] (27): the vehicle,
the filter's prediction of it, and the integral of the position error. With a filter that estimates more, [x; e] (N), it
is [x; f; xhat; ehat; i]: the world has those states of e that control and gusts drive, namely the force f of the step
just flown. The others, lasting force and biases, are zero in the world: the filter allows for errors that are absent.
Only the world has the rotors' drag.
"""

from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag, solve_discrete_are

from ortilo_drake.model.hover import discretize, drag_D, hover_A, hover_B_d
from ortilo_drake.model.measurement import Measurement
from ortilo_drake.model.signals import INTEGRAL_NAMES, N_I, N_U, N_X, STATE_NAMES
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.model.vehicle import GRAVITY, Vehicle
from ortilo_drake.onboard.estimator.extra_states import IMU_ROWS, B, D, F, augmented_rows, extra_states, names_of
from ortilo_drake.onboard.estimator.filter_model import augmented_model, filter_of, why_no_filter
from ortilo_drake.onboard.estimator.imu_rows import imu_variances
from ortilo_drake.onboard.estimator.kalman import predictor_gain
from ortilo_drake.onboard.servo.lq_gain import gain_of, why_no_servo_gain
from ortilo_drake.scenario import LqServo, Scenario
from ortilo_drake.scenario.belief import measurement_of
from ortilo_drake.theory.margins.loop_margins import OpenLoop, closed
from ortilo_drake.theory.modes.modes import tick_scaling

VELOCITIES = tuple(range(N_X // 2, N_X))  # indices of the states that are velocities or Euler rates


class HoverLoop(NamedTuple):
    """The matrices of a scenario's vehicle, filter and servo at hover; N is 12 for the paper's filter."""

    Phi: np.ndarray
    """the filter's model, [x; e]_{k+1} = Phi [x; e]_k + Gamma u_k + w_k (N x N)."""
    Gamma: np.ndarray
    """(N x 4)."""
    C: np.ndarray
    """y = C [x; e] + v (p x N)."""
    W: np.ndarray
    """covariance of w that the filter assumes (N x N), of rank 6 where it follows from the disturbance."""
    L: np.ndarray
    """servo gain, u = -L [xhat; ehat; i], or as in loop_gain (4 x N + 3)."""
    h: float
    """tick [s]."""
    integrator: str
    """'literal', 'hold' or 'estimate'."""
    true_states: tuple[int, ...]
    """indices of the states that the servo gets from the truth in place of the estimate; VELOCITIES in the paper's
    scenarios."""
    measurement: Measurement
    """the sensors and their rows of C."""
    names: tuple[str, ...]
    """names of the filter's states (N)."""
    world: tuple[int, ...]
    """indices of the filter's states that the world has (M)."""
    Phi_world: np.ndarray
    """the world's transition matrix of these states (M x M): Phi, with drag."""

    @property
    def state_names(self) -> tuple[str, ...]:
        """The names of the whole loop's states: the world's, the filter's with a hat, the integrals."""
        return (*(self.names[k] for k in self.world), *(f"{name}_hat" for name in self.names), *INTEGRAL_NAMES)

    @property
    def units(self) -> np.ndarray:
        """Units of the filter's states in which Phi's entries are about 1, see tick_scaling (N)."""
        units = np.concatenate([tick_scaling(self.h), np.ones(len(self.names) - N_X)])
        for j, name in enumerate(self.names[N_X:], N_X):
            drives = np.abs(self.Phi[:N_X, j])
            if drives.any():
                units[j] = np.min(units[:N_X][drives > 0.0] / drives[drives > 0.0])
            elif name in F:
                units[j] = units[self.names.index(D[F.index(name)])]
            elif name in B:
                units[j] = 1.0 / self.h**2
            else:  # a bias has the unit of its row's measurement
                seen = self.C[np.flatnonzero(self.C[:, j])[0], :N_X]
                units[j] = units[np.argmax(np.abs(seen))]
        return units

    @property
    def hats(self) -> slice:
        """The slice of the filter's states in the whole loop's state."""
        return slice(len(self.world), len(self.world) + len(self.names))


def why_no_gain(loop: HoverLoop) -> str | None:
    """Return the reason why a loop's filter settles to no gain; None if it does.

    The covariance of a constant state without noise falls towards 0 for ever, so there is no stabilising solution.
    """
    constant = [
        name
        for name, row, noise in zip(loop.names, loop.Phi - np.eye(len(loop.names)), loop.W, strict=True)
        if not row.any() and not noise.any()
    ]
    if not constant:
        return None
    return f"estimator.walks: {', '.join(constant)} never change: a filter's gain settles where its states have noise"


def filter_measurement(scenario: Scenario) -> Measurement:
    """Return the rows that a scenario's filter gets, over its states, with those of imu_rows.py.

    If the filter has no further states, they are over the vehicle's twelve alone.
    """
    extras = extra_states(filter_of(scenario), scenario.vehicle, scenario.h, scenario.flown_rows, scenario.yaw)
    return augmented_rows(scenario.measurement.rows, extras) if extras else scenario.measurement


def filter_V(scenario: Scenario, V: np.ndarray) -> np.ndarray:
    """Return the noise covariance V of filter_measurement, given that of the scenario's own measurement (p x p)."""
    variances = imu_variances(scenario)
    return V if variances is None else np.asarray(block_diag(V, np.diag(variances)))


def force_gain(L: np.ndarray, vehicle: Vehicle, yaw: float = 0.0) -> np.ndarray:
    """Return L_d (4 x 3) by which the servo counters a disturbance force d, u = -L_d d, under a yaw [rad].

    At yaw 0 the servo aims at the roll d_y / (m g) and the pitch -d_x / (m g); it feeds -d_z forward (lq_servo.py).
    """
    L_d, weight, c, s = np.zeros((N_U, 3)), vehicle.mass * GRAVITY, np.cos(yaw), np.sin(yaw)
    L_d[:, 0], L_d[:, 1] = (c * L[:, 4] + s * L[:, 3]) / weight, (s * L[:, 4] - c * L[:, 3]) / weight
    L_d[0, 2] = 1.0
    return L_d


def over_names(L: np.ndarray, names: tuple[str, ...], vehicle: Vehicle, yaw: float, counters: bool) -> np.ndarray:
    """Return the servo's gain L on [x; i] (4 x 15) as a gain on the states of these names, which include D, and i.

    Under the heading yaw [rad] the servo counters the force D if `counters`, as the LQ servo does.
    """
    L_e = np.zeros((N_U, len(names) - N_X))
    if counters:
        L_e[:, [names.index(d) - N_X for d in D]] = force_gain(L, vehicle, yaw)
    return np.hstack([L[:, :N_X], L_e, L[:, N_X:]])


def why_no_loop(scenario: Scenario) -> str | None:
    """Return the reason why a scenario has no HoverLoop; None if it has one.

    It has one if its estimator is a linear filter, whatever that estimates beside the vehicle's states, and its servo
    has a gain.
    """
    return why_no_filter(scenario) or why_no_servo_gain(scenario)


def hover_loop(scenario: Scenario) -> HoverLoop:
    """Return the loop of a scenario; InputError if its estimator or servo has no matrices, or there is no gain."""
    if why := why_no_loop(scenario):
        raise InputError(why)
    settings, vehicle, h = filter_of(scenario), scenario.vehicle, scenario.h
    extras = extra_states(settings, vehicle, h, scenario.flown_rows, scenario.yaw)
    model = augmented_model(settings, vehicle, settings.integrator, h, extras, scenario.yaw)
    measurement, names = filter_measurement(scenario), (*STATE_NAMES, *names_of(extras))
    L = gain_of(scenario)
    if extras:
        L = over_names(L, names, vehicle, scenario.yaw, isinstance(scenario.servo, LqServo))
    true_states = VELOCITIES if scenario.lends_velocities else ()
    driven = names_of(tuple(e for e in extras if e.Gamma.any() or e.Gamma_d.any()))
    world = tuple(k for k, name in enumerate(names) if k < N_X or name in driven)
    Phi_world = with_drag(model.Phi[np.ix_(world, world)], [names[k] for k in world], scenario)
    return HoverLoop(
        model.Phi, model.Gamma, measurement.layout.C, model.W, L, h, settings.integrator, true_states, measurement,
        names, world, Phi_world,
    )  # fmt: skip


def with_drag(Phi: np.ndarray, names: Sequence[str], scenario: Scenario) -> np.ndarray:
    """Return Phi (M x M) of the states of these names with a scenario's rotor drag, held over the tick."""
    _, Gamma_d = discretize(hover_A(scenario.yaw), hover_B_d(scenario.vehicle), scenario.h)
    drives = np.zeros((len(names), 3))
    drives[:N_X] = Gamma_d[:, :3]
    for axis, name in enumerate(F):
        if name in names:
            drives[names.index(name), axis] = 1.0
    moved = Phi.copy()
    moved[:, 6:9] -= drives @ drag_D(scenario.world.drag, scenario.yaw)
    return moved


def message_of(sensor: str, measurement: Measurement) -> str:
    """Return the sensor whose message brings a sensor's rows: the imu's message brings those of imu_rows.py."""
    return measurement.sensors[measurement.inertial] if sensor in IMU_ROWS else sensor


def arrivals_of(sensors: tuple[str, ...], measurement: Measurement | None = None) -> np.ndarray:
    """Return delta (s), 1 for each named sensor of a measurement; by default the measurement of these sensors alone."""
    measurement = measurement or measurement_of(sensors)
    unknown = set(sensors) - set(measurement.sensors)
    if unknown:
        raise InputError(f"sensors: {', '.join(sorted(unknown))}: must be among {', '.join(measurement.sensors)}")
    return np.array([float(message_of(s, measurement) in sensors) for s in measurement.sensors])


def steady_predictor(Phi: np.ndarray, C: np.ndarray, W: np.ndarray, V: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return K = Phi P C^T (C P C^T + V)^-1 and P, the steady one-step predictor of x.

    P = Phi P Phi^T + W - Phi P C^T (C P C^T + V)^-1 C P Phi^T, the filter's DARE. (Phi, C) must be detectable and V
    positive definite; theory/riccati/riccati.py checks both.
    """
    P = solve_discrete_are(Phi.T, C.T, W, V)
    return predictor_gain(Phi, C, V, P), P


def loop_gain(loop: HoverLoop) -> np.ndarray:
    """Return the servo gain on the whole loop's state, u = -L [x; xhat; i] (4 x 27, or wider).

    The columns of the true states stand at x, all others at xhat.
    """
    N = len(loop.names)
    at_xhat, of_integral = loop.L[:, :N].copy(), loop.L[:, N:]
    at_x = np.zeros((N_U, len(loop.world)))
    true = list(loop.true_states)
    at_x[:, true], at_xhat[:, true] = at_xhat[:, true], 0.0
    return np.hstack([at_x, at_xhat, of_integral])


def open_loop(loop: HoverLoop, K: np.ndarray, delta: np.ndarray) -> OpenLoop:
    """Return the loop opened at the plant's input, in a tick with arrivals delta (s), reference 0 and no noise.

    The state is z = [x; xhat; i] (27), the input is a, the control that reaches the plant, and the output is v = L z,
    with loop_gain's L. The filter knows only the command -v:

        x_{k+1}    = Phi x + Gamma a
        xhat_{k+1} = Phi xhat - Gamma v + K Delta C (x - xhat)
        i_{k+1}    = i - E C x, or i - p_hat with the integrator 'estimate'  (paper, equations of servo and filter)

    If all states are true, the integral takes the true position. If L uses no integral, i stays 0. With a filter that
    estimates more, x stands for the states that the world has, with their rows and columns of Phi, Gamma and C. The
    predictor gain K (N x p) has its full size; columns of sensors that did not arrive are ignored.
    """
    Phi, Gamma, L, world = loop.Phi, loop.Gamma, loop_gain(loop), list(loop.world)
    N, M = len(loop.names), len(world)
    C = loop.C[:, world]
    KD, EC = K @ loop.measurement.arrival_matrix(delta), loop.measurement.selection_matrix(delta) @ C
    eye, none = np.eye(N_I), np.zeros((N_I, N))
    if not loop.L[:, N:].any():
        i_rows = [np.zeros((N_I, M)), none, np.zeros((N_I, N_I))]
    elif len(loop.true_states) == N_X:
        i_rows = [-np.eye(N_I, M), none, eye]
    elif loop.integrator == "estimate":
        i_rows = [np.zeros((N_I, M)), -np.eye(N_I, N), eye]
    else:
        i_rows = [-EC, none, eye]
    x_rows = [loop.Phi_world, np.zeros((M, N)), np.zeros((M, N_I))]
    A = np.block([x_rows, [KD @ C, Phi - KD @ loop.C, np.zeros((N, N_I))], i_rows])
    A[loop.hats] -= Gamma @ L
    B = np.vstack([Gamma[world], np.zeros((N + N_I, N_U))])
    return OpenLoop(A, B, L)


def closed_loop_matrix(loop: HoverLoop, K: np.ndarray, delta: np.ndarray) -> np.ndarray:
    """Return A_cl (27 x 27) of [x; xhat; i] in a tick with these arrivals; arguments as open_loop, closed by a = -v."""
    return closed(open_loop(loop, K, delta))


def sensor_subsets(sensors: tuple[str, ...]) -> dict[str, tuple[str, ...]]:
    """Return every subset of some sensors by name: 'none', then each, then their names joined by '+'."""
    present = [s for s in measurement_of(sensors).sensors if s in sensors]
    return {"+".join(some) or "none": some for k in range(len(present) + 1) for some in combinations(present, k)}


def arrived_rows(
    sensors: tuple[str, ...], V: np.ndarray, measurement: Measurement | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return a mask (p) of the rows of y that these sensors fill, and the part of V (p x p) for those rows.

    The measurement is by default that of the paper's three sensors and of those named. InputError if no sensor is
    named, a name is unknown, or V is not positive definite on these rows.
    """
    V = np.asarray(V, dtype=float)
    measurement = measurement or measurement_of(sensors)
    p = measurement.sizes["y"]
    if V.shape != (p, p):
        raise InputError(f"V: shape {V.shape}: must be ({p}, {p})")
    rows = measurement.by_row(arrivals_of(sensors, measurement)) > 0.0
    if not rows.any():
        raise InputError(f"sensors: none: at least one of {', '.join(measurement.sensors)} must arrive")
    V = V[np.ix_(rows, rows)]
    if not np.isfinite(V).all() or np.linalg.eigvalsh(V)[0] <= 0.0:
        raise InputError("V: must be finite and positive definite")
    return rows, V
