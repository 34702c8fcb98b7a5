"""The closed forms of every part's matrices at hover and yaw 0, and their distance from Drake's.

The matrix of one tick of the flying diagram, by Drake's AutoDiffXd, is compared with its closed form in the same way.
"""

from typing import Any, NamedTuple

import numpy as np
from pydrake.autodiffutils import ExtractGradient, ExtractValue, InitializeAutoDiff
from pydrake.systems.analysis import Simulator

from ortilo_drake.diagrams.closed_loop import make_closed_loop
from ortilo_drake.model.hover import discretize, hover_A, hover_B
from ortilo_drake.model.signals import N_I, N_U, N_X, N_XBAR, REFERENCE_SIZE
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.model.vehicle import GRAVITY, Vehicle, mixing_inverse, mixing_matrix
from ortilo_drake.onboard.estimator.extra_states import IMU_ROWS, D
from ortilo_drake.onboard.estimator.intermittent_filter import INTEGRATORS, filter_gain
from ortilo_drake.onboard.planner.planned import planned, start_of
from ortilo_drake.scenario import ConstantNoise, Disturbance, HoverPlanner, Imu, Link, Scenario, Truth, Uwb, World
from ortilo_drake.studies.linearization.linearize import PARTS, linearize
from ortilo_drake.studies.linearization.operating_point import LAGS, frozen_gain, heading_ahead, with_one_lag
from ortilo_drake.studies.loop.hover_loop import closed_loop_matrix, filter_V, hover_loop, loop_gain

DIFFERENTIATED = tuple(part for part in PARTS if part != "estimator")  # the estimator's matrices are written down


def rotors_and_plant_matrices(vehicle: Vehicle, lag: str) -> tuple[np.ndarray, np.ndarray]:
    """Return A (12 + n square) and B (12 + n x 4) of [x; W] at hover in closed form, n rotors of lag 'up' or 'down'.

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
    the paper's form without x_ref and u_ff. If the servo gets a force (3) or true velocities (6), their columns follow
    those of estimate and reference.
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
    """Return B (27 x 9), from the reference to [x; xhat; i], for hover_loop.closed_loop_matrix, at yaw 0."""
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


class FlownTick(NamedTuple):
    """The matrix of one tick of the flying diagram, and the closed form.

    A takes [x; xhat; i]_k to [x; xhat; i]_{k+1} (27 x 27, or more with a filter that has more states), expected is
    closed_loop_matrix with the filter's gain K (N x p) and the arrivals delta (s) of that tick, and gain_change is the
    largest change of P over a period of the sensors, relative to P's largest entry.
    """

    A: np.ndarray
    expected: np.ndarray
    K: np.ndarray
    delta: np.ndarray
    gain_change: float

    @property
    def largest_difference(self) -> float:
        """The largest |A - expected|."""
        return float(np.max(np.abs(self.A - self.expected)))


def sensors_without_noise(scenario: Scenario) -> tuple[str, str]:
    """Return the sensors of a flight without noise: the first of the position, and the imu."""
    measurement = scenario.measurement
    return measurement.positions[0], measurement.sensors[measurement.inertial]


def without_noise(scenario: Scenario) -> Scenario:
    """Return the scenario at hover with the linear vehicle, no errors, exact uwb and imu, no other sensor, no loss.

    The rotors' drag stays.

    No message is late, so 'ignore' does what any estimator.delay would. A faster imu sends one sample a tick here: the
    mean of a tick's samples follows the closed form to first order only. No sensor counts as stuck, because without
    noise all sensors repeat their values. Nothing is learned of survey and noise, which would change P within the tick.
    """
    robust = scenario.estimator.robust
    imu_rate = None if scenario.imu_samples > 1 else scenario.imu.link.rate
    start = tuple(start_of(planned(scenario)).tolist())
    ranging, inertial = sensors_without_noise(scenario)
    changes: dict[str, Any] = {
        "sensors": (ranging, inertial),
        "world": World(
            kinematics="linear",
            disturbance=Disturbance(force_density=0.0, torque_density=0.0),
            drag=scenario.world.drag,
        ),
        ranging: Uwb(noise=ConstantNoise(kind="constant", sd=0.0), link=Link(rate=scenario.uwb.link.rate)),
        inertial: Imu(angle_density=0.0, rate_density=0.0, specific_force_density=0.0, link=Link(rate=imu_rate)),
        "command_link": type(scenario.command_link)(),
        "planner": HoverPlanner(kind="hover", point=start),
        "estimator": scenario.estimator.model_copy(
            update={"delay": "ignore", "robust": robust and robust.model_copy(update={"stuck": None})}
        ),
        "multilateration": scenario.multilateration.model_copy(update={"bias_bank": None, "noise_scale": None}),
        "truth": Truth(),
    }
    return heading_ahead(scenario).model_copy(update=changes)


def differentiate_closed_loop(scenario: Scenario, tick: int = 900) -> FlownTick:
    """Return the matrix of a tick of the flying closed loop (diagrams/closed_loop.py).

    Until that tick the loop hovers without noise (see without_noise), with ranging, multilateration, imu, handler and
    filter in place. Then the whole diagram is converted to AutoDiffXd, and the tick's update differentiated by the
    states of vehicle and estimate. The tick must be late enough for a steady gain (gain_change says how steady it is);
    the arrivals in it decide which matrix it is. InputError if the tick is within the first period of the sensors.
    """
    ideal = without_noise(scenario)
    h, period = ideal.h, int(np.lcm.reduce([ideal.every(sensor) for sensor in ideal.sensors]))
    if tick < period:
        raise InputError(f"tick: {tick}: must be at least {period}, the period of the sensors")
    diagram = make_closed_loop(ideal)
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    kalman, loop = _systems(diagram)[1], hover_loop(ideal)
    n = len(loop.names) + N_I

    def covariance() -> np.ndarray:
        belief = kalman.GetMyContextFromRoot(context).get_discrete_state_vector().CopyToVector()
        return np.array(belief[n:]).reshape(n, n)

    simulator.AdvanceTo(max(tick - period - 0.5, 0.0) * h)
    P_before = covariance()
    simulator.AdvanceTo((tick - 0.5) * h)
    context.SetTime(tick * h)  # nothing changes between two ticks
    P = covariance()

    onboard = diagram.GetSubsystemByName("onboard")
    delta, V2 = (onboard.GetOutputPort(name).Eval(onboard.GetMyContextFromRoot(context)) for name in ("delta", "V2"))
    own = [sensor for sensor in loop.measurement.sensors if sensor in IMU_ROWS]
    delta = np.append(delta, np.repeat(delta[loop.measurement.inertial], len(own)))
    V = filter_V(ideal, np.zeros((0, 0)))
    V2 = np.append(V2, [V[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] for i in range(len(own))])
    integrator = INTEGRATORS[loop.integrator]
    K = filter_gain(P, delta, V2, loop.Phi, integrator, loop.measurement.layout)[: len(loop.names)]
    expected = closed_loop_matrix(loop, K, delta)
    gain_change = float(np.max(np.abs(P - P_before)) / np.max(np.abs(P)))
    return FlownTick(_matrix_of_tick(diagram, context, len(loop.world), n), expected, K, delta, gain_change)


def _systems(diagram: Any) -> tuple[Any, Any, Any]:
    """Return the plant, the Kalman filter and the last control and disturbance, of a closed loop of any scalar type."""
    onboard, world = diagram.GetSubsystemByName("onboard"), diagram.GetSubsystemByName("world")
    return world.GetSubsystemByName("plant"), onboard.GetSubsystemByName("filter"), world.GetSubsystemByName("felt")


def _matrix_of_tick(diagram: Any, context: Any, world: int, n: int) -> np.ndarray:
    """Return [x; xhat; i]_k -> [x; xhat; i]_{k+1} of a closed loop at a context's tick, x of 12 or 15 numbers.

    The force f of the step just flown, where x is [x; f], is the force on the body: thrust less hover lift, and gust.
    """
    diagram_ad = diagram.ToAutoDiffXd()
    context_ad = diagram_ad.CreateDefaultContext()
    context_ad.SetTimeStateAndParametersFrom(context)
    contexts = [system.GetMyMutableContextFromRoot(context_ad) for system in _systems(diagram_ad)]
    plant, kalman, felt = contexts
    x, belief, values = (
        ExtractValue(its.get_discrete_state_vector().CopyToVector()[:, None])[:, 0] for its in contexts
    )
    gust = values[N_U:]
    force = gust[:3] + [0.0, 0.0, values[0]]
    z: np.ndarray = InitializeAutoDiff(np.concatenate([x, force[: world - N_X], belief[:n]])[:, None])[:, 0]
    plant.SetDiscreteState(z[:N_X])
    kalman.SetDiscreteState(np.concatenate([z[world:], belief[n:]]))
    if world > N_X:
        control = np.concatenate([[z[N_X + 2] - gust[2]], values[1:N_U]])
        felt.SetDiscreteState(np.concatenate([control, z[N_X : N_X + 2], gust[2:]]))
    after = [
        system.EvalUniquePeriodicDiscreteUpdate(its).get_vector(0).CopyToVector()
        for system, its in zip(_systems(diagram_ad), contexts, strict=True)
    ]
    rows = [after[0]]
    if world > N_X:
        control, gust = after[2][:N_U], after[2][N_U:]
        rows.append(np.concatenate([gust[:2], [control[0] + gust[2]]]))
    rows.append(after[1][:n])
    return np.asarray(ExtractGradient(np.concatenate(rows)[:, None]))
