"""The scene and its renderer, against the survey, OpenCV's projection and plain geometry."""

import ctypes

import cv2
import numpy as np
import pytest
from pydrake.geometry import Box, ReadObjToTriangleSurfaceMesh, Rgba, SceneGraph
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from ortilo_drake.diagrams.rendered_camera import make_rendered_camera
from ortilo_drake.model.equations import rotation_matrix
from ortilo_drake.model.pinhole import extent_box
from ortilo_drake.model.room import Landmark, load_room
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.world.scenery import rendering
from ortilo_drake.world.scenery.obj_normals import with_face_normals, without_normals
from ortilo_drake.world.scenery.rendering import camera_in_body, check_egl, make_scene_graph, render_cameras
from ortilo_drake.world.scenery.scene import NO_LANDMARK, SceneItem, mesh_file, scene_items

ROOM = load_room()
CAMERA = ROOM.camera.scaled_to(320)
ITEMS = scene_items(ROOM)
LANDMARKS = [item for item in ITEMS if item.group == "landmarks"]


def in_group(group):
    return [item for item in ITEMS if item.group == group]


def vertices_W(item):
    p_GV = np.array(ReadObjToTriangleSurfaceMesh(mesh_file(item.kind)).vertices()) * item.shape.scale3()
    return (item.X_WG @ p_GV.T).T


class Eye:
    """Pictures of items from a body pose."""

    def __init__(self, items, width=320):
        self._camera = ROOM.camera.scaled_to(width)
        self._graph = make_scene_graph(items)
        self._query = self._graph.get_query_output_port().Eval(self._graph.CreateDefaultContext())

    def __call__(self, kind, X_WB):
        camera = render_cameras(self._camera)[kind == "Depth"]
        render = getattr(self._query, f"Render{kind}Image")
        return render(camera, SceneGraph.world_frame_id(), X_WB @ camera_in_body(self._camera)).data.copy()


@pytest.fixture(scope="module")
def room_eye():
    return Eye(ITEMS)


def body(x, y, z, yaw=0.0, roll=0.0, pitch=0.0):
    return RigidTransform(RollPitchYaw(roll, pitch, yaw), [x, y, z])


# --- the scene ------------------------------------------------------------------------------------------------


def test_every_landmark_is_where_and_as_large_as_it_was_surveyed():
    assert [item.landmark for item in LANDMARKS] == list(range(len(ROOM.landmarks)))
    for landmark, item in zip(ROOM.landmarks, LANDMARKS, strict=True):
        assert item.kind == landmark.label
        X_LW = RigidTransform(RotationMatrix.MakeZRotation(landmark.yaw), landmark.position).inverse()
        own = (X_LW @ vertices_W(item).T).T
        half = np.array(landmark.size or ROOM.landmark_size[landmark.label]) / 2
        np.testing.assert_allclose(own.max(axis=0), half, atol=0.001)
        np.testing.assert_allclose(own.min(axis=0), -half, atol=0.001)


def test_walls_and_stands_fill_their_sizes():
    assert len(in_group("walls")) == len(ROOM.walls)
    for (x, y, z, yaw, *half), item in zip(ROOM.wall_boxes, in_group("walls"), strict=True):
        own = (RigidTransform(RotationMatrix.MakeZRotation(yaw), [x, y, z]).inverse() @ vertices_W(item).T).T
        np.testing.assert_allclose([own.min(axis=0), own.max(axis=0)], [-np.array(half), half], atol=0.001)
    for (x, y, radius, height), item in zip(ROOM.stand_cylinders, in_group("stands"), strict=True):
        points = vertices_W(item)
        np.testing.assert_allclose(points.min(axis=0), [x - radius, y - radius, 0.0], atol=0.001)
        np.testing.assert_allclose(points.max(axis=0), [x + radius, y + radius, height], atol=0.001)


def carried_by(room, landmark, items):
    """What is below or beside a landmark: floor, stand, post or wall; found from points, not from the scene's rules."""
    x, y, z = landmark.position
    size = np.array(landmark.size or room.landmark_size[landmark.label])
    bottom = z - size[2] / 2
    if bottom < 0.1:
        return "floor"
    for item in items:
        if item.group == "posts":
            top = item.X_WG.translation()[2] + item.shape.length() / 2
            if np.allclose(item.X_WG.translation()[:2], [x, y]) and abs(top - bottom) < 1e-9:
                return "post"
    if any(np.hypot(x - a, y - b) < r and abs(bottom - top) < 0.1 for a, b, r, top in room.stand_cylinders):
        return "stand"
    for a, b, _, yaw, half_x, half_y, _ in room.wall_boxes:
        corners = np.array([[half_x, half_y], [-half_x, half_y], [-half_x, -half_y], [half_x, -half_y]])
        turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        outline = (corners @ turn.T + [a, b]).astype(np.float32)
        if -cv2.pointPolygonTest(outline, (float(x), float(y)), True) < 0.36:
            return "wall"
    return None


def test_no_landmark_floats_and_every_post_carries_one():
    held = [carried_by(ROOM, landmark, ITEMS) for landmark in ROOM.landmarks]
    assert None not in held
    assert held.count("post") == len(in_group("posts"))
    for post in in_group("posts"):
        foot = post.X_WG.translation() - [0, 0, post.shape.length() / 2]
        under = [height for x, y, r, height in ROOM.stand_cylinders if np.hypot(foot[0] - x, foot[1] - y) < r]
        assert foot[2] == pytest.approx(0.0) or any(foot[2] == pytest.approx(height) for height in under)


def test_a_landmark_in_the_air_gets_a_post_from_the_floor():
    room = ROOM.model_copy(update={"landmarks": (Landmark(label="clock", position=(2.0, 0.0, 1.8)),), "stands": ()})
    (post,) = [item for item in scene_items(room) if item.group == "posts"]
    bottom = 1.8 - ROOM.landmark_size["clock"][2] / 2
    assert post.shape.length() == pytest.approx(bottom)
    np.testing.assert_allclose(post.X_WG.translation(), [2.0, 0.0, bottom / 2])
    assert carried_by(room, room.landmarks[0], scene_items(room)) == "post"


def test_a_class_without_a_mesh_is_a_block_of_its_size():
    room = ROOM.model_copy(
        update={
            "landmarks": (Landmark(label="sofa", position=(2.0, 0.0, 0.4), yaw=0.3),),
            "landmark_size": {"sofa": (0.9, 2.0, 0.8)},
        }
    )
    (item,) = [item for item in scene_items(room) if item.group == "landmarks"]
    assert item.shape.size() == pytest.approx([0.9, 2.0, 0.8])


def test_furniture_that_is_a_landmark_is_not_shown_twice():
    near = [np.min(np.hypot(*(ROOM.landmark_positions[:, :2] - row[1:3]).T)) < 0.4 for row in ROOM.furniture]
    assert any(near)
    assert len(in_group("furniture")) == len(ROOM.furniture) - sum(near)


# --- the renderer ---------------------------------------------------------------------------------------------


@pytest.mark.long
def test_boxes_of_labels_agree_with_projected_outlines():
    """In pixels of the picture that flies; drawn finer, so that a pointed ear is not missed."""
    fine, differences = 4, []
    for item in LANDMARKS[:14]:  # all classes
        eye, i = Eye([item], fine * CAMERA.width), item.landmark
        for k, (yaw, distance) in enumerate([(0.4, 2.2), (-1.9, 3.1), (2.6, 4.5)]):
            p_WB = ROOM.landmark_positions[i] - distance * np.array([np.cos(yaw), np.sin(yaw), -0.1])
            rpy = np.array([0.05 * (k - 1), -0.03 * (k - 1), yaw])
            box = np.empty(4)
            shape = ROOM.landmark_positions[i], ROOM.landmark_outlines[i]
            assert extent_box(*shape, p_WB, rotation_matrix(rpy), CAMERA.constants, box)
            label = eye("Label", body(*p_WB, yaw, rpy[0], rpy[1])).squeeze()
            v, u = np.nonzero(label == i)
            edges = np.array([u.min(), v.min(), u.max() + 1, v.max() + 1]) / fine - 0.5
            whole = box.min() > 0 and box[2] < CAMERA.width - 1 and box[3] < CAMERA.height - 1
            if whole:
                differences.append(edges - box)
    assert len(differences) > 30
    assert np.abs(differences).max() < 0.6


@pytest.mark.parametrize("width", [320, 640])
def test_a_box_is_seen_where_opencv_projects_it(width):
    camera = ROOM.camera.scaled_to(width)
    size, X_WG = np.array([0.6, 0.8, 0.5]), RigidTransform(RollPitchYaw(0.1, 0.2, 0.6), [3.4, 0.3, 1.2])
    red = SceneItem("furniture", "block", Box(*size), X_WG, NO_LANDMARK, Rgba(0.9, 0.0, 0.0, 1.0))
    graph = make_scene_graph([red], background=(0.0, 0.0, 1.0))
    query = graph.get_query_output_port().Eval(graph.CreateDefaultContext())
    X_WC = body(0.2, -0.1, 1.5, 0.05, 0.04, -0.03) @ camera_in_body(camera)
    image = query.RenderColorImage(render_cameras(camera)[0], SceneGraph.world_frame_id(), X_WC).data
    shown = image[..., 2] < 128
    corners = size / 2 * np.array([[a, b, c] for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)])
    X_CG = X_WC.inverse() @ X_WG
    f, (c_u, c_v) = camera.focal_length, camera.center
    matrix = np.array([[f, 0.0, c_u], [0.0, f, c_v], [0.0, 0.0, 1.0]])
    turn = cv2.Rodrigues(X_CG.rotation().matrix())[0]
    pixels = cv2.projectPoints(corners, turn, X_CG.translation(), matrix, None)[0].reshape(-1, 2)
    outline = cv2.convexHull(pixels.astype(np.float32))
    # A pixel is the block's if its centre, which has integer coordinates, lies within the outline.
    inside = np.array(
        [[cv2.pointPolygonTest(outline, (u, v), True) for u in range(camera.width)] for v in range(camera.height)]
    )
    clear = np.abs(inside) > 0.05
    np.testing.assert_array_equal(shown[clear], inside[clear] > 0)
    assert shown.sum() > 1000


def test_depth_at_a_wall_is_its_distance(room_eye):
    east = max(ROOM.wall_boxes, key=lambda row: row[0])
    face = east[0] - east[5]  # it is turned by a right angle
    p_BC = np.array(CAMERA.position)
    x = face - 4.0 - p_BC[0]
    depth = room_eye("Depth", body(x, east[1], 2.2))
    v, u = round(CAMERA.center[1]), round(CAMERA.center[0])
    np.testing.assert_allclose(depth[v - 3 : v + 4, u - 3 : u + 4], 4.0, atol=1e-3)


@pytest.mark.long
def test_the_same_pose_gives_the_same_picture_in_any_renderer(room_eye):
    other = Eye(scene_items(ROOM))
    X_WB = body(9.0, 0.8, 1.5, 0.1, 0.02, -0.01)
    first = room_eye("Color", X_WB)
    room_eye("Color", body(20.0, -2.0, 1.5))
    assert first.std() > 20
    np.testing.assert_array_equal(room_eye("Color", X_WB), first)
    np.testing.assert_array_equal(other("Color", X_WB), first)
    rendered = make_rendered_camera(ROOM, 320)
    context = rendered.CreateDefaultContext()
    x = np.array([9.0, 0.8, 1.5, 0.02, -0.01, 0.1, *np.zeros(6)])
    rendered.GetInputPort("state").FixValue(context, x)
    np.testing.assert_array_equal(rendered.GetOutputPort("color_image").Eval(context).data, first)


def test_without_egl_one_line_says_what_to_install(monkeypatch):
    def missing(name):
        raise OSError(f"{name}: cannot open shared object file")

    rendering._egl_works.cache_clear()
    try:
        with monkeypatch.context() as patch:
            patch.setattr(ctypes, "CDLL", missing)
            with pytest.raises(InputError, match=r"EGL.*apt-get install libegl1 libgl1-mesa-dri.*camera.projected"):
                check_egl()
    finally:
        rendering._egl_works.cache_clear()
    check_egl()


# --- meshes with and without normals --------------------------------------------------------------------------


def test_a_mesh_without_normals_has_the_same_faces_and_is_smaller():
    path = mesh_file("dog")
    mesh = without_normals(path)
    text = mesh.mesh_file.contents().decode()
    assert "vn " not in text
    assert len(text) < 0.6 * path.stat().st_size
    corners = [
        [corner.split("/") for corner in line.split()[1:]]
        for t in (path.read_text(), text)
        for line in t.splitlines()
        if line.startswith("f ")
    ]
    there, here = corners[: len(corners) // 2], corners[len(corners) // 2 :]
    assert [[corner[:2] for corner in face] for face in there] == here
    assert set(mesh.supporting_files) == {"dog.mtl", "dog.png"}


@pytest.mark.long
def test_face_normals_are_those_of_the_faces():
    path = mesh_file("m100")
    text = with_face_normals(path.read_text(), path).mesh_file.contents().decode()
    rows = {
        key: [line.split()[1:] for line in text.splitlines() if line.startswith(key + " ")] for key in ("v", "vn", "f")
    }
    v, vn = np.array(rows["v"], dtype=float), np.array(rows["vn"], dtype=float)
    assert len(rows["f"]) == len(vn) == path.read_text().count("\nf ")
    for face, normal in zip(rows["f"], vn, strict=True):
        a, b, c = (v[int(corner.split("//")[0]) - 1] for corner in face)
        assert {int(corner.split("//")[1]) for corner in face} <= set(range(1, len(vn) + 1))
        assert np.linalg.norm(normal) == pytest.approx(1.0, abs=2e-3)
        np.testing.assert_allclose([normal @ (b - a), normal @ (c - a)], 0.0, atol=1e-3)
        assert normal @ np.cross(b - a, c - a) > 0
