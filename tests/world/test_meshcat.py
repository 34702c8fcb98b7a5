import base64
import itertools
import re
import runpy
from collections import Counter
from pathlib import Path

import msgpack
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from pydrake.geometry import Mesh, Meshcat, ReadObjToTriangleSurfaceMesh
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from ortilo_drake.model.room import load_room
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.model.vehicle import M100
from ortilo_drake.scenario import load_scenario
from ortilo_drake.world.scenery.meshcat_flight import CHUNK, MeshcatFlight
from ortilo_drake.world.scenery.meshcat_replay import (
    PLANNED_PATH,
    TRUE,
    draw_path,
    draw_plan,
    draw_vehicle,
    html_replay,
    sigma_ellipsoid,
    tube,
)
from ortilo_drake.world.scenery.meshcat_room import draw_room, make_meshcat
from ortilo_drake.world.scenery.scene import scene_items
from ortilo_drake.world.scenery.vehicle_mesh import M100_MESH, vehicle_obj

SCRIPT = Path(__file__).parents[2] / "scripts" / "make_vehicle_mesh.py"
EXAMPLES = Path(__file__).parents[2] / "examples"
ROOM = load_room()
h = 1 / 30


@pytest.fixture(scope="module")
def meshcat():
    return make_meshcat()


def transform(meshcat: Meshcat, path: str) -> np.ndarray:
    """The 4x4 matrix that the browser is sent, which is column by column."""
    message = msgpack.unpackb(meshcat._GetPackedTransform(path))
    return np.array(message["matrix"]).reshape(4, 4).T


def scale(meshcat: Meshcat) -> list[float]:
    return msgpack.unpackb(meshcat._GetPackedProperty("/flight/ellipsoid", "scale"))["value"]


def scene_object(meshcat: Meshcat, path: str) -> dict:
    return msgpack.unpackb(meshcat._GetPackedObject(path))["object"]


def vertices(meshcat: Meshcat, path: str) -> np.ndarray:
    data = scene_object(meshcat, path)["geometries"][0]["data"]
    return np.frombuffer(data["attributes"]["position"]["array"].data, dtype=np.float32).reshape(-1, 3)


def parts_of(obj: str) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Vertices and faces of each part of an OBJ text."""
    points, faces, name = [], {}, ""
    for words in map(str.split, obj.splitlines()):
        if words[0] == "o":
            name = words[1]
            faces[name] = []
        elif words[0] == "v":
            points.append([float(w) for w in words[1:]])
        elif words[0] == "f":
            faces[name].append([int(w) - 1 for w in words[1:]])
    return {name: (np.array(points), np.array(f)) for name, f in faces.items()}


@pytest.mark.long
def test_the_script_writes_the_shipped_mesh(tmp_path):
    runpy.run_path(str(SCRIPT))["main"](tmp_path)
    for name in ("m100.obj", "m100.mtl"):
        assert (tmp_path / name).read_bytes() == M100_MESH.with_name(name).read_bytes()
    assert M100_MESH.stat().st_size < 200_000


def test_every_part_of_the_mesh_is_closed_with_outward_faces():
    parts = parts_of(M100_MESH.read_text())
    assert len(parts) == 5 + 4 * 6
    for name, (points, faces) in parts.items():
        edges = Counter((a, b) for face in faces for a, b in zip(face, np.roll(face, -1), strict=True))
        assert set(edges.values()) == {1}, name
        assert {(b, a) for a, b in edges} == set(edges), name
        a, b, c = (points[faces[:, i]] for i in range(3))
        # Gauss: volume and area vector of a closed surface.
        assert np.einsum("ij,ij->", a, np.cross(b, c)) / 6 > 1e-7, name
        np.testing.assert_allclose(np.cross(b - a, c - a).sum(axis=0), 0.0, atol=1e-12)


def test_a_hexarotor_is_drawn_with_its_own_arms():
    firefly = load_scenario("nominal_imu_uwb", (f"vehicle={EXAMPLES / 'hexarotor.yaml'}",)).vehicle
    parts = parts_of(vehicle_obj(firefly))
    assert len(parts) == 5 + 6 * 6
    points = np.vstack([points[np.unique(faces)] for points, faces in parts.values()])
    assert np.hypot(*points[:, :2].T).max() == pytest.approx(firefly.radius, abs=1e-4)
    for i, arm in enumerate(firefly.arms):
        vertices, faces = parts[f"propeller_{i}"]
        disc = vertices[np.unique(faces)]
        axis = 0.215 * np.array([np.cos(arm.angle), np.sin(arm.angle)])
        np.testing.assert_allclose(disc.mean(axis=0)[:2], axis, atol=1e-5)
        assert np.hypot(*(disc[:, :2] - axis).T).max() == pytest.approx(0.1, abs=1e-4)  # RotorS: radius_rotor


def test_the_ghost_and_the_vehicle_have_the_same_arms(meshcat):
    firefly = load_scenario("nominal_imu_uwb", (f"vehicle={EXAMPLES / 'hexarotor.yaml'}",)).vehicle
    draw_vehicle(meshcat, firefly)
    points = vertices(meshcat, "/flight/estimate")
    assert np.hypot(*points[:, :2].T).max() == pytest.approx(firefly.radius, abs=1e-4)
    assert b"propeller_5" in meshcat._GetPackedObject("/flight/vehicle")


def test_the_mesh_has_the_vehicles_size():
    points = np.array(ReadObjToTriangleSurfaceMesh(M100_MESH).vertices())
    reach = 0.65 / 2 * np.sqrt(0.5) + 13 * 0.0254 / 2
    assert np.hypot(*points[:, :2].T).max() <= M100.radius + 0.001
    np.testing.assert_allclose(points[:, :2].max(axis=0), reach, atol=0.002)
    np.testing.assert_allclose(points[:, :2].min(axis=0), -reach, atol=0.002)
    assert -0.25 < points[:, 2].min() < -0.15
    assert 0.04 < points[:, 2].max() < 0.15


def test_every_material_is_a_plain_colour():
    library = M100_MESH.with_suffix(".mtl").read_text()
    used = set(re.findall(r"^usemtl (\w+)$", M100_MESH.read_text(), re.M))
    assert used == set(re.findall(r"^newmtl (\w+)$", library, re.M))
    assert "map_" not in library
    assert "mtllib m100.mtl\n" in M100_MESH.read_text()


def test_meshcat_listens_on_the_loopback_only(meshcat):
    assert meshcat.web_url() == f"http://localhost:{meshcat.port()}"


@pytest.mark.long
def test_room_has_every_element_where_it_was_surveyed(meshcat):
    draw_room(meshcat, ROOM)
    for i, p_W in enumerate(ROOM.anchors):
        np.testing.assert_array_equal(transform(meshcat, f"/room/anchors/{i:02d}")[:3, 3], p_W)
    for i, landmark in enumerate(ROOM.landmarks):
        path = f"/room/landmarks/{landmark.label.replace(' ', '_')}/{i:02d}"
        np.testing.assert_array_equal(transform(meshcat, path)[:3, 3], landmark.position)
        frame = RigidTransform(transform(meshcat, path)) @ vertices(meshcat, f"{path}/frame").T
        half = np.array(landmark.size or ROOM.landmark_size[landmark.label]) / 2
        R_WL = RollPitchYaw(0, 0, landmark.yaw).ToRotationMatrix().matrix()
        corners = R_WL @ (half * list(itertools.product((-1, 1), repeat=3))).T
        np.testing.assert_allclose(frame.min(axis=1), corners.min(axis=1) + landmark.position, atol=1e-6)
        np.testing.assert_allclose(frame.max(axis=1), corners.max(axis=1) + landmark.position, atol=1e-6)
    for i, (x, y, yaw) in enumerate(ROOM.walls):
        path = next(p for k in ("inner", "outer") if meshcat.HasPath(p := f"/room/walls/{k}/{i:02d}"))
        X_W = RigidTransform(RollPitchYaw(0, 0, yaw), [x, y, 1.5])
        np.testing.assert_allclose(transform(meshcat, path), X_W.GetAsMatrix4(), atol=1e-15)
    for i, (x, y) in enumerate(ROOM.stands):
        np.testing.assert_allclose(transform(meshcat, f"/room/stands/{i:02d}")[:3, 3], [x, y, 0.0])
    for path in ("/room/floor", "/room/grid", "/room/furniture/bookshelf", "/room/furniture/Stop_Sign"):
        assert meshcat.HasPath(path)
    assert not meshcat.HasPath("/room/furniture/person_standing_0")  # the landmark stands there


def test_the_three_blocks_across_the_room_are_its_inner_walls(meshcat):
    draw_room(meshcat, ROOM)
    inner = {i for i in range(len(ROOM.walls)) if meshcat.HasPath(f"/room/walls/inner/{i:02d}")}
    assert inner == {8, 9, 16, 17, 18, 19, 26, 27}


@pytest.mark.long
def test_things_are_shown_as_the_renderer_shows_them(meshcat):
    draw_room(meshcat, ROOM)
    counts = Counter()
    for item in scene_items(ROOM):
        number, counts[item.group] = counts[item.group], counts[item.group] + 1
        if item.group in ("floor", "walls"):
            continue
        kind = "/" + item.kind.replace(" ", "_") if item.group in ("landmarks", "furniture") else ""
        path = f"/room/{item.group}{kind}/{number:02d}"
        np.testing.assert_allclose(transform(meshcat, path), item.X_WG.GetAsMatrix4(), atol=1e-12)
        if not isinstance(item.shape, Mesh):
            continue
        shown = scene_object(meshcat, path)["object"]
        size = np.array(shown["matrix"]).reshape(4, 4).T
        np.testing.assert_allclose(size, np.diag([*item.shape.scale3(), 1.0]))
        corners = [line for line in shown["data"].splitlines() if line.startswith("v ")]
        assert corners == [line for line in item.shape.source().path().read_text().splitlines() if line[:2] == "v "]
        picture = item.shape.source().path().with_suffix(".png")
        if picture.exists():
            (packed,) = shown["resources"].values()
            assert base64.b64decode(packed.partition(",")[2]) == picture.read_bytes()
    assert counts["posts"] > 0


def test_a_landmarks_frame_tells_its_class(meshcat):
    draw_room(meshcat, ROOM)
    colors = {}
    for i, landmark in enumerate(ROOM.landmarks):
        path = f"/room/landmarks/{landmark.label.replace(' ', '_')}/{i:02d}"
        frame = scene_object(meshcat, f"{path}/frame")
        colors.setdefault(landmark.label, set()).add(frame["materials"][0]["color"])
    assert all(len(found) == 1 for found in colors.values())
    assert len(set.union(*colors.values())) == len(ROOM.classes)


numbers = st.floats(-1.0, 1.0)


@pytest.mark.long
@given(arrays(float, (3, 3), elements=numbers), arrays(float, 3, elements=numbers))
def test_ellipsoid_is_the_covariances(L, rpy):
    P = L @ L.T + 1e-4 * np.eye(3)
    R_near = RollPitchYaw(3 * rpy).ToRotationMatrix().matrix()
    R, s = sigma_ellipsoid(P, R_near)
    np.testing.assert_allclose(R @ np.diag(s**2) @ R.T, 9 * P, atol=1e-12)
    np.testing.assert_allclose(np.sort(s), 3 * np.sqrt(np.linalg.eigh(P)[0]), rtol=1e-9)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) > 0
    # No other choice of axes is nearer: half turns about an axis and quarter turns reach all of them.
    for turn in np.vstack([np.eye(3) * np.pi, np.eye(3) * np.pi / 2, -np.eye(3) * np.pi / 2]):
        other = R @ RollPitchYaw(turn).ToRotationMatrix().matrix()
        assert np.trace(R_near.T @ R) >= np.trace(R_near.T @ other) - 1e-12


def test_ellipsoid_turns_on_with_its_covariance():
    R = np.eye(3)
    for angle in np.linspace(0, 2 * np.pi, 200):
        R_true = RollPitchYaw(angle / 3, 0.2, angle).ToRotationMatrix().matrix()
        R, s = sigma_ellipsoid(R_true @ np.diag([1.0, 4.0, 0.25]) @ R_true.T, R)
        if angle == 0:
            first = R_true.T @ R
        np.testing.assert_allclose(R_true.T @ R, first, atol=1e-9)
    np.testing.assert_allclose(np.sort(s), [1.5, 3.0, 6.0])


def test_ellipsoid_of_no_uncertainty_has_an_extent():
    R, s = sigma_ellipsoid(np.zeros((3, 3)), np.eye(3))
    np.testing.assert_array_equal(R, np.eye(3))
    assert np.all(s > 0)


@pytest.mark.long
@given(arrays(float, (5, 3), elements=st.floats(-10, 10).map(lambda v: round(v, 3))), st.floats(0.01, 0.1))
def test_tube_lies_at_its_radius_about_every_segment(points, radius):
    corners, faces = tube(points, radius)
    kept = [k for k in range(4) if np.any(points[k] != points[k + 1])]
    assert corners.shape == faces.shape == (3, 8 * len(kept))
    for k, prism in zip(kept, corners.T.reshape(-1, 8, 3), strict=True):
        for end, ring in ((points[k], prism[:4]), (points[k + 1], prism[4:])):
            np.testing.assert_allclose(np.linalg.norm(ring - end, axis=1), radius, rtol=1e-9)
            np.testing.assert_allclose(ring.mean(axis=0), end, atol=1e-12)
            np.testing.assert_allclose((ring - end) @ (points[k + 1] - points[k]), 0.0, atol=1e-12)


def test_a_path_without_length_is_not_drawn(meshcat):
    draw_path(meshcat, "/still", np.arange(6.0).reshape(2, 3), 0.1, TRUE)
    assert meshcat.HasPath("/still")
    draw_path(meshcat, "/still", np.ones((4, 3)), 0.1, TRUE)
    assert not meshcat.HasPath("/still")


PATH = PiecewisePolynomial.FirstOrderHold([0.0, 4.0], np.array([[0.0, 4.0], [0.0, 1.0], [1.5, 1.5]]))
RPY = [0.1, -0.2, 0.7]


def covariance() -> np.ndarray:
    P = np.eye(15)
    R = RollPitchYaw(0.1, 0.2, 0.3).ToRotationMatrix().matrix()
    P[:3, :3] = R @ np.diag([0.01, 0.04, 0.0025]) @ R.T
    return P


def fly(meshcat: Meshcat, duration: float, ticks: int = 2) -> None:
    """Fly 1 m/s along x with constant angles, the estimate 0.1 m to the left and 0.05 rad off in yaw."""
    builder = DiagramBuilder()
    line = np.zeros((12, 2))
    line[0] = [0.0, 10.0]
    line[2] = 1.5
    line[3:6] = np.array(RPY)[:, None]
    estimate = np.zeros((15, 2))
    estimate[:12] = line
    estimate[1] += 0.1
    estimate[5] += 0.05
    show = builder.AddSystem(MeshcatFlight(meshcat, h, ticks))
    for name, values in {"state": line, "estimate": estimate}.items():
        source = builder.AddSystem(TrajectorySource(PiecewisePolynomial.FirstOrderHold([0.0, 10.0], values)))
        builder.Connect(source.get_output_port(), show.GetInputPort(name))
    source = builder.AddSystem(ConstantVectorSource(covariance().ravel()))
    builder.Connect(source.get_output_port(), show.GetInputPort("covariance"))
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(duration)


def test_display_shows_pose_estimate_and_ellipsoid(meshcat):
    fly(meshcat, 60 * h)
    X_WB = RigidTransform(RollPitchYaw(RPY), [2.0, 0.0, 1.5])
    np.testing.assert_allclose(transform(meshcat, "/flight/vehicle"), X_WB.GetAsMatrix4(), atol=1e-12)
    X_WBhat = RigidTransform(RollPitchYaw(RPY[0], RPY[1], RPY[2] + 0.05), [2.0, 0.1, 1.5])
    np.testing.assert_allclose(transform(meshcat, "/flight/estimate"), X_WBhat.GetAsMatrix4(), atol=1e-12)
    X_WE = transform(meshcat, "/flight/ellipsoid")
    np.testing.assert_allclose(X_WE[:3, 3], [2.0, 0.1, 1.5], atol=1e-12)
    np.testing.assert_allclose(np.sort(scale(meshcat)), [0.15, 0.3, 0.6], rtol=1e-9)
    variances, axes = np.linalg.eigh(covariance()[:3, :3])
    shown = X_WE[:3, :3] @ np.diag(np.square(scale(meshcat))) @ X_WE[:3, :3].T
    np.testing.assert_allclose(shown, axes @ np.diag(9 * variances) @ axes.T, atol=1e-12)


@pytest.mark.parametrize(("ticks", "last"), [(1, 47), (2, 46), (5, 45)])
def test_display_skips_ticks_and_its_trail_is_the_path(meshcat, ticks, last):
    fly(meshcat, 47.5 * h, ticks)
    np.testing.assert_allclose(transform(meshcat, "/flight/vehicle")[0, 3], last * h, atol=1e-12)
    frames = last // ticks
    found = []
    for chunk in range(frames // CHUNK + 1):
        for name, y in (("true_path", 0.0), ("estimated_path", 0.1)):
            prisms = vertices(meshcat, f"/flight/{name}/{chunk:04d}").reshape(-1, 8, 3)
            ends = np.stack([prisms[:, :4].mean(axis=1), prisms[:, 4:].mean(axis=1)], axis=1)
            np.testing.assert_allclose(ends[:, :, 1:], np.broadcast_to([y, 1.5], (len(ends), 2, 2)), atol=1e-6)
            found += [(name, a, b) for a, b in ends[:, :, 0]]
    starts = np.arange(frames) * ticks * h
    for name in ("true_path", "estimated_path"):
        segments = np.array([(a, b) for n, a, b in found if n == name])
        np.testing.assert_allclose(segments[:, 0], starts, atol=1e-6)
        np.testing.assert_allclose(segments[:, 1], starts + ticks * h, atol=1e-6)
    assert not meshcat.HasPath(f"/flight/true_path/{frames // CHUNK + 1:04d}")


def test_a_new_flight_deletes_the_old_trail(meshcat):
    fly(meshcat, (2 * CHUNK + 5) * h, 1)
    assert meshcat.HasPath("/flight/true_path/0002")
    fly(meshcat, 5 * h, 1)
    assert meshcat.HasPath("/flight/true_path/0000")
    assert not meshcat.HasPath("/flight/true_path/0001")


def test_display_refuses_no_ticks(meshcat):
    with pytest.raises(InputError, match="ticks: 0: must be at least 1"):
        MeshcatFlight(meshcat, h, 0)


def test_plan_is_drawn_along_the_trajectory(meshcat):
    draw_plan(meshcat, PATH)
    prisms = vertices(meshcat, PLANNED_PATH).reshape(-1, 8, 3)
    middle = prisms.mean(axis=1)
    np.testing.assert_allclose(middle[:, 1], middle[:, 0] / 4, atol=1e-5)
    np.testing.assert_allclose([prisms[0, :4].mean(axis=0)[0], prisms[-1, 4:].mean(axis=0)[0]], [0, 4], atol=1e-5)


def flight_log(n: int = 121) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    times = np.arange(n) * h
    states = np.zeros((n, 12))
    states[:, :3] = PATH.vector_values(times).T
    states[:, 3:6] = np.sin(times)[:, None] * RPY
    estimates = np.zeros((n, 15))
    estimates[:, :12] = states
    estimates[:, 2] += 0.05
    covariances = np.tile(covariance(), (n, 1, 1))
    for k, t in enumerate(times):  # it grows and turns by more than half a turn
        R = RollPitchYaw(0.0, 0.0, t).ToRotationMatrix().matrix()
        covariances[k, :3, :3] = (1 + t) * R @ covariances[k, :3, :3] @ R.T
    return times, states, estimates, covariances


def commands(page: str) -> list[dict]:
    """The messages that the page hands its viewer."""
    packed = re.findall(r'fetch\("data:application/octet-binary;base64,([^"]+)"\)', page)
    return [msgpack.unpackb(base64.b64decode(text)) for text in packed]


@pytest.fixture(scope="module")
def page(meshcat):
    fly(meshcat, 5 * h)  # leaves a live trail, which the page must not show
    return html_replay(ROOM, PATH, *flight_log(), meshcat=meshcat)


def test_page_needs_no_network(page):
    assert len(page) < 8_000_000
    tags = re.findall(r"<(?:script|link|img|iframe|source|video|audio|object|embed)\b[^>]*>", page)
    assert tags
    assert not [tag for tag in tags if re.search(r"\b(src|href|data)\s*=", tag)]
    assert "@import" not in page
    fetched = re.findall(r"fetch\(\s*[\"'`]([^\"'`]{0,30})", page)
    assert all(address.startswith("data:") for address in fetched)


def test_page_holds_every_element(page):
    drawn = {command["path"] for command in commands(page) if command["type"] == "set_object"}
    flight = {"vehicle", "estimate", "ellipsoid", "planned_path", "true_path", "estimated_path"}
    assert {f"/flight/{name}" for name in flight} == {path for path in drawn if path.startswith("/flight")}
    assert {f"/room/anchors/{i:02d}" for i in range(len(ROOM.anchors))} <= drawn
    assert {path.split("/")[2] for path in drawn if path.startswith("/room")} == {
        "floor", "grid", "walls", "stands", "furniture", "anchors", "landmarks", "posts",
    }  # fmt: skip
    assert sum(path.startswith("/room/walls") for path in drawn) == len(ROOM.walls)
    for frame in (False, True):
        found = [p for p in drawn if p.startswith("/room/landmarks") and p.endswith("/frame") == frame]
        assert len(found) == len(ROOM.landmarks)


def test_page_explains_its_colours(page):
    legend = page[page.index('<div id="legend">') :]
    for name in ("planned path", "true path", "estimate", "3 sigma", "anchor", *ROOM.classes):
        assert f"</span>{name}</div>" in legend


@pytest.mark.long
def test_page_plays_the_log(page):
    times, states, estimates, covariances = flight_log()
    (animation,) = [command for command in commands(page) if command["type"] == "set_animation"]
    track = {(part["path"], t["name"]): t["keys"] for part in animation["animations"] for t in part["clip"]["tracks"]}
    assert [part["clip"]["fps"] for part in animation["animations"]] == pytest.approx([15.0] * 3)
    shown = slice(0, None, 2)
    for keys in track.values():
        assert [key["time"] for key in keys] == list(range(len(times[shown])))
    value = {name: np.array([key["value"] for key in keys]) for name, keys in track.items()}
    for path, x in (("/flight/vehicle", states[shown]), ("/flight/estimate", estimates[shown])):
        np.testing.assert_allclose(value[path, ".position"], x[:, :3])
        wxyz = np.array([RollPitchYaw(row[3:6]).ToQuaternion().wxyz() for row in x])
        xyzw = value[path, ".quaternion"]
        np.testing.assert_allclose(np.abs(np.sum(np.roll(wxyz, -1, axis=1) * xyzw, axis=1)), 1.0, rtol=1e-12)
    np.testing.assert_allclose(value["/flight/ellipsoid", ".position"], estimates[shown, :3])
    turns = value["/flight/ellipsoid", ".quaternion"]
    cosines = np.abs(np.sum(turns[1:] * turns[:-1], axis=1))
    np.testing.assert_allclose(2 * np.arccos(cosines), 2 * h, rtol=1e-6)  # 1 rad/s, never a jump to another axis
    sizes = 3 * np.sqrt([np.linalg.eigvalsh(P[:3, :3]) for P in covariances[shown]])
    np.testing.assert_allclose(np.sort(value["/flight/ellipsoid", ".scale"], axis=1), sizes)


@pytest.mark.long
def test_a_faster_log_plays_at_about_fifteen_frames_a_second(meshcat):
    times, states, estimates, covariances = flight_log()
    page = html_replay(ROOM, PATH, times * 0.3, states, estimates, covariances, meshcat)  # 100 Hz
    (animation,) = [command for command in commands(page) if command["type"] == "set_animation"]
    clip = animation["animations"][0]["clip"]
    assert clip["fps"] == pytest.approx(100 / 7)
    assert len(clip["tracks"][0]["keys"]) == 18


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"times": np.zeros(3)}, "times: .*rising"),
        ({"times": np.array([0.0])}, "times: .*two or more"),
        ({"states": np.zeros((3, 11))}, r"states: shape \(3, 11\): must be \(3, 12\)"),
        ({"estimates": np.zeros((2, 15))}, r"estimates: shape \(2, 15\): must be \(3, 15\)"),
        ({"covariances": np.zeros((3, 225))}, r"covariances: shape \(3, 225\): must be \(3, 15, 15\)"),
        ({"states": np.full((3, 12), np.nan)}, "states: must be finite"),
    ],
)
def test_replay_refuses_a_log_that_does_not_fit(meshcat, change, message):
    log = dict(zip(("times", "states", "estimates", "covariances"), flight_log(3), strict=True))
    with pytest.raises(InputError, match=message):
        html_replay(ROOM, PATH, **(log | change), meshcat=meshcat)
