"""The onboard half: an estimator, a servo and a planner, each exchangeable.

    estimator(scenario, xbar_0)       -> System with the sensors' messages as inputs, named as the world's outputs, and
                                         control (4) and reference (9) if it wants them; outputs estimate (12, or 15
                                         with the integral of the position error) and covariance (its square), and
                                         force (3), the disturbance force in W [N], if it knows it
    servo(scenario)                   -> System with inputs estimate (15), reference (9); output control (4)
    planner(scenario)                 -> the path as a Trajectory p_WB(t) (3 rows) [m], or a System with output
                                         reference (9)

Each may also have as inputs what the others give (estimate, covariance, control, reference, and force, 0 where no
estimator knows it) and any message. Such a function may be given to make_closed_loop, or registered and named in the
scenario by its kind. The System may be a LeafSystem or a Diagram; it sees nothing of the world but messages, and of the
scenario nothing but the Belief, which leaves out what only the world knows (scenario/belief.py).
"""

from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, InputPortIndex, OutputPort, System
from pydrake.systems.primitives import ConstantVectorSource, LinearSystem, MatrixGain, Multiplexer
from pydrake.trajectories import Trajectory

from ortilo_drake.diagrams.estimator import IntermittentEstimator
from ortilo_drake.model.parts import find_part
from ortilo_drake.model.signals import N_I, N_X, N_XBAR, REFERENCE_SIZE
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.commands.command_log import make_command_log
from ortilo_drake.onboard.commands.state_ahead import StateAhead
from ortilo_drake.onboard.planner.path_player import PathPlayer
from ortilo_drake.onboard.planner.planned import Planned, planned, start_of
from ortilo_drake.onboard.planner.planner import make_planner
from ortilo_drake.onboard.servo.augmented_servo import AugmentedServo
from ortilo_drake.onboard.servo.lq_gain import servo_gain
from ortilo_drake.onboard.servo.lq_servo import make_lq_servo, resting_integral
from ortilo_drake.scenario import Belief, LqServo


class Parts(NamedTuple):
    """Parts in place of those that a scenario names, as the functions above."""

    estimator: Callable[[Belief, np.ndarray], System] | None = None
    servo: Callable[[Belief], System] | None = None
    planner: Callable[[Belief], Planned] | None = None


NO_PARTS: Final = Parts()


def initial_estimate(scenario: Belief, r_0: np.ndarray) -> np.ndarray:
    """Return xbar_0 (15): hovering at r_0, with the integral at rest."""
    xbar_0 = np.zeros(N_XBAR)
    xbar_0[0:3] = r_0
    xbar_0[5] = scenario.yaw
    if isinstance(scenario.servo, LqServo):
        L = servo_gain(scenario.vehicle, scenario.servo.weights, scenario.h, scenario.yaw)
        xbar_0[12:15] = resting_integral(L, r_0, scenario.servo.form)
    return xbar_0


class Onboard(Diagram):
    """The onboard half as a Diagram.

    Ports:
        uwb, detections, imu, ...: messages of the sensors that the scenario flies.
        image (ImageRgba8U), shutter: the picture of a rendered camera and its message, in place of detections.
        velocity: the true velocities, only where the scenario lends them to the servo.
        acted: which commands acted, only where the scenario's commands want it; see onboard/commands.
        path (object): the path to fly, see onboard/planner/path_player.py; only if takes_paths.
        control (4, output): u_k, f_T absolute.
        estimate (15, output): xhat_{k|k-1}.
        covariance (225, output): P_k row by row.
        y (p), delta (s), V2 (q) (outputs): the measurement as it reaches the filter in this tick, late ones included;
            of an estimator of one's own that does not tell, nothing arrived.
        reference (9, output): r, r_dot, r_ddot.

    Args:
        scenario: the scenario, of which the belief is all that is taken.
        trajectory: the path to fly (3 rows, W); by default what the scenario's planner plans.
        detects: whether the pictures of a rendered camera come here; if not, detections do.
        parts: in place of the scenario's.
        takes_paths: whether the path is an input, for a half that is given others in flight; not of a planner that
            is a System.

    Attributes:
        r_0: p_WB (3) [m] where the reference starts.

    Raises:
        InputError: if there is no path or no servo gain, if the detector's files are wrong, or if a part of one's own
            has not the ports that it needs.
    """

    def __init__(
        self,
        scenario: Belief,
        trajectory: Trajectory | None = None,
        detects: bool = True,
        parts: Parts = NO_PARTS,
        takes_paths: bool = False,
    ):
        super().__init__()
        scenario = scenario.belief
        plan = trajectory or planned(scenario, parts.planner)
        self.r_0 = start_of(plan)
        builder = DiagramBuilder()
        if isinstance(plan, Trajectory):
            planner = builder.AddSystem(PathPlayer() if takes_paths else make_planner(plan))
            reference = planner.get_output_port()
        else:
            planner = builder.AddSystem(plan)
            reference = planner.GetOutputPort("reference")

        xbar_0 = initial_estimate(scenario, self.r_0)
        estimator = builder.AddSystem(_estimator_of(scenario, xbar_0, detects, parts.estimator))
        servo = builder.AddSystem(_servo_of(scenario, parts.servo, estimator.HasOutputPort("force")))
        self._estimator = estimator
        _require(servo, ("estimate", "reference"), ("control",), "servo")
        _require(estimator, (), ("estimate", "covariance"), "estimator")
        control = servo.GetOutputPort("control")
        estimate, covariance = _whole_estimate(builder, estimator, reference, scenario.h)
        signals = {"control": control, "estimate": estimate, "covariance": covariance, "reference": reference}
        parts_flown = {"planner": planner, "estimator": estimator, "servo": servo}
        commands, h = scenario.commands, scenario.h
        instead: dict[str, dict[str, OutputPort]] = {}
        timeline: dict[str, OutputPort] = {}
        if commands.are_kept:
            parts_flown["command_log"] = builder.AddSystem(make_command_log(scenario))
            timeline["timeline"] = parts_flown["command_log"].GetOutputPort("timeline")
        if commands.servo == "predicted":
            size = timeline["timeline"].size()
            knows_force = estimator.HasOutputPort("force")
            ahead = builder.AddSystem(StateAhead(scenario.vehicle, h, size, knows_force, scenario.yaw))
            parts_flown["state_ahead"] = ahead
            instead["servo"] = {name: ahead.GetOutputPort(f"{name}_ahead") for name in ("estimate", "reference")}
        wants_force = any(part.HasInputPort("force") for part in parts_flown.values())
        force = {"force": _output_or_zeros(builder, estimator, "force", 3)} if wants_force else {}
        _connect(builder, parts_flown, signals | force | timeline, instead)
        for name, size in scenario.measurement.sizes.items():
            signals[name] = _output_or_zeros(builder, estimator, name, size)
        for name, port in signals.items():
            builder.ExportOutput(port, name)
        builder.BuildInto(self)
        self.set_name("onboard")

    def SetBelief(self, context: Context, xbar: np.ndarray, P: np.ndarray) -> None:
        """Set the estimator's estimate (15) and covariance (15 x 15); the context is the root's.

        Raises:
            InputError: if the estimator cannot be set.
        """
        if not hasattr(self._estimator, "SetBelief"):
            raise InputError(f"estimator: {self._estimator.get_name()}: has no method SetBelief, it cannot be resumed")
        self._estimator.SetBelief(context, xbar, P)

    @property
    def has_history(self) -> bool:
        """Whether past ticks decide what will be estimated, beside the present belief."""
        return bool(getattr(self._estimator, "has_history", True))


def _estimator_of(
    scenario: Belief, xbar_0: np.ndarray, detects: bool, make: Callable[[Belief, np.ndarray], System] | None
) -> System:
    """Return the estimator that is given, or that the scenario names."""
    if make is None:
        kind = getattr(getattr(scenario, "estimator", None), "kind", "intermittent")
        found = find_part("estimator", kind) if kind != "intermittent" else None
        if found is None:
            return IntermittentEstimator(scenario, xbar_0, detects)
        make = found.make
    return make(scenario, xbar_0)


def _servo_of(scenario: Belief, make: Callable[[Belief], System] | None, knows_force: bool) -> System:
    """Return the servo that is given, or that the scenario names."""
    if make is None:
        found = None if isinstance(scenario.servo, LqServo) else find_part("servo", scenario.servo.kind)
        if found is None:
            if scenario.commands.servo == "augmented":
                delay = scenario.commands.delay or 0.0
                return AugmentedServo(scenario.servo, scenario.vehicle, scenario.h, delay, knows_force)
            return make_lq_servo(scenario.servo, scenario.vehicle, scenario.h, knows_force)
        make = found.make
    return make(scenario)


def _require(system: System, inputs: tuple[str, ...], outputs: tuple[str, ...], role: str) -> None:
    """Refuse a part that lacks a port, naming what it has."""
    has_in = [system.get_input_port(i).get_name() for i in range(system.num_input_ports())]
    has_out = [system.get_output_port(i).get_name() for i in range(system.num_output_ports())]
    for wanted, has, kind in ((inputs, has_in, "input"), (outputs, has_out, "output")):
        missing = [name for name in wanted if name not in has]
        if missing:
            raise InputError(
                f"{role}: {system.get_name()}: has no {kind} '{missing[0]}', only {', '.join(has) or 'none'}"
            )


def _output_or_zeros(builder: DiagramBuilder, estimator: System, name: str, size: int) -> OutputPort:
    """Return an output of an estimator, or zeros where it has none of that name."""
    if estimator.HasOutputPort(name):
        return estimator.GetOutputPort(name)
    return builder.AddNamedSystem(f"no_{name}", ConstantVectorSource(np.zeros(size))).get_output_port()


def _connect(
    builder: DiagramBuilder,
    parts: dict[str, System],
    common: dict[str, OutputPort],
    instead: dict[str, dict[str, OutputPort]],
) -> None:
    """Connect the inputs of each part to the signals of their names; all others are messages, and come from outside.

    Args:
        builder: of the diagram.
        parts: by role.
        common: signals by name.
        instead: signals of a part alone, by its role, in the place of those.
    """
    exported: dict[str, InputPortIndex] = {}
    for role, part in parts.items():
        signals = common | instead.get(role, {})
        for i in range(part.num_input_ports()):
            port = part.get_input_port(i)
            name = port.get_name()
            if name in signals:
                if port.size() != signals[name].size():
                    raise InputError(
                        f"{role}: {part.get_name()}: takes '{name}' of {port.size()} numbers, must be "
                        f"{signals[name].size()}"
                    )
                builder.Connect(signals[name], port)
            elif name in exported:
                builder.ConnectInput(exported[name], port)
            else:
                exported[name] = builder.ExportInput(port, name)


def _whole_estimate(
    builder: DiagramBuilder, estimator: System, reference: OutputPort, h: float
) -> tuple[OutputPort, OutputPort]:
    """Return estimate (15) and covariance (225); of an estimator of the twelve states the integral is added.

    It is i_{k+1} = i_k + r_k - p_hat_k, as in the authors' code, and known: its rows and columns of P are 0.
    """
    estimate, covariance = estimator.GetOutputPort("estimate"), estimator.GetOutputPort("covariance")
    n = estimate.size()
    if n not in (N_X, N_XBAR) or covariance.size() != n * n:
        raise InputError(
            f"estimator: {estimator.get_name()}: estimate ({n}) and covariance ({covariance.size()}): must be "
            f"{N_X} or {N_XBAR} numbers, and their square"
        )
    if n == N_XBAR:
        return estimate, covariance
    one = np.eye(N_I)
    B = np.hstack([one, np.zeros((N_I, REFERENCE_SIZE - N_I)), -one, np.zeros((N_I, N_X - N_I))])
    integral = builder.AddNamedSystem("integral", LinearSystem(one, B, one, np.zeros((N_I, REFERENCE_SIZE + N_X)), h))
    inputs = builder.AddSystem(Multiplexer([REFERENCE_SIZE, N_X]))
    builder.Connect(reference, inputs.get_input_port(0))
    builder.Connect(estimate, inputs.get_input_port(1))
    builder.Connect(inputs.get_output_port(), integral.get_input_port())
    whole = builder.AddSystem(Multiplexer([N_X, N_I]))
    builder.Connect(estimate, whole.get_input_port(0))
    builder.Connect(integral.get_output_port(), whole.get_input_port(1))
    into = np.zeros((N_XBAR, N_XBAR, N_X, N_X))
    i = np.arange(N_X)
    into[i[:, None], i[None, :], i[:, None], i[None, :]] = 1.0
    wider = builder.AddNamedSystem("covariance", MatrixGain(into.reshape(N_XBAR**2, N_X**2)))
    builder.Connect(covariance, wider.get_input_port())
    return whole.get_output_port(), wider.get_output_port()


def make_onboard(
    scenario: Belief,
    trajectory: Trajectory | None = None,
    detects: bool = True,
    parts: Parts = NO_PARTS,
    takes_paths: bool = False,
) -> Onboard:
    """Return the onboard half of a scenario; arguments and errors as Onboard's."""
    return Onboard(scenario, trajectory, detects, parts, takes_paths)
