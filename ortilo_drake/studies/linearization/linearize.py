"""Linearisation of the flying diagram's parts by Drake's automatic differentiation; by hand in closed_forms.py.

At rest Drake's Linearize is used, which refuses a point that is no equilibrium; in motion FirstOrderTaylorApproximation
is. Both take systems with one input port and one group of discrete states, and end the Python process on others. The
servo has several ports and the closed loop two groups (vehicle and filter), so these are differentiated here in the
same way, with AutoDiffXd. The estimator needs no differentiation: with its gain frozen it is affine.
"""

from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from pydrake.autodiffutils import ExtractGradient, InitializeAutoDiff
from pydrake.systems.framework import Context, Diagram
from pydrake.systems.primitives import FirstOrderTaylorApproximation, Linearize

from ortilo_drake.diagrams.linear_loop import make_frozen_filter, make_linear_loop, make_rotors_and_plant
from ortilo_drake.diagrams.single_parts import make_lq_servo
from ortilo_drake.model.measurement import Rows
from ortilo_drake.model.signals import CONTROL_NAMES, INTEGRAL_NAMES, N_I, N_X, PAYLOAD, REFERENCE_SIZE, STATE_NAMES
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.model.units import unit_of
from ortilo_drake.model.vehicle import mixing_inverse
from ortilo_drake.onboard.estimator.extra_states import D
from ortilo_drake.onboard.estimator.filter_model import filter_of
from ortilo_drake.onboard.servo.lq_gain import gain_of
from ortilo_drake.onboard.servo.lq_servo import resting_integral
from ortilo_drake.scenario import LqServo, Scenario
from ortilo_drake.studies.linearization.operating_point import frozen_gain, operating_point, with_one_lag
from ortilo_drake.studies.loop.hover_loop import hover_loop, why_no_loop
from ortilo_drake.world.vehicle.quadrotor import QuadrotorPlant_
from ortilo_drake.world.vehicle.rotors import commanded_speeds

PARTS = ("plant", "rotors_and_plant", "sampled_plant", "servo", "estimator", "closed_loop")
REFERENCE_NAMES = tuple(f"r_{axis}{dots}" for dots in ("", "_dot", "_ddot") for axis in "xyz")


class Linearization(NamedTuple):
    """A part near a point: x_dot or x_{k+1} = A x + B u, y = C x + D u, in deviations from the point."""

    A: np.ndarray
    """(n x n)."""
    B: np.ndarray
    """(n x m)."""
    C: np.ndarray
    """(p x n)."""
    D: np.ndarray
    """(p x m)."""
    h: float | None
    """tick [s]; None if continuous or without a state."""
    states: tuple[str, ...]
    """names of the states."""
    inputs: tuple[str, ...]
    """names of the inputs."""
    outputs: tuple[str, ...]
    """names of the outputs."""
    units: dict[str, str]
    """units of all states, inputs and outputs."""

    def __repr__(self) -> str:
        steps = "x_dot" if self.h is None else f"x after a tick of {self.h:.4g} s"
        rows = ("states", self.states), ("inputs", self.inputs), ("outputs", self.outputs)
        lines = [f"  {len(names)} {kind}: {', '.join(names)}" for kind, names in rows]
        return "\n".join([f"Linearization: {steps} = A x + B u, y = C x + D u; frame('A') has names", *lines])

    def frame(self, matrix: str) -> pd.DataFrame:
        """Return 'A', 'B', 'C' or 'D' with the names of its rows and columns."""
        if matrix not in ("A", "B", "C", "D"):
            raise InputError(f"matrix: {matrix!r}: must be one of A, B, C, D")
        rows = self.states if matrix in ("A", "B") else self.outputs
        return pd.DataFrame(getattr(self, matrix), rows, self.states if matrix in ("A", "C") else self.inputs)


def _named(
    system: Any,
    h: float | None,
    states: tuple[str, ...],
    inputs: tuple[str, ...],
    outputs: tuple[str, ...],
    rows: Rows = (),
) -> Linearization:
    A, B, C, D_ = system if isinstance(system, tuple) else (system.A(), system.B(), system.C(), system.D())
    units = {name: unit_of(name, rows) for name in (*states, *inputs, *outputs)}
    return Linearization(A, B, C, D_, h, states, inputs, outputs, units)


def differentiate_tick(diagram: Diagram, context: Context) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return A, B, C, D of one tick of a discrete diagram with one input and one output, by AutoDiffXd.

    The state is the diagram's groups of discrete states one after another. Drake's FirstOrderTaylorApproximation does
    the same for one group.
    """
    diagram_ad = diagram.ToAutoDiffXd()
    context_ad = diagram_ad.CreateDefaultContext()
    context_ad.SetTimeStateAndParametersFrom(context)
    state = context.get_discrete_state()
    groups = [state.value(k) for k in range(state.num_groups())]
    n = sum(map(len, groups))
    point = np.concatenate([*groups, diagram.get_input_port().Eval(context)])
    values: np.ndarray = InitializeAutoDiff(point[:, None])[:, 0]
    *parts, given = np.split(values, np.cumsum([len(group) for group in groups]))
    for k, part in enumerate(parts):
        context_ad.SetDiscreteState(k, part)
    diagram_ad.get_input_port().FixValue(context_ad, given)
    after = diagram_ad.EvalUniquePeriodicDiscreteUpdate(context_ad)
    AB = ExtractGradient(np.concatenate([after.value(k) for k in range(len(groups))])[:, None])
    CD = ExtractGradient(diagram_ad.get_output_port().Eval(context_ad)[:, None])
    return AB[:, :n], AB[:, n:], CD[:, :n], CD[:, n:]


def linearize(
    scenario: Scenario,
    part: str,
    reference: np.ndarray | None = None,
    lag: str = "down",
    frozen: tuple[np.ndarray, np.ndarray] | None = None,
) -> Linearization:
    """Return a part of a scenario's diagram linearised by Drake; part, reference (9) and lag as in api/studies.py.

    The estimator and the closed loop have the filter's gain frozen, K (N x p) and delta (s): by default frozen_gain,
    every sensor in every tick, at the gain that the filter then settles to. A tick in which a slower sensor is not due
    has a delta of its own. The heading is the servo's. InputError if part or lag is unknown, if the servo or the
    estimator asked for is one that has no matrices here (why_no_loop), or if the loop has no gain.
    """
    if part not in PARTS:
        raise InputError(f"part: {part!r}: must be one of {', '.join(PARTS)}")
    if part in ("servo", "estimator", "closed_loop") and (why := why_no_loop(scenario)):
        raise InputError(why)
    if part in ("servo", "closed_loop") and not isinstance(scenario.servo, LqServo):
        raise InputError(f"servo.kind: {scenario.servo.kind}: must be lq: Drake differentiates no other; see its gain")
    reference = np.asarray(np.zeros(REFERENCE_SIZE) if reference is None else reference)
    if reference.shape != (REFERENCE_SIZE,) or reference.dtype.kind not in "iuf" or not np.all(np.isfinite(reference)):
        raise InputError(f"reference: has the shape {reference.shape}, must be r, r_dot, r_ddot: 9 finite numbers")
    reference = reference.astype(float)
    vehicle, kinematics = scenario.vehicle, scenario.world.kinematics
    x, u = operating_point(vehicle, kinematics, reference, scenario.yaw)
    if part == "servo":
        return _linear_servo(scenario, x, reference)
    if part in ("estimator", "closed_loop"):
        K, delta = frozen or frozen_gain(scenario)
        if part == "estimator":
            loop = hover_loop(scenario)
            estimate = (*(f"{name}_hat" for name in loop.names), *INTEGRAL_NAMES)
            inputs = (*loop.measurement.outputs, *CONTROL_NAMES, *REFERENCE_NAMES)
            system = make_frozen_filter(scenario, K, delta)
            return _named(system, scenario.h, estimate, inputs, estimate, loop.measurement.rows)
        return _linear_loop(scenario, x, reference, K, delta)
    names: tuple[str, ...] = STATE_NAMES
    h = None
    if part == "rotors_and_plant":
        diagram: Any = make_rotors_and_plant(with_one_lag(vehicle, lag), kinematics)
        speeds = commanded_speeds(u, mixing_inverse(vehicle), vehicle.rotor_max_speed)
        x, names = np.concatenate([x, speeds]), (*STATE_NAMES, *(f"W_{i + 1}" for i in range(len(speeds))))
    else:
        h = scenario.h if part == "sampled_plant" else None
        diagram = QuadrotorPlant_[float](vehicle, kinematics, h or 0.0)
    context = diagram.CreateDefaultContext()
    if h:
        context.SetDiscreteState(x)
    else:
        context.SetContinuousState(x)
    diagram.GetInputPort("control").FixValue(context, u)
    approximate = FirstOrderTaylorApproximation if reference[3:].any() else Linearize
    ports = diagram.GetInputPort("control").get_index(), diagram.GetOutputPort("state").get_index()
    system = approximate(diagram, context, *ports)
    return _named(system, h, names, CONTROL_NAMES, STATE_NAMES)


def _resting_estimate(scenario: Scenario, x: np.ndarray) -> np.ndarray:
    L = gain_of(scenario)
    return np.concatenate([x, resting_integral(L, x[:N_I], scenario.servo.form)])


def _linear_servo(scenario: Scenario, x: np.ndarray, reference: np.ndarray) -> Linearization:
    given_truth, told_force = scenario.servo.velocities == "truth", filter_of(scenario).force != "none"
    estimate = (*(f"{name}_hat" for name in STATE_NAMES), *INTEGRAL_NAMES)
    names = (*estimate, *REFERENCE_NAMES, *D * told_force, *STATE_NAMES[6:] * given_truth)
    given = {"estimate": _resting_estimate(scenario, x), "reference": reference}
    given |= {"force": np.zeros(3)} if told_force else {}
    given |= {"velocity": np.concatenate([np.zeros(PAYLOAD), x[6:]])} if given_truth else {}
    servo = make_lq_servo(scenario, told_force).ToAutoDiffXd()
    context, point, start = servo.CreateDefaultContext(), InitializeAutoDiff(np.concatenate([*given.values()])), 0
    for name, values in given.items():
        servo.GetInputPort(name).FixValue(context, point[start : start + values.size, 0])
        start += values.size
    slopes = ExtractGradient(servo.get_output_port().Eval(context)[:, None])
    if given_truth:  # the message's flag and stamp are not read
        slopes = np.delete(slopes, np.s_[start - 6 - PAYLOAD : start - 6], axis=1)
    no_state = np.zeros((0, 0)), np.zeros((0, len(names))), np.zeros((len(slopes), 0))
    return _named((*no_state, slopes), None, (), names, CONTROL_NAMES)


def _linear_loop(
    scenario: Scenario, x: np.ndarray, reference: np.ndarray, K: np.ndarray, delta: np.ndarray
) -> Linearization:
    diagram, loop = make_linear_loop(scenario, K, delta), hover_loop(scenario)
    context = diagram.CreateDefaultContext()
    estimate, extra = _resting_estimate(scenario, x), np.zeros(len(loop.names) - N_X)
    values = np.concatenate([x, np.zeros(len(loop.world) - N_X), estimate[:N_X], extra, estimate[N_X:]])
    state = context.get_mutable_discrete_state()
    sizes = [state.value(k).size for k in range(state.num_groups())]
    for k, part in enumerate(np.split(values, np.cumsum(sizes[:-1]))):
        state.set_value(k, part)
    diagram.get_input_port().FixValue(context, reference)
    matrices = differentiate_tick(diagram, context)
    return _named(matrices, scenario.h, loop.state_names, REFERENCE_NAMES, STATE_NAMES, loop.measurement.rows)
