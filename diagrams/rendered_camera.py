"""The camera that renders: the room as Drake's VTK renderer shows it to an RgbdSensor on the vehicle."""

from pydrake.geometry import GeometryFrame
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.sensors import RgbdSensor

from ortilo_drake.model.room import Room
from ortilo_drake.world.scenery.rendering import camera_in_body, make_scene_graph, render_cameras
from ortilo_drake.world.scenery.scene import scene_items
from ortilo_drake.world.scenery.vehicle_pose import VehiclePose


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
        InputError: if there is no EGL.
    """
    builder = DiagramBuilder()
    scene_graph = builder.AddNamedSystem("scene_graph", make_scene_graph(scene_items(room)))
    source = scene_graph.RegisterSource("vehicle")
    frame = scene_graph.RegisterFrame(source, GeometryFrame("body"))
    pose = builder.AddSystem(VehiclePose(frame))
    builder.Connect(pose.get_output_port(), scene_graph.get_source_pose_port(source))
    camera = room.camera.scaled_to(width)
    sensor = builder.AddNamedSystem("rgbd_sensor", RgbdSensor(frame, camera_in_body(camera), *render_cameras(camera)))
    builder.Connect(scene_graph.get_query_output_port(), sensor.query_object_input_port())
    builder.ExportInput(pose.get_input_port(), "state")
    builder.ExportOutput(sensor.color_image_output_port(), "color_image")
    builder.ExportOutput(sensor.depth_image_32F_output_port(), "depth_image")
    builder.ExportOutput(sensor.label_image_output_port(), "label_image")
    diagram = builder.Build()
    diagram.set_name("rendered_camera")
    return diagram
