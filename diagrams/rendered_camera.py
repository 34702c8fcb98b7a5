"""The camera that renders: the room as Drake's VTK renderer shows it to an RgbdSensor on the vehicle."""

import numpy as np
from pydrake.geometry import GeometryFrame
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, OutputPort, System
from pydrake.systems.sensors import ImageDepth32F, ImageLabel16I, ImageRgba8U, RgbdSensor

from ortilo_drake.model.room import Room
from ortilo_drake.scenario import Scenario
from ortilo_drake.world.drawn_truth import Drawn
from ortilo_drake.world.radio.image_delay import ImageDelay, check_kept
from ortilo_drake.world.scenery.bent_picture import BentPicture, straight_model
from ortilo_drake.world.scenery.rendering import (
    VehiclePose,
    camera_in_body,
    make_scene_graph,
    mount_camera,
    move_landmarks,
    render_cameras,
)
from ortilo_drake.world.scenery.scene import scene_items

NOTHING = 32766  # the label where there is nothing


def make_rendered_camera(room: Room, width: int) -> Diagram:
    """Return the room with the vehicle's forward camera in it.

    Nothing is drawn but what is asked for, when it is asked for.

    Ports:
        state (12): x of the vehicle.
        color_image (ImageRgba8U, output): what the camera sees.
        depth_image (ImageDepth32F, output): depth along C's z axis [m].
        label_image (ImageLabel16I, output): the number of the landmark at each pixel; 32764 elsewhere in the room,
            32766 where there is nothing.

    Args:
        room: the room; its camera is scaled to the width.
        width: image width [px].

    Raises:
        InputError: if there is no EGL, or the lens looks too far aside to be drawn.
    """
    builder = DiagramBuilder()
    scene_graph = builder.AddNamedSystem("scene_graph", make_scene_graph(scene_items(room)))
    source = scene_graph.RegisterSource("vehicle")
    frame = scene_graph.RegisterFrame(source, GeometryFrame("body"))
    pose = builder.AddSystem(VehiclePose(frame))
    builder.Connect(pose.get_output_port(), scene_graph.get_source_pose_port(source))
    camera = room.camera.scaled_to(width)
    drawn = straight_model(camera) if camera.coefficients else camera
    sensor = builder.AddNamedSystem("rgbd_sensor", RgbdSensor(frame, camera_in_body(camera), *render_cameras(drawn)))
    builder.Connect(scene_graph.get_query_output_port(), sensor.query_object_input_port())
    builder.ExportInput(pose.get_input_port(), "state")
    for name, port, kind, outside in (
        ("color_image", sensor.color_image_output_port(), ImageRgba8U, 0),
        ("depth_image", sensor.depth_image_32F_output_port(), ImageDepth32F, np.inf),
        ("label_image", sensor.label_image_output_port(), ImageLabel16I, NOTHING),
    ):
        if camera.coefficients:
            bent = builder.AddSystem(BentPicture(camera, kind, outside))
            builder.Connect(port, bent.get_input_port())
            port = bent.get_output_port()
        builder.ExportOutput(port, name)
    diagram = builder.Build()
    diagram.set_name("rendered_camera")
    return diagram


def add_rendered_camera(
    builder: DiagramBuilder, scenario: Scenario, room: Room, seen: OutputPort, shutter: OutputPort
) -> None:
    """Add a camera whose pictures Drake renders of the state as it is seen; those that come late are kept."""
    width, link = scenario.camera.width, scenario.link_of("camera")
    rendered = builder.AddSystem(make_rendered_camera(room, width))
    builder.Connect(seen, rendered.GetInputPort("state"))
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


def move_scene(camera: System, context: Context, room: Room, drawn: Drawn) -> None:
    """Move the landmarks and the camera of a rendered camera to where they are drawn to be; the root's context."""
    scene_graph, sensor = (camera.GetSubsystemByName(name) for name in ("scene_graph", "rgbd_sensor"))
    p_WL = room.landmark_positions + drawn["survey.landmarks"]
    move_landmarks(scene_graph, scene_graph.GetMyMutableContextFromRoot(context), p_WL)
    p_BC = np.array(room.camera.position) + drawn["camera.position"]
    its = sensor.GetMyMutableContextFromRoot(context)
    mount_camera(sensor, its, p_BC, drawn["camera.angles"], float(drawn["camera.focal_factor"]))
