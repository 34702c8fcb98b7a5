"""The world: the vehicle, its sensors and the link."""

from pydrake.systems.framework import Diagram, DiagramBuilder, LeafSystem, OutputPort
from pydrake.systems.primitives import PassThrough, ZeroOrderHold

from ortilo_drake.diagrams.rendered_camera import make_rendered_camera
from ortilo_drake.model.signals import DETECTIONS_SIZE, IMU_SIZE, N_U, SHUTTER_SIZE, uwb_size
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import CommandLink as CommandLinkSettings
from ortilo_drake.scenario import Link, Scenario
from ortilo_drake.world.radio.command_link import CommandLink
from ortilo_drake.world.radio.image_delay import ImageDelay, check_kept
from ortilo_drake.world.radio.link import SensorLink
from ortilo_drake.world.sensors.imu import Imu
from ortilo_drake.world.sensors.projected_camera import ProjectedCamera
from ortilo_drake.world.sensors.shutter import Shutter
from ortilo_drake.world.sensors.true_velocity import TrueVelocity
from ortilo_drake.world.sensors.uwb import UwbRanging
from ortilo_drake.world.vehicle.disturbance import DisturbanceSource
from ortilo_drake.world.vehicle.failsafe import Failsafe
from ortilo_drake.world.vehicle.quadrotor import QuadrotorPlant_
from ortilo_drake.world.vehicle.rotors import Rotors_


def make_world(scenario: Scenario, command_period: float | None = None) -> Diagram:
    """Return the world as a Diagram.

    In real time a command comes when it comes. With a command_period the world looks for one that often, through a
    failsafe, and Drake integrates the plant in between, whatever world.plant says; all else keeps its tick h.

    Ports:
        control (4): u = [f_T, tau_x, tau_y, tau_z] as commanded, sampled and held every tick; what the rotors get
            of it is the command link's affair, a perfect one adds nothing.
        command (5): with a command_period, in place of control: u and the time at which it was received [s].
        state (12, output): the true x.
        failsafe_mode (output): with a command_period, who flies: an index in world.failsafe.MODES.
        uwb, detections, imu (outputs): the messages of the sensors that the scenario flies.
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
    if command_period is not None and scenario.command_link != CommandLinkSettings():
        raise InputError("command_link: must be left as it is where commands come from outside, in real time")
    h, seed, room = scenario.h, scenario.seed, scenario.load_room()
    builder = DiagramBuilder()

    hold = builder.AddNamedSystem("hold", ZeroOrderHold(command_period or h, N_U))
    sampled = scenario.world.plant == "sampled" and command_period is None
    plant = builder.AddSystem(
        QuadrotorPlant_[float](scenario.vehicle, scenario.world.kinematics, time_step=h if sampled else 0.0)
    )
    disturbance = builder.AddSystem(DisturbanceSource(scenario.world.disturbance, seed, h))
    disturbance_hold = builder.AddNamedSystem("disturbance_hold", ZeroOrderHold(h, 6))
    actuator: LeafSystem = hold
    if scenario.world.rotors.kind == "first_order":
        actuator = builder.AddSystem(Rotors_[float](scenario.vehicle))
        builder.Connect(hold.get_output_port(), actuator.get_input_port())
    command_link = fallback = None
    if command_period is not None:
        fallback = builder.AddSystem(Failsafe(scenario.failsafe, scenario.vehicle, command_period))
        builder.ExportInput(fallback.GetInputPort("command"), "command")
        builder.Connect(fallback.GetOutputPort("control"), hold.get_input_port())
    elif scenario.command_link == CommandLinkSettings():  # a perfect link
        control = builder.ExportInput(hold.get_input_port(), "control")
    else:
        command_link = builder.AddSystem(CommandLink(scenario.command_link, scenario.vehicle, seed, h))
        builder.ExportInput(command_link.get_input_port(), "control")
        builder.Connect(command_link.get_output_port(), hold.get_input_port())
    builder.Connect(disturbance.get_output_port(), disturbance_hold.get_input_port())
    if sampled:  # it samples and holds its inputs itself
        if command_link is None:
            builder.ConnectInput(control, plant.GetInputPort("control"))
        else:
            builder.Connect(command_link.get_output_port(), plant.GetInputPort("control"))
        builder.Connect(disturbance.get_output_port(), plant.GetInputPort("disturbance"))
    else:
        builder.Connect(actuator.get_output_port(), plant.GetInputPort("control"))
        builder.Connect(disturbance_hold.get_output_port(), plant.GetInputPort("disturbance"))
    state = plant.GetOutputPort("state")
    builder.ExportOutput(state, "state")
    if fallback is not None:
        builder.Connect(state, fallback.GetInputPort("state"))
        builder.ExportOutput(fallback.GetOutputPort("mode"), "failsafe_mode")

    def add_link(sensor: str, source: LeafSystem, size: int, message: str, latency: int = 0) -> OutputPort:
        if source.HasInputPort("state"):
            builder.Connect(state, source.GetInputPort("state"))
        settings = scenario.link_of(sensor)
        settings = settings.model_copy(update={"delay": settings.delay + latency})
        if settings == Link():  # a perfect link
            link = builder.AddNamedSystem(f"{sensor}_link", PassThrough(size))
            builder.Connect(source.get_output_port(), link.get_input_port())
        else:
            link = builder.AddSystem(SensorLink(sensor, size, settings, seed, h))
            builder.Connect(source.get_output_port(), link.GetInputPort("message"))
            builder.Connect(state, link.GetInputPort("state"))
        builder.ExportOutput(link.get_output_port(), message)
        return link.get_output_port()

    if "uwb" in scenario.sensors:
        ranging = builder.AddSystem(UwbRanging(scenario.uwb, room, seed, h))
        add_link("uwb", ranging, uwb_size(len(room.anchors)), "uwb")
    if scenario.is_rendered:
        rendered = builder.AddSystem(make_rendered_camera(room, scenario.camera.width))
        builder.Connect(state, rendered.GetInputPort("state"))
        shutter = add_link("camera", builder.AddSystem(Shutter()), SHUTTER_SIZE, "shutter")
        image = rendered.GetOutputPort("color_image")
        link = scenario.camera.link
        if link.delay or link.random_delay:
            camera = room.camera.scaled_to(scenario.camera.width)
            check_kept(scenario.every("camera"), link.delay + link.random_delay, camera.width, camera.height)
            kept = builder.AddSystem(ImageDelay(scenario.every("camera"), link.delay + link.random_delay, h))
            builder.Connect(image, kept.GetInputPort("color_image"))
            builder.Connect(shutter, kept.GetInputPort("shutter"))
            image = kept.get_output_port()
        builder.ExportOutput(image, "image")
        for name in ("depth_image", "label_image"):
            builder.ExportOutput(rendered.GetOutputPort(name), name)
    elif "camera" in scenario.sensors:
        camera = builder.AddSystem(ProjectedCamera(scenario.camera, room, seed, h))
        add_link("camera", camera, DETECTIONS_SIZE, "detections", scenario.camera.latency)
    if "imu" in scenario.sensors:
        imu = builder.AddSystem(Imu(scenario.imu, scenario.vehicle.mass, seed, h))
        builder.Connect(actuator.get_output_port(), imu.GetInputPort("control"))
        builder.Connect(disturbance_hold.get_output_port(), imu.GetInputPort("disturbance"))
        add_link("imu", imu, IMU_SIZE, "imu")
    if scenario.servo.velocities == "truth":
        velocity = builder.AddSystem(TrueVelocity())
        builder.Connect(state, velocity.get_input_port())
        builder.ExportOutput(velocity.get_output_port(), "velocity")

    world = builder.Build()
    world.set_name("world")
    return world
