"""The world: the vehicle, its sensors and the links."""

import numpy as np
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, OutputPort, System
from pydrake.systems.primitives import PassThrough, ZeroOrderHold

from ortilo_drake.diagrams.faults import add_sensor_faults, check_room
from ortilo_drake.diagrams.rendered_camera import make_rendered_camera
from ortilo_drake.diagrams.vehicle import Ports, add_vehicle
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import N_U, N_X, PAYLOAD
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import CommandLink as CommandLinkSettings
from ortilo_drake.scenario import Link, Scenario
from ortilo_drake.scenario.truth import ClockTruth, Truth
from ortilo_drake.sensors.described import described
from ortilo_drake.world.drawn_truth import Drawn, check_size, draw_truth
from ortilo_drake.world.radio.image_delay import ImageDelay, check_kept
from ortilo_drake.world.radio.link import SensorLink_
from ortilo_drake.world.seeded_system import set_seed
from ortilo_drake.world.sensors.message_error import MessageError_
from ortilo_drake.world.sensors.sample_collector import SampleCollector
from ortilo_drake.world.sensors.sensor_clock import SensorClock_
from ortilo_drake.world.sensors.sensor_errors import errors_of
from ortilo_drake.world.sensors.shutter import Shutter
from ortilo_drake.world.sensors.true_velocity import TrueVelocity_
from ortilo_drake.world.slow_error import SlowError_
from ortilo_drake.world.truth import set_body, set_lasting_force, set_truth


class World(Diagram):
    """The world as a Diagram.

    In real time a command comes when it comes. With a command_period the world looks for one that often, through a
    failsafe, and Drake integrates the plant in between, whatever world.plant says; all else keeps its tick h. Where a
    sensor is faster than the tick, Drake integrates the plant between its samples, whatever world.plant says.

    Ports:
        control (4): u = [f_T, tau_x, tau_y, tau_z] as commanded, sampled and held every tick; what the rotors get
            of it is the command link's affair, a perfect one adds nothing.
        command (5): with a command_period, in place of control: u and the time at which it was received [s].
        command_stamp (1): with a command_period and only where the scenario wants `acted`: the time of the tick that
            sent it [s], -1 before the first.
        state (12, output): the true x.
        failsafe_mode (output): with a command_period, who flies: an index in world.failsafe.MODES.
        uwb, detections, imu, ... (outputs): the messages of the sensors that the scenario flies.
        image (ImageRgba8U), shutter (outputs): a rendered camera's picture and its message, in place of detections.
        depth_image, label_image (outputs): see diagrams/rendered_camera.py; drawn only if asked for.
        velocity (output): the true velocities, only where the scenario lends them to the servo.
        acted (output): which commands acted, only where the scenario's commands want it.

    Layouts of the messages: model/signals.py.

    Args:
        scenario: the scenario.
        command_period: how often to look for a command [s]; by default there is one every tick.

    Raises:
        InputError: if there is a command_period and a command link that is not perfect: whatever carries the commands
            to this world loses and delays them. If a fault names an anchor, a landmark or a rotor that is not there.
    """

    def __init__(self, scenario: Scenario, command_period: float | None = None):
        super().__init__()
        if command_period is not None and scenario.command_link != CommandLinkSettings():
            raise InputError("command_link: must be left as it is where commands come from outside, in real time")
        room, builder = scenario.load_room(), DiagramBuilder()
        check_room(scenario, room)
        self._hold = builder.AddNamedSystem("hold", ZeroOrderHold(command_period or scenario.h, N_U))
        self._vehicle, self._room, self._truth = scenario.vehicle, room, scenario.truth
        self._payloads: dict[str, int] = {}  # of the sensors that fly
        self._plant, ports = add_vehicle(builder, scenario, self._hold, command_period)
        builder.ExportOutput(ports["state"], "state")
        for name in scenario.measurement.sensors:
            if name not in scenario.sensors:
                continue
            seen = ports | {"state": _as_seen(builder, scenario, name, ports["state"])}
            if name == "camera" and scenario.is_rendered:
                _add_rendered_camera(builder, scenario, room, seen, ports["state"])
                self._payloads[name] = 0
                continue
            latency = scenario.camera.latency if name == "camera" else 0
            source = builder.AddSystem(described(name).make_world(scenario.sampled_for(name), room))
            _connect(builder, seen, source)
            self._payloads[name] = source.get_output_port().size() - PAYLOAD
            message = _with_errors(builder, scenario, name, source.get_output_port())
            message = add_sensor_faults(builder, scenario, name, room, message, seen["state"])
            message = _collected(builder, scenario, name, message)
            settings = scenario.link_of(name)
            settings = settings.model_copy(update={"delay": settings.delay + latency})
            delivered = _add_link(builder, settings, scenario, name, message, ports["state"])
            builder.ExportOutput(delivered, source.get_output_port().get_name())
        if scenario.lends_velocities:
            velocity = builder.AddSystem(TrueVelocity_[float]())
            builder.Connect(ports["state"], velocity.get_input_port())
            builder.ExportOutput(velocity.get_output_port(), "velocity")
        if "acted" in ports:
            delivered = _add_link(builder, scenario.report_link, scenario, "acted", ports["acted"], ports["state"])
            builder.ExportOutput(delivered, "acted")
        builder.BuildInto(self)
        self.set_name("world")

    def SetHovering(self, context: Context, r_0: np.ndarray, yaw: float) -> None:
        """Put the vehicle hovering at rest where it is believed to be; the context is the root's, its seed set.

        Args:
            context: the root's.
            r_0: believed p_WB (3) [m]; the truth may differ.
            yaw: believed yaw [rad]; the truth may differ.
        """
        x_0 = np.zeros(N_X)
        x_0[0:3], x_0[5] = r_0, yaw
        if self._truth != Truth():
            drawn = self.Drawn(context)
            x_0[0:3] += drawn["start.position"]
            x_0[5] += drawn["start.yaw"]
        self._plant.SetState(self._plant.GetMyMutableContextFromRoot(context), x_0)
        hover = [self._vehicle.hover_thrust, 0.0, 0.0, 0.0]
        self._hold.SetVectorState(self._hold.GetMyMutableContextFromRoot(context), hover)

    def SetSeed(self, context: Context, seed: int) -> None:
        """Set the seed of all noise, and how the world of that seed differs; the context is the root's."""
        set_seed(self, context, seed)
        if self._truth != Truth():
            set_truth(self, context, self._vehicle, self._room, self.Drawn(context), self._payloads)

    def ChangeBody(self, context: Context, heavier: float, push: np.ndarray) -> None:
        """Have the vehicle be heavier and pushed, beside how this world differs anyway; the context is the root's.

        Args:
            context: the root's.
            heavier: true over the world's own mass, less 1 [1].
            push: a force in W beside the world's own mean force (3) [N]; felt only where truth.force is set.
        """
        drawn = self.Drawn(context)
        drawn["vehicle.mass_factor"] = drawn["vehicle.mass_factor"] * (1.0 + heavier)
        set_body(self, context, self._vehicle, drawn)
        set_lasting_force(self, context, drawn["force.mean"] + push)

    def Drawn(self, context: Context) -> Drawn:
        """Return how the world of the context's seed differs from what is believed; the context is the root's."""
        source = self.GetSubsystemByName("disturbance")
        seed = source.seed_in(source.GetMyContextFromRoot(context))
        return draw_truth(self._truth, seed, self._room, self._payloads)


def _as_seen(builder: DiagramBuilder, scenario: Scenario, sensor: str, state: OutputPort) -> OutputPort:
    """Return the state as a sensor sees it, by its own clock; the imu's is the onboard computer's."""
    if sensor == "imu" or scenario.truth.clock == ClockTruth():
        return state
    clock = builder.AddSystem(SensorClock_[float](f"{sensor}_clock"))
    builder.Connect(state, clock.get_input_port())
    seen: OutputPort = clock.get_output_port()
    return seen


def _connect(builder: DiagramBuilder, ports: Ports, sensor: System) -> None:
    """Connect a sensor to what it sees."""
    for name, port in ports.items():
        if sensor.HasInputPort(name):
            builder.Connect(port, sensor.GetInputPort(name))


def _with_errors(builder: DiagramBuilder, scenario: Scenario, sensor: str, message: OutputPort) -> OutputPort:
    """Add the errors that the scenario's truth gives a sensor's messages; return where they come out."""
    payload = message.size() - PAYLOAD
    if sensor in dict(scenario.truth.sensors):
        check_size(sensor, dict(scenario.truth.sensors)[sensor], payload)
    errors = errors_of(scenario.truth, sensor, payload, scenario.h)
    if errors is None:
        return message
    slow = builder.AddSystem(SlowError_[float](f"{sensor}_slow_error", errors.noise, scenario.seed, scenario.h))
    n = slow.get_output_port().size()
    error = builder.AddSystem(MessageError_[float](f"{sensor}_error", message.size(), n, errors.flagged))
    builder.Connect(message, error.GetInputPort("message"))
    builder.Connect(slow.get_output_port(), error.GetInputPort("error"))
    measured: OutputPort = error.get_output_port()
    return measured


def _collected(builder: DiagramBuilder, scenario: Scenario, sensor: str, message: OutputPort) -> OutputPort:
    """Collect the samples of a sensor faster than the tick; return where a tick's message comes out."""
    n = scenario.samples(sensor)
    if n == 1:
        return message
    collector = builder.AddSystem(SampleCollector(sensor, message.size(), n, scenario.h))
    builder.Connect(message, collector.get_input_port())
    collected: OutputPort = collector.get_output_port()
    return collected


def _add_link(
    builder: DiagramBuilder, settings: Link, scenario: Scenario, sensor: str, message: OutputPort, state: OutputPort
) -> OutputPort:
    """Add the link of a sensor's messages, or of the report; return where they come out."""
    if settings == Link():  # a perfect link
        link = builder.AddNamedSystem(f"{sensor}_link", PassThrough(message.size()))
        builder.Connect(message, link.get_input_port())
    else:
        link = builder.AddSystem(SensorLink_[float](sensor, message.size(), settings, scenario.seed, scenario.h))
        builder.Connect(message, link.GetInputPort("message"))
        builder.Connect(state, link.GetInputPort("state"))
    delivered: OutputPort = link.get_output_port()
    return delivered


def _add_rendered_camera(
    builder: DiagramBuilder, scenario: Scenario, room: Room, seen: Ports, state: OutputPort
) -> None:
    """Add a camera whose pictures Drake renders of the state as it is seen, with its shutter's link."""
    width, link = scenario.camera.width, scenario.link_of("camera")
    rendered = builder.AddSystem(make_rendered_camera(room, width))
    builder.Connect(seen["state"], rendered.GetInputPort("state"))
    source = builder.AddSystem(Shutter())
    _connect(builder, seen, source)
    shutter = _add_link(builder, link, scenario, "camera", source.get_output_port(), state)
    builder.ExportOutput(shutter, "shutter")
    image, ticks = rendered.GetOutputPort("color_image"), link.delay + link.random_delay
    if ticks:
        camera = room.camera.scaled_to(width)
        check_kept(scenario.every("camera"), ticks, camera.width, camera.height)
        kept = builder.AddSystem(ImageDelay(scenario.every("camera"), ticks, scenario.h))
        builder.Connect(image, kept.GetInputPort("color_image"))
        builder.Connect(shutter, kept.GetInputPort("shutter"))
        image = kept.get_output_port()
    builder.ExportOutput(image, "image")
    for name in ("depth_image", "label_image"):
        builder.ExportOutput(rendered.GetOutputPort(name), name)


def make_world(scenario: Scenario, command_period: float | None = None) -> World:
    """Return the world of a scenario; arguments and errors as World's."""
    return World(scenario, command_period)
