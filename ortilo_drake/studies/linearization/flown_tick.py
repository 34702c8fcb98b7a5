"""The matrix of one tick of the flying diagram, by Drake's AutoDiffXd, compared with the closed form."""

from typing import Any, NamedTuple

import numpy as np
from pydrake.autodiffutils import ExtractGradient, ExtractValue, InitializeAutoDiff
from pydrake.systems.analysis import Simulator

from ortilo_drake.diagrams.closed_loop import make_closed_loop
from ortilo_drake.model.signals import N_X, N_XBAR
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.estimator.filter_loops import filter_gain
from ortilo_drake.onboard.estimator.intermittent_filter import INTEGRATORS
from ortilo_drake.onboard.planner.planned import planned, start_of
from ortilo_drake.scenario import ConstantNoise, Disturbance, HoverPlanner, Imu, Link, Scenario, Uwb, World
from ortilo_drake.studies.linearization.operating_point import heading_ahead
from ortilo_drake.studies.loop.hover_loop import closed_loop_matrix, hover_loop


class FlownTick(NamedTuple):
    """The matrix of one tick of the flying diagram, and the closed form.

    Attributes:
        A: [x; xhat; i]_k -> [x; xhat; i]_{k+1} (27 x 27).
        expected: closed_loop_matrix with the gain of that tick (27 x 27).
        K: the filter's gain in that tick (12 x 9).
        delta: the arrivals in it (3).
        gain_change: change of P over a period of the sensors, relative to its largest entry.
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


def without_noise(scenario: Scenario) -> Scenario:
    """Return the scenario hovering on the linear vehicle with exact uwb and imu, no other sensor, and no loss.

    A faster imu sends one sample a tick here: the mean of a tick's samples follows the closed form to first order only.
    """
    imu_rate = None if scenario.samples("imu") > 1 else scenario.imu.link.rate
    start = tuple(start_of(planned(scenario)).tolist())
    changes: dict[str, Any] = {
        "sensors": ("uwb", "imu"),
        "world": World(kinematics="linear", disturbance=Disturbance(force_sd=0.0, torque_sd=0.0)),
        "uwb": Uwb(noise=ConstantNoise(kind="constant", sd=0.0), link=Link(rate=scenario.uwb.link.rate)),
        "imu": Imu(angle_sd=0.0, rate_sd=0.0, specific_force_sd=0.0, link=Link(rate=imu_rate)),
        "command_link": type(scenario.command_link)(),
        "planner": HoverPlanner(kind="hover", point=start),
    }
    return heading_ahead(scenario).model_copy(update=changes)


def differentiate_closed_loop(scenario: Scenario, tick: int = 900) -> FlownTick:
    """Return the matrix of a tick of the flying closed loop (diagrams/closed_loop.py).

    Until that tick the loop hovers without noise (see without_noise), with ranging, multilateration, imu, handler and
    filter in place. Then the whole diagram is converted to AutoDiffXd, and the tick's update differentiated by the
    states of vehicle and estimate.

    Args:
        scenario: the scenario.
        tick: k, late enough for a steady gain (gain_change says how steady it is) and at least a period of the
            sensors; the arrivals in it decide which matrix it is.

    Raises:
        InputError: if the tick is too early, or the scenario's filter has states beside [x; i].
    """
    ideal = without_noise(scenario)
    h, period = ideal.h, int(np.lcm(ideal.every("uwb"), ideal.every("imu")))
    if tick < period:
        raise InputError(f"tick: {tick}: must be at least {period}, the period of the sensors")
    diagram = make_closed_loop(ideal)
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    diagram.SetHovering(context)
    kalman = _plant_and_filter(diagram)[1]
    belief = kalman.GetMyContextFromRoot(context).get_discrete_state(0)
    simulator.AdvanceTo(max(tick - period - 0.5, 0.0) * h)
    P_before = belief.value()[N_XBAR:].copy()
    simulator.AdvanceTo((tick - 0.5) * h)
    context.SetTime(tick * h)  # nothing changes between two ticks
    P = kalman.GetMyContextFromRoot(context).get_discrete_state(0).value()[N_XBAR:].copy()

    onboard = diagram.GetSubsystemByName("onboard")
    delta, V2 = (onboard.GetOutputPort(name).Eval(onboard.GetMyContextFromRoot(context)) for name in ("delta", "V2"))
    loop = hover_loop(ideal)
    integrator = INTEGRATORS[ideal.estimator.integrator]
    K = filter_gain(P.reshape(N_XBAR, N_XBAR), delta, V2, loop.Phi, integrator, ideal.measurement.layout)[:N_X]
    expected = closed_loop_matrix(loop, K, delta)
    gain_change = float(np.max(np.abs(P - P_before)) / np.max(np.abs(P)))
    return FlownTick(_matrix_of_tick(diagram, context), expected, K, delta, gain_change)


def _plant_and_filter(diagram: Any) -> tuple[Any, Any]:
    """Return the plant and the Kalman filter of a closed loop of any scalar type."""
    onboard, world = diagram.GetSubsystemByName("onboard"), diagram.GetSubsystemByName("world")
    kalman = onboard.GetSubsystemByName("estimator").GetSubsystemByName("kalman_filter")
    return world.GetSubsystemByName("quadrotor"), kalman


def _matrix_of_tick(diagram: Any, context: Any) -> np.ndarray:
    """Return [x; xhat; i]_k -> [x; xhat; i]_{k+1} (27 x 27) of a closed loop at the tick of a context."""
    diagram_ad = diagram.ToAutoDiffXd()
    context_ad = diagram_ad.CreateDefaultContext()
    context_ad.SetTimeStateAndParametersFrom(context)
    systems = _plant_and_filter(diagram_ad)
    contexts = [system.GetMyMutableContextFromRoot(context_ad) for system in systems]
    states = [ExtractValue(its.get_discrete_state(0).CopyToVector()[:, None])[:, 0] for its in contexts]
    z: np.ndarray = InitializeAutoDiff(np.concatenate([states[0], states[1][:N_XBAR]])[:, None])[:, 0]
    contexts[0].SetDiscreteState(z[:N_X])
    contexts[1].SetDiscreteState(np.concatenate([z[N_X:], states[1][N_XBAR:]]))
    after = [system.EvalUniquePeriodicDiscreteUpdate(its) for system, its in zip(systems, contexts, strict=True)]
    rows = np.concatenate([after[0].get_vector(0).CopyToVector(), after[1].get_vector(0).CopyToVector()[:N_XBAR]])
    return np.asarray(ExtractGradient(rows[:, None]))
