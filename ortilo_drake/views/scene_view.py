"""Pictures of a recorded state: the picture of the vehicle's camera, and the vehicle in its room."""

from collections.abc import Callable

import numpy as np
from pydrake.geometry import (
    ClippingRange,
    ColorRenderCamera,
    FramePoseVector,
    GeometryFrame,
    GeometryInstance,
    Mesh,
    PerceptionProperties,
    RenderCameraCore,
    RenderLabel,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.sensors import CameraInfo

from ortilo_drake.diagrams.rendered_camera import make_rendered_camera
from ortilo_drake.diagrams.wiring.world import sensor_system
from ortilo_drake.model.geometry.line_of_sight import is_hidden
from ortilo_drake.model.optional import later
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import DETECTION_SIZE, PAYLOAD
from ortilo_drake.model.vehicle import M100, Vehicle
from ortilo_drake.onboard.detector.detector import detections_message
from ortilo_drake.onboard.detector.detector_network import load_detector
from ortilo_drake.scenario import Scenario
from ortilo_drake.world.scenery.meshcat_replay import pose
from ortilo_drake.world.scenery.meshcat_room import class_color
from ortilo_drake.world.scenery.obj_normals import with_face_normals
from ortilo_drake.world.scenery.rendering import FARTHEST, NEAREST, RENDERER, make_scene_graph
from ortilo_drake.world.scenery.scene import scene_items
from ortilo_drake.world.scenery.vehicle_mesh import M100_MESH, vehicle_obj

cv2 = later("cv2")

BEHIND = np.array(
    [-4.2, -1.0, 3.4]
)  # position of the viewer relative to the vehicle in W, steep enough to look over low walls behind [m]
AHEAD = np.array([1.2, 0.0, -0.2])  # the point that the viewer looks at, relative to the vehicle in W [m]
VIEW_ANGLE = np.deg2rad(55.0)  # vertical angle of view [rad]
PLANNED, FLOWN = (230, 160, 60), (20, 20, 230)  # colours of the paths: blue, green, red

CameraView = Callable[[float, np.ndarray], tuple[np.ndarray, np.ndarray]]
RoomView = Callable[[np.ndarray, np.ndarray], np.ndarray]


def make_camera_view(scenario: Scenario) -> CameraView:
    """Return the function from a time [s] and a state (12) to the camera's picture and the boxes found in the picture.

    A flight keeps no pictures, but the same state gives the same picture, and the same picture or seed the same boxes.
    The picture is BGR (height x width x 3), uint8; the boxes are the rows of a detections message (k x 6).
    InputError if there is no EGL or a file of the detector is wrong.
    """
    room, width = scenario.load_room(), scenario.image_width
    rendered = make_rendered_camera(room, width)
    context = rendered.CreateDefaultContext()
    if scenario.is_rendered:
        camera = room.camera.scaled_to(width)
        detect = load_detector(scenario.detector, room, (camera.width, camera.height))
    else:
        projected = sensor_system(scenario, room, "camera")
        projected_context = projected.CreateDefaultContext()
        projected.set_seed_in(projected_context, scenario.seed)

    def view(time: float, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        rendered.GetInputPort("state").FixValue(context, x)
        image = rendered.GetOutputPort("color_image").Eval(context).data[..., :3]
        if scenario.is_rendered:
            message = detections_message(time, *detect(image))
        else:
            projected.GetInputPort("state").FixValue(projected_context, x)
            projected_context.SetTime(time)
            message = projected.get_output_port().Eval(projected_context)
        rows = message[PAYLOAD:].reshape(-1, DETECTION_SIZE)
        return np.ascontiguousarray(image[..., ::-1]), rows[rows[:, 0] >= 0]

    return view


def class_bgr(room: Room, label: str) -> tuple[int, int, int]:
    """Return the colour of a landmark class as blue, green, red."""
    rgba = class_color(room, label)
    return round(255 * rgba.b()), round(255 * rgba.g()), round(255 * rgba.r())


def draw_boxes(picture: np.ndarray, boxes: np.ndarray, room: Room, scale: float) -> None:
    """Draw boxes with class and score into a camera picture (height x width x 3) that was enlarged by `scale`.

    The boxes are rows label, score, u_min, v_min, u_max, v_max (k x 6), in pixels of the original picture. The room
    gives names and colours of the classes.
    """
    for label, score, *box in boxes:
        name = room.classes[int(label)]
        color = class_bgr(room, name)
        # A pixel's centre has integer coordinates, before and after enlarging.
        low_u, low_v, high_u, high_v = np.round((np.array(box) + 0.5) * scale - 0.5).astype(int).tolist()
        cv2.rectangle(picture, (low_u, low_v), (high_u, high_v), color, 1)
        text = f"{name} {score:.2f}"
        (text_width, text_height), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.35, 1)
        bottom = low_v - 1 if low_v > text_height + 5 else min(high_v + text_height + 5, picture.shape[0] - 1)
        left = max(0, min(low_u, picture.shape[1] - text_width - 5))
        cv2.rectangle(picture, (left, bottom - text_height - 4), (left + text_width + 4, bottom), color, cv2.FILLED)
        white = (255, 255, 255)
        cv2.putText(picture, text, (left + 2, bottom - 2), cv2.FONT_HERSHEY_SIMPLEX, 0.35, white, 1, cv2.LINE_AA)


def viewer_pose(p_WB: np.ndarray) -> RigidTransform:
    """Return the pose X_WV of the viewer behind and above a vehicle at p_WB [m] (V: right, down, forward)."""
    forward = (AHEAD - BEHIND) / np.linalg.norm(AHEAD - BEHIND)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return RigidTransform(RotationMatrix(np.column_stack([right, np.cross(forward, right), forward])), p_WB + BEHIND)


def _draw_line(picture: np.ndarray, points: np.ndarray, seen: np.ndarray, color: tuple[int, int, int]) -> None:
    """Draw the parts of a line through points (n x 2) [px] whose two ends are seen (n)."""
    fine = np.round(np.clip(points, -4000, 4000) * 16).astype(np.int32)  # sixteenths of a pixel
    for k in np.flatnonzero(seen[:-1] & seen[1:]):
        cv2.line(picture, tuple(fine[k].tolist()), tuple(fine[k + 1].tolist()), color, 1, cv2.LINE_AA, 4)


def make_room_view(room: Room, planned: np.ndarray, width: int, height: int, vehicle: Vehicle = M100) -> RoomView:
    """Return the function from a state (12) and a flown path p_W (m x 3) [m] to a picture of the vehicle in the room.

    The view is from the west, behind and above; the walls on that side are left out. The planned path p_W (n x 3) [m]
    is blue, the flown path red; both are drawn only where no wall hides them. The picture is BGR (height x width x 3),
    uint8. The vehicle is drawn with its own arms. InputError if there is no EGL.
    """
    west = room.interior.min[0]
    items = scene_items(room)
    kept = [item for item in items if not (item.group == "walls" and item.X_WG.translation()[0] < west)]
    walls = room.wall_boxes[room.wall_boxes[:, 0] >= west]
    scene_graph = make_scene_graph(kept)
    source = scene_graph.RegisterSource("vehicle")
    frame = scene_graph.RegisterFrame(source, GeometryFrame("body"))
    airframe = GeometryInstance(RigidTransform(), Mesh(with_face_normals(vehicle_obj(vehicle), M100_MESH)), "vehicle")
    properties = PerceptionProperties()
    properties.AddProperty("label", "id", RenderLabel.kDontCare)
    airframe.set_perception_properties(properties)
    scene_graph.RegisterGeometry(source, frame, airframe)
    info = CameraInfo(width, height, VIEW_ANGLE)
    camera = ColorRenderCamera(RenderCameraCore(RENDERER, info, ClippingRange(NEAREST, 2 * FARTHEST), RigidTransform()))
    context = scene_graph.CreateDefaultContext()
    center = np.array([info.center_x(), info.center_y()])

    def view(x: np.ndarray, flown: np.ndarray) -> np.ndarray:
        poses = FramePoseVector()
        poses.set_value(id=frame, value=pose(x))
        scene_graph.get_source_pose_port(source).FixValue(context, poses)
        X_WV = viewer_pose(x[0:3])
        query = scene_graph.get_query_output_port().Eval(context)
        image = query.RenderColorImage(camera, scene_graph.world_frame_id(), X_WV).data
        picture = np.ascontiguousarray(image[..., 2::-1])
        p_WV = X_WV.translation()
        for points, color in ((planned, PLANNED), (flown, FLOWN)):
            x_V, y_V, z_V = X_WV.inverse() @ points.T
            uv = np.column_stack([x_V, y_V]) * info.focal_x() / np.maximum(z_V, NEAREST)[:, np.newaxis] + center
            seen = z_V > NEAREST
            seen[seen] = [not is_hidden(p_WV, p, walls, room.stand_cylinders) for p in points[seen]]
            _draw_line(picture, uv, seen, color)
        return picture

    return view
