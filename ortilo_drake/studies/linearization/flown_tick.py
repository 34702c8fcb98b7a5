"""The matrix of one tick of the flying diagram, by central differences, compared with the closed form."""

from typing import Any, NamedTuple

import numpy as np
from pydrake.systems.analysis import Simulator

from ortilo_drake.diagrams.closed_loop import make_closed_loop
from ortilo_drake.model.signals import N_X, N_XBAR
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.estimator.filter_loops import filter_gain
from ortilo_drake.onboard.estimator.intermittent_filter import INTEGRATORS
from ortilo_drake.onboard.planner.planned import planned, start_of
from ortilo_drake.scenario import ConstantNoise, Disturbance, HoverPlanner, Imu, Link, Scenario, Uwb, World
from ortilo_drake.studies.linearization.operating_point import heading_ahead
from ortilo_drake.studies.loop.hover_loop import N_LOOP, closed_loop_matrix, hover_loop


class FlownTick(NamedTuple):
    """The matrix of one tick of the flying diagram, and the closed form.

    Attributes:
        A: [x; xhat; i]_k -> [x; xhat; i]_{k+1} by differences (27 x 27).
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


def difference_closed_loop(scenario: Scenario, tick: int = 900, step: float = 1e-5) -> FlownTick:
    """Return the matrix of a tick of the flying closed loop (diagrams/closed_loop.py), by central differences.

    Until that tick the loop hovers without noise (see without_noise), with ranging, multilateration, imu, handler and
    filter in place. Then each state of vehicle and estimate is moved in the Context, and the tick's update is read.

    Args:
        scenario: the scenario.
        tick: k, late enough for a steady gain (gain_change says how steady it is) and at least a period of the
            sensors; the arrivals in it decide which matrix it is.
        step: how far each state is moved.
    """
    ideal = without_noise(scenario)
    h, period = ideal.h, int(np.lcm(ideal.every("uwb"), ideal.every("imu")))
    if tick < period:
        raise InputError(f"tick: {tick}: must be at least {period}, the period of the sensors")
    diagram = make_closed_loop(ideal)
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    diagram.SetHovering(context)
    onboard, world = diagram.GetSubsystemByName("onboard"), diagram.GetSubsystemByName("world")
    plant = world.GetSubsystemByName("quadrotor")
    kalman = onboard.GetSubsystemByName("estimator").GetSubsystemByName("kalman_filter")
    its_plant, its_kalman = (system.GetMyMutableContextFromRoot(context) for system in (plant, kalman))
    simulator.AdvanceTo(max(tick - period - 0.5, 0.0) * h)
    P_before = its_kalman.get_discrete_state(0).value()[N_XBAR:].copy()
    simulator.AdvanceTo((tick - 0.5) * h)
    context.SetTime(tick * h)  # nothing changes between two ticks
    P = its_kalman.get_discrete_state(0).value()[N_XBAR:].copy()

    def after(z: np.ndarray) -> np.ndarray:
        its_plant.SetDiscreteState(z[:N_X])
        its_kalman.SetDiscreteState(np.concatenate([z[N_X:], P]))
        x = plant.EvalUniquePeriodicDiscreteUpdate(its_plant).value().copy()
        return np.concatenate([x, kalman.EvalUniquePeriodicDiscreteUpdate(its_kalman).value(0)[:N_XBAR]])

    z = np.concatenate([its_plant.get_discrete_state().value(), its_kalman.get_discrete_state(0).value()[:N_XBAR]])
    its_onboard = onboard.GetMyContextFromRoot(context)
    delta, V2 = (onboard.GetOutputPort(name).Eval(its_onboard).copy() for name in ("delta", "V2"))
    A = np.column_stack([(after(z + dz) - after(z - dz)) / (2.0 * step) for dz in step * np.eye(N_LOOP)])
    loop = hover_loop(ideal)
    integrator = INTEGRATORS[ideal.estimator.integrator]
    K = filter_gain(P.reshape(N_XBAR, N_XBAR), delta, V2, loop.Phi, integrator, ideal.measurement.layout)[:N_X]
    expected = closed_loop_matrix(loop, K, delta)
    return FlownTick(A, expected, K, delta, float(np.max(np.abs(P - P_before)) / np.max(np.abs(P))))
