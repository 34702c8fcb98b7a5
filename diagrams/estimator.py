"""The paper's estimator: fixes, the intermittent measurements handler and the filter, as one Diagram."""

import numpy as np
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, InputPort, OutputPort, System
from pydrake.systems.primitives import Demultiplexer

from ortilo_drake.model.clock import history_ticks
from ortilo_drake.model.measurement import Measurement
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import IMU_SIZE, N_X, N_XBAR
from ortilo_drake.onboard.commands.command_log import log_ticks, timeline_size
from ortilo_drake.onboard.detector.detector import Detector
from ortilo_drake.onboard.detector.detector_network import load_detector
from ortilo_drake.onboard.estimator.extra_states import augmented_rows, extra_states, names_of
from ortilo_drake.onboard.estimator.filter_model import augmented_model, initial_covariance
from ortilo_drake.onboard.estimator.imu_rows import imu_variances
from ortilo_drake.onboard.estimator.kalman_filter import KalmanFilter_
from ortilo_drake.onboard.estimator.measurement_handler import MeasurementHandler
from ortilo_drake.onboard.estimator.replay_kalman_filter import ReplayKalmanFilter
from ortilo_drake.onboard.estimator.robust.stuck_gate import StuckGate_
from ortilo_drake.onboard.estimator.robust.system import OUTPUTS, RobustGate_, opening_variances
from ortilo_drake.onboard.estimator.robust.weights import weighing_of
from ortilo_drake.onboard.sample_mean import SampleMean
from ortilo_drake.scenario import Belief
from ortilo_drake.scenario.robust import Robust
from ortilo_drake.sensors.described import flown
from ortilo_drake.sensors.messages import message_port, message_size

_PREDICTIONS = ("estimate", "covariance")


def make_detector(scenario: Belief, room: Room) -> Detector:
    """Return what finds landmarks in the pictures of a rendered camera; InputError if its files are wrong."""
    camera = room.camera.scaled_to(scenario.camera.width)
    size = camera.width, camera.height
    detect = load_detector(scenario.detector, room, size)
    return Detector(detect, size, scenario.camera.latency, scenario.h)


def _lead(
    builder: DiagramBuilder, name: str, readers: list[InputPort], gate: System | None, source: OutputPort | None = None
) -> None:
    """Lead messages to all who read them, through a gate if there is one; from outside, by a name, or from a source."""
    if gate is not None:
        builder.AddSystem(gate)
        for reader in readers:
            builder.Connect(gate.get_output_port(), reader)
        readers = [gate.get_input_port()]
    if source is None:
        message = builder.ExportInput(readers[0], name)
        for reader in readers[1:]:
            builder.ConnectInput(message, reader)
    else:
        for reader in readers:
            builder.Connect(source, reader)


def _weighed(
    builder: DiagramBuilder,
    robust: Robust,
    handler: System,
    kalman: System,
    measurement: Measurement,
    names: tuple[str, ...],
    late: tuple[str, ...],
    h: float,
) -> dict[str, OutputPort]:
    """Add what refuses and weighs the handler's measurement; return y, delta and V2 as they come out of it.

    Args:
        builder: of the estimator.
        robust: its settings.
        handler: whose measurement it is.
        kalman: the filter, whose P it opens.
        measurement: over all that the filter estimates.
        names: of the filter's states beside the vehicle's.
        late: sensors that are judged by the belief of their stamp's tick.
        h: tick [s].
    """
    weighing = weighing_of(robust, measurement, handler.GetOutputPort("delta").size())
    opening = opening_variances(robust.opening, names)
    gate = builder.AddSystem(RobustGate_[float](weighing, measurement, opening, late, h))
    for name in OUTPUTS[:3]:
        builder.Connect(handler.GetOutputPort(name), gate.GetInputPort(name))
    for whose in ("", *(f"_{sensor}" for sensor in late)):
        builder.Connect(kalman.GetOutputPort(f"whole_belief{whose}"), gate.GetInputPort(f"belief{whose}"))
    sizes = [handler.GetOutputPort(name).size() for name in OUTPUTS[:3]]
    parts = builder.AddNamedSystem("weighed", Demultiplexer([*sizes, opening.shape[1]]))
    builder.Connect(gate.get_output_port(), parts.get_input_port())
    ports = {name: parts.get_output_port(i) for i, name in enumerate(OUTPUTS)}
    builder.Connect(ports.pop("opening"), kalman.GetInputPort("opening"))
    return ports


class IntermittentEstimator(Diagram):
    """The paper's chain from messages to the estimate: an estimator by the contract of diagrams/onboard.py.

    Ports:
        uwb, detections, imu, ...: the messages of the sensors that the scenario flies.
        image (ImageRgba8U), shutter: the picture of a rendered camera and its message, in place of detections.
        control (4): u_k, f_T absolute.
        reference (9): r, r_dot, r_ddot.
        timeline (n): what acted and what will, see onboard/commands/command_log.py; only with commands.filter 'acted'.
        estimate (15, output): xhat_{k|k-1} and the integral.
        covariance (225, output): P_k row by row.
        force (3, output): the disturbance force in W as estimated [N]; only where estimator.force has it estimated.
        extra (2 e, output): all states beside x and their standard deviations, see extra_states.py; likewise.
        y (p), delta (s), V2 (q) (outputs): the measurement as it reaches the filter in this tick, late ones included.

    Args:
        scenario: the scenario, of which the belief is all that is taken.
        xbar_0: first estimate (15).
        detects: whether the pictures of a rendered camera come here; if not, detections do.

    Raises:
        InputError: if the detector's files are wrong.
    """

    def __init__(self, scenario: Belief, xbar_0: np.ndarray, detects: bool = True):
        super().__init__()
        scenario = scenario.belief
        room, h, settings = scenario.load_room(), scenario.h, scenario.estimator
        measurement = scenario.measurement
        sensors = [flown(name, scenario) for name in measurement.sensors if name in scenario.sensors]
        solvers = {s.name: s.make_onboard(scenario, room) for s in sensors if s.make_onboard is not None}
        self._reacquires = any(solver.num_discrete_state_groups() for solver in solvers.values())
        about = [name for name, solver in solvers.items() if solver.HasInputPort("estimate")]

        builder = DiagramBuilder()
        opens = settings.robust is not None
        extras = extra_states(settings, scenario.vehicle, h, scenario.flown_rows, scenario.yaw)
        model = augmented_model(settings, scenario.vehicle, settings.integrator, h, extras, scenario.yaw)
        P_0, hover_thrust = initial_covariance(settings, extras), scenario.vehicle.hover_thrust
        seen = augmented_rows(measurement.rows, extras)
        arguments = model, seen, hover_thrust, xbar_0, P_0, h
        variances = imu_variances(scenario)
        replays = settings.delay == "replay"
        if replays:
            sizes = {name: message_port(solvers[name]).size() for name in about}
            ticks = history_ticks(settings.horizon, h)
            acted = timeline_size(log_ticks(scenario)) if scenario.commands.filter == "acted" else 0
            kalman = builder.AddSystem(ReplayKalmanFilter(*arguments, ticks, sizes, variances, acted, opens))
            if acted:
                builder.ExportInput(kalman.GetInputPort("timeline"), "timeline")
        else:
            kalman = builder.AddSystem(KalmanFilter_[float](*arguments, variances, opens))
        self._kalman = kalman

        def split(belief: OutputPort) -> dict[str, OutputPort]:
            parts = builder.AddSystem(Demultiplexer([N_XBAR, N_XBAR * N_XBAR]))
            builder.Connect(belief, parts.get_input_port())
            return {name: parts.get_output_port(i) for i, name in enumerate(_PREDICTIONS)}

        def stuck_gate(sensor: str, message: InputPort) -> System | None:
            if settings.robust is None or settings.robust.stuck is None:
                return None
            return StuckGate_[float](sensor, message.size(), settings.robust.stuck, h, scenario.samples(sensor))

        present = split(kalman.GetOutputPort("belief"))
        fixes: dict[str, OutputPort] = {}
        for name, solver in solvers.items():
            builder.AddSystem(solver)
            prediction, readers = present, [message_port(solver)]
            if replays and name in about:
                readers.append(kalman.GetInputPort(f"message_{name}"))
                prediction = split(kalman.GetOutputPort(f"belief_{name}"))
            for port in _PREDICTIONS:
                if solver.HasInputPort(port):
                    builder.Connect(prediction[port], solver.GetInputPort(port))
            source = None
            if name == "camera" and scenario.is_rendered and detects:
                detector = builder.AddSystem(make_detector(scenario, room))
                builder.ExportInput(detector.GetInputPort("image"), "image")
                builder.ExportInput(detector.GetInputPort("shutter"), "shutter")
                source = detector.get_output_port()
            _lead(builder, readers[0].get_name(), readers, stuck_gate(name, readers[0]), source)
            fixes[name] = solver.get_output_port()

        V = {name: flown(name, scenario).V(scenario) for name in measurement.sensors}
        sizes = {s.name: fixes[s.name].size() if s.name in fixes else message_size(s, scenario, room) for s in sensors}
        late_ones = settings.delay, settings.horizon
        handler = builder.AddSystem(MeasurementHandler(measurement, sizes, V, dict(settings.gates), h, *late_ones))
        for s in sensors:
            if s.name in fixes:
                builder.Connect(fixes[s.name], handler.GetInputPort(s.name))
            else:
                reader = handler.GetInputPort(s.name)
                _lead(builder, s.name, [reader], stuck_gate(s.name, reader))
        for port in _PREDICTIONS:
            if handler.HasInputPort(port):  # it gates
                builder.Connect(present[port], handler.GetInputPort(port))
        used = {name: handler.GetOutputPort(name) for name in measurement.sizes}
        if settings.robust is not None:
            late = tuple(about) if replays else ()
            used = _weighed(builder, settings.robust, handler, kalman, seen, names_of(extras), late, h)
        for name, port in used.items():
            builder.Connect(port, kalman.GetInputPort(name))
        if replays:
            builder.Connect(handler.GetOutputPort("stamps"), kalman.GetInputPort("stamps"))
        if variances is not None:
            reader, n = kalman.GetInputPort("imu"), scenario.samples("imu")
            if n > 1:
                mean = builder.AddSystem(SampleMean("imu", IMU_SIZE, n))
                builder.Connect(mean.get_output_port(), reader)
                reader = mean.get_input_port()
            builder.ConnectInput("imu", reader)
        if extras:
            parts = builder.AddNamedSystem("extra", Demultiplexer([3, 2 * (len(model.Phi) - N_X) - 3]))
            builder.Connect(kalman.GetOutputPort("extra"), parts.get_input_port())
            builder.ExportOutput(parts.get_output_port(0), "force")
            builder.ExportOutput(kalman.GetOutputPort("extra"), "extra")
        for port in ("control", "reference"):
            builder.ExportInput(kalman.GetInputPort(port), port)
        for name, port in present.items():
            builder.ExportOutput(port, name)
        for name, port in used.items():
            builder.ExportOutput(port, name)
        builder.BuildInto(self)
        self.set_name("estimator")

    def SetBelief(self, context: Context, xbar: np.ndarray, P: np.ndarray) -> None:
        """Set estimate (15) and covariance (15 x 15); the context is the root's."""
        self._kalman.SetBelief(self._kalman.GetMyMutableContextFromRoot(context), xbar, P)

    @property
    def has_history(self) -> bool:
        """Whether past ticks decide what it will estimate, beside the present belief."""
        keeps = self._kalman.HasOutputPort("extra") or self._kalman.HasInputPort("opening")
        return isinstance(self._kalman, ReplayKalmanFilter) or keeps or self._reacquires
