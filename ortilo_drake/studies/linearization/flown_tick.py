"""The matrix of one tick of the flying diagram, by Drake's AutoDiffXd, compared with the closed form."""

from typing import Any, NamedTuple

import numpy as np
from pydrake.autodiffutils import ExtractGradient, ExtractValue, InitializeAutoDiff
from pydrake.systems.analysis import Simulator

from ortilo_drake.diagrams.closed_loop import make_closed_loop
from ortilo_drake.model.signals import N_I, N_U, N_X
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.estimator.extra_states import IMU_ROWS
from ortilo_drake.onboard.estimator.intermittent_filter import INTEGRATORS, filter_gain
from ortilo_drake.onboard.planner.planned import planned, start_of
from ortilo_drake.scenario import ConstantNoise, Disturbance, HoverPlanner, Imu, Link, Scenario, Truth, Uwb, World
from ortilo_drake.studies.linearization.operating_point import heading_ahead
from ortilo_drake.studies.loop.hover_loop import closed_loop_matrix, filter_V, hover_loop


class FlownTick(NamedTuple):
    """The matrix of one tick of the flying diagram, and the closed form.

    A takes [x; xhat; i]_k to [x; xhat; i]_{k+1} (27 x 27, or more with a filter that has more states), expected is
    closed_loop_matrix with the filter's gain K (N x p) and the arrivals delta (s) of that tick, and gain_change that of
    P over a period of the sensors, relative to its largest entry.
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
    """Return the scenario hovering on the linear vehicle as believed, with exact uwb and imu, no other sensor, no loss.

    The rotors' drag stays.

    No message is late, so 'ignore' does what any estimator.delay would. A faster imu sends one sample a tick here: the
    mean of a tick's samples follows the closed form to first order only. No sensor counts as stuck: without noise
    all say the same again and again. Nothing is learned of survey and noise, which would change P within the tick.
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
    states of vehicle and estimate. The tick is to be late enough for a steady gain (gain_change says how steady it is);
    the arrivals in it decide which matrix it is. InputError if the tick is within the first period of the sensors.
    """
    ideal = without_noise(scenario)
    h, period = ideal.h, int(np.lcm.reduce([ideal.every(sensor) for sensor in ideal.sensors]))
    if tick < period:
        raise InputError(f"tick: {tick}: must be at least {period}, the period of the sensors")
    diagram = make_closed_loop(ideal)
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    diagram.SetHovering(context)
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
    """Return plant, Kalman filter and what the body felt last, of a closed loop of any scalar type."""
    onboard, world = diagram.GetSubsystemByName("onboard"), diagram.GetSubsystemByName("world")
    return world.GetSubsystemByName("plant"), onboard.GetSubsystemByName("filter"), world.GetSubsystemByName("felt")


def _matrix_of_tick(diagram: Any, context: Any, world: int, n: int) -> np.ndarray:
    """Return [x; xhat; i]_k -> [x; xhat; i]_{k+1} of a closed loop at a context's tick, x of 12 or 15 numbers.

    The force f of the step just flown, where x is [x; f], is what the body felt: thrust less hover lift, and gust.
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
