"""The world: the vehicle, its sensors and the links."""

import numpy as np
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, LeafSystem, OutputPort, System
from pydrake.systems.primitives import PassThrough, ZeroOrderHold

from ortilo_drake.diagrams.rendered_camera import make_rendered_camera
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import N_U, N_X
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import CommandLink as CommandLinkSettings
from ortilo_drake.scenario import Link, Scenario
from ortilo_drake.sensors.described import described
from ortilo_drake.world.radio.command_link import CommandLink_
from ortilo_drake.world.radio.image_delay import ImageDelay, check_kept
from ortilo_drake.world.radio.link import SensorLink_
from ortilo_drake.world.seeded_system import set_seed
from ortilo_drake.world.sensors.shutter import Shutter
from ortilo_drake.world.sensors.true_velocity import TrueVelocity_
from ortilo_drake.world.vehicle.disturbance import DisturbanceSource_
from ortilo_drake.world.vehicle.failsafe import Failsafe
from ortilo_drake.world.vehicle.quadrotor import QuadrotorPlant_
from ortilo_drake.world.vehicle.rotors import Rotors_

Ports = dict[str, OutputPort]


class World(Diagram):
    """The world as a Diagram.

    In real time a command comes when it comes. With a command_period the world looks for one that often, through a
    failsafe, and Drake integrates the plant in between, whatever world.plant says; all else keeps its tick h.

    Ports:
        control (4): u = [f_T, tau_x, tau_y, tau_z] as commanded, sampled and held every tick; what the rotors get
            of it is the command link's affair, a perfect one adds nothing.
        command (5): with a command_period, in place of control: u and the time at which it was received [s].
        state (12, output): the true x.
        failsafe_mode (output): with a command_period, who flies: an index in world.failsafe.MODES.
        uwb, detections, imu, ... (outputs): the messages of the sensors that the scenario flies.
        image (ImageRgba8U), shutter (outputs): a rendered camera's picture and its message, in place of detections.
        depth_image, label_image (outputs): see diagrams/rendered_camera.py; drawn only if asked for.
        velocity (output): the true velocities, only where the scenario lends them to the servo.

    Layouts of the messages: model/signals.py.

    Args:
        scenario: the scenario.
        command_period: how often to look for a command [s]; by default there is one every tick.

    Raises:
        InputError: if there is a command_period and a command link that is not perfect: whatever carries the commands
            to this world loses and delays them.
    """

    def __init__(self, scenario: Scenario, command_period: float | None = None):
        super().__init__()
        if command_period is not None and scenario.command_link != CommandLinkSettings():
            raise InputError("command_link: must be left as it is where commands come from outside, in real time")
        room, builder = scenario.load_room(), DiagramBuilder()
        self._hold = builder.AddNamedSystem("hold", ZeroOrderHold(command_period or scenario.h, N_U))
        self._vehicle = scenario.vehicle
        self._plant, ports = _add_vehicle(builder, scenario, self._hold, command_period)
        builder.ExportOutput(ports["state"], "state")
        for name in scenario.measurement.sensors:
            if name == "camera" and scenario.is_rendered:
                _add_rendered_camera(builder, scenario, room, ports)
            elif name in scenario.sensors:
                sensor = described(name)
                latency = scenario.camera.latency if name == "camera" else 0
                source = builder.AddSystem(sensor.make_world(scenario, room))
                builder.ExportOutput(
                    _add_link(builder, scenario, name, source, ports, latency), source.get_output_port().get_name()
                )
        if scenario.lends_velocities:
            velocity = builder.AddSystem(TrueVelocity_[float]())
            builder.Connect(ports["state"], velocity.get_input_port())
            builder.ExportOutput(velocity.get_output_port(), "velocity")
        builder.BuildInto(self)
        self.set_name("world")

    def SetHovering(self, context: Context, r_0: np.ndarray, yaw: float) -> None:
        """Put the vehicle hovering at rest at r_0, p_WB (3), under that yaw [rad]; the context is the root's."""
        x_0 = np.zeros(N_X)
        x_0[0:3], x_0[5] = r_0, yaw
        self._plant.SetState(self._plant.GetMyMutableContextFromRoot(context), x_0)
        hover = [self._vehicle.hover_thrust, 0.0, 0.0, 0.0]
        self._hold.SetVectorState(self._hold.GetMyMutableContextFromRoot(context), hover)

    def SetSeed(self, context: Context, seed: int) -> None:
        """Set the seed of all noise; the context is the root's."""
        set_seed(self, context, seed)


def _add_vehicle(
    builder: DiagramBuilder, scenario: Scenario, hold: ZeroOrderHold, command_period: float | None
) -> tuple[System, Ports]:
    """Add the plant with what commands and pushes it; return it, and the ports state, control and disturbance."""
    sampled = scenario.world.plant == "sampled" and command_period is None
    h = scenario.h
    plant = builder.AddSystem(
        QuadrotorPlant_[float](scenario.vehicle, scenario.world.kinematics, time_step=h if sampled else 0.0)
    )
    disturbance = builder.AddSystem(DisturbanceSource_[float](scenario.world.disturbance, scenario.seed, h))
    disturbance_hold = builder.AddNamedSystem("disturbance_hold", ZeroOrderHold(h, 6))
    builder.Connect(disturbance.get_output_port(), disturbance_hold.get_input_port())
    actuator: LeafSystem = hold
    if scenario.world.rotors.kind == "first_order":
        actuator = builder.AddSystem(Rotors_[float](scenario.vehicle))
        builder.Connect(hold.get_output_port(), actuator.get_input_port())
    direct = plant.GetInputPort("control") if sampled else None  # a sampled plant samples and holds its inputs itself
    if command_period is not None:
        failsafe = builder.AddSystem(Failsafe(scenario.failsafe, scenario.vehicle, command_period))
        builder.ExportInput(failsafe.GetInputPort("command"), "command")
        builder.Connect(failsafe.GetOutputPort("control"), hold.get_input_port())
        builder.Connect(plant.GetOutputPort("state"), failsafe.GetInputPort("state"))
        builder.ExportOutput(failsafe.GetOutputPort("mode"), "failsafe_mode")
    elif scenario.command_link == CommandLinkSettings():  # a perfect link
        control = builder.ExportInput(hold.get_input_port(), "control")
        if direct is not None:
            builder.ConnectInput(control, direct)
    else:
        link = builder.AddSystem(CommandLink_[float](scenario.command_link, scenario.vehicle, scenario.seed, h))
        builder.ExportInput(link.get_input_port(), "control")
        builder.Connect(link.get_output_port(), hold.get_input_port())
        if direct is not None:
            builder.Connect(link.get_output_port(), direct)
    if sampled:
        builder.Connect(disturbance.get_output_port(), plant.GetInputPort("disturbance"))
    else:
        builder.Connect(actuator.get_output_port(), plant.GetInputPort("control"))
        builder.Connect(disturbance_hold.get_output_port(), plant.GetInputPort("disturbance"))
    return plant, {
        "state": plant.GetOutputPort("state"),
        "control": actuator.get_output_port(),
        "disturbance": disturbance_hold.get_output_port(),
    }


def _add_link(
    builder: DiagramBuilder, scenario: Scenario, sensor: str, source: System, ports: Ports, latency: int = 0
) -> OutputPort:
    """Connect a sensor to what it sees and add the link of its messages; return where they come out."""
    for name, port in ports.items():
        if source.HasInputPort(name):
            builder.Connect(port, source.GetInputPort(name))
    message = source.get_output_port()
    settings = scenario.link_of(sensor)
    settings = settings.model_copy(update={"delay": settings.delay + latency})
    if settings == Link():  # a perfect link
        link = builder.AddNamedSystem(f"{sensor}_link", PassThrough(message.size()))
        builder.Connect(message, link.get_input_port())
    else:
        link = builder.AddSystem(SensorLink_[float](sensor, message.size(), settings, scenario.seed, scenario.h))
        builder.Connect(message, link.GetInputPort("message"))
        builder.Connect(ports["state"], link.GetInputPort("state"))
    delivered: OutputPort = link.get_output_port()
    return delivered


def _add_rendered_camera(builder: DiagramBuilder, scenario: Scenario, room: Room, ports: Ports) -> None:
    """Add a camera whose pictures Drake renders, with its shutter's link."""
    width, link = scenario.camera.width, scenario.link_of("camera")
    rendered = builder.AddSystem(make_rendered_camera(room, width))
    builder.Connect(ports["state"], rendered.GetInputPort("state"))
    shutter = _add_link(builder, scenario, "camera", builder.AddSystem(Shutter()), ports)
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
