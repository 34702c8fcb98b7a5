"""Automatically labelled pictures: the class, box and visible share of every landmark, exactly as rendered."""

from dataclasses import replace
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.common import MemoryFile
from pydrake.geometry import InMemoryMesh, LightParameter, Mesh, ReadObjToTriangleSurfaceMesh, SceneGraph
from pydrake.math import RigidTransform

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.model.optional import later
from ortilo_drake.model.room import CameraModel, Room
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.planner.planner import plan
from ortilo_drake.scenario import load_scenario
from ortilo_drake.training.pictures.labels import DISTANCE, LABEL_SIZE, MAX_OBJECTS, Frames
from ortilo_drake.training.pictures.random_rooms import random_pose, random_room
from ortilo_drake.world.scenery.rendering import lamp, make_scene_graph, render_cameras
from ortilo_drake.world.scenery.scene import SceneItem, mesh_file, scene_items

cv2 = later("cv2")


@lru_cache(maxsize=64)
def _files(path: Path) -> tuple[str, str, str, str, bytes]:
    """Return the OBJ text of a mesh, name and text of its material, and name and bytes of its texture."""

    def named(text: str, key: str) -> str:
        return next(line.split()[1] for line in text.splitlines() if line.strip().startswith(key))

    obj = path.read_text()
    mtl = (path.parent / (material := named(obj, "mtllib"))).read_text()
    return obj, material, mtl, (texture := named(mtl, "map_Kd")), (path.parent / texture).read_bytes()


def _recolor(png: bytes, hue: float, saturation: float, value: float, gamma: float) -> bytes:
    image = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
    hsv = cv2.cvtColor(image.astype(np.float32) / 255.0, cv2.COLOR_BGR2HSV)
    hsv[..., 0] = (hsv[..., 0] + hue) % 360.0
    hsv[..., 1] = np.clip(hsv[..., 1] * saturation, 0.0, 1.0)
    hsv[..., 2] = np.clip(value * hsv[..., 2] ** gamma, 0.0, 1.0)
    return bytes(cv2.imencode(".png", np.round(255.0 * cv2.cvtColor(hsv, cv2.COLOR_HSV2BGR)).astype(np.uint8))[1])


class Recolored:
    """Random looks of the items in one scene, one look for each mesh file."""

    def __init__(self, rng: np.random.Generator):
        self._rng, self._made = rng, dict[str, InMemoryMesh]()

    def mesh(self, shape: Mesh, group: str) -> Mesh:
        """Return the mesh with a recoloured texture: landmarks stay recognisable, all else may have any colour."""
        path = Path(shape.source().path())
        if path.name not in self._made:
            rng = self._rng
            obj, material, mtl, texture, png = _files(path)
            if group == "landmarks":
                look = (rng.normal(0.0, 10.0), rng.uniform(0.75, 1.2), rng.uniform(0.8, 1.15), rng.uniform(0.85, 1.2))
            else:
                look = (rng.uniform(-180, 180), rng.uniform(0.2, 1.3), rng.uniform(0.6, 1.2), rng.uniform(0.5, 1.3))
            self._made[path.name] = InMemoryMesh(
                mesh_file=MemoryFile(obj.encode(), ".obj", path.name),
                supporting_files={
                    material: MemoryFile(mtl.encode(), ".mtl", "material"),
                    texture: MemoryFile(_recolor(png, *look), ".png", texture),
                },
            )
        return Mesh(self._made[path.name], shape.scale3())

    def item(self, item: SceneItem) -> SceneItem:
        """Return the item with a random look, unchanged if it has no mesh."""
        if isinstance(item.shape, Mesh):
            return replace(item, shape=self.mesh(item.shape, item.group))
        return item


def random_lamps(rng: np.random.Generator) -> list[LightParameter]:
    """Return three or four distant lamps above, of random direction, strength and tint; they leave no side black."""
    lamps = []
    turn = rng.uniform(-np.pi, np.pi)
    count = rng.integers(3, 5)
    total = rng.uniform(1.5, 2.8)
    shares = rng.dirichlet([4.0] * count)
    for k in range(count):
        azimuth = turn + 2.0 * np.pi * k / count + rng.normal(0.0, 0.4)
        tint = np.clip(rng.normal([1.0, 0.97, 0.94], 0.05), 0.7, 1.0)
        direction = (np.cos(azimuth), np.sin(azimuth), -rng.uniform(0.3, 1.1))
        lamps.append(lamp(float(total * shares[k]), direction, tuple(tint)))
    return lamps


def random_background(rng: np.random.Generator) -> tuple[float, float, float]:
    """Return the background colour above the walls, a random light grey."""
    red, green, blue = np.clip(rng.uniform(0.35, 1.0) + rng.normal(0.0, 0.05, 3), 0.0, 1.0)
    return float(red), float(green), float(blue)


NEAR = 0.2  # a landmark with a point nearer to the camera than this has no label [m]


@cache
def _mesh(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return the vertices (n x 3) and the triangles, indices of vertices (m x 3), of a mesh file."""
    mesh = ReadObjToTriangleSurfaceMesh(path)
    triangles = [[triangle.vertex(k) for k in range(3)] for triangle in mesh.triangles()]
    return np.array(mesh.vertices()), np.array(triangles)


def landmark_meshes(room: Room) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return the mesh of every landmark: vertices in W (n x 3) [m] and triangles (m x 3); InputError without a mesh."""
    found = []
    for item in scene_items(room):
        if item.group == "landmarks":
            if not mesh_file(item.kind).exists():
                raise InputError(f"{mesh_file(item.kind)}: missing: no mesh of '{item.kind}' to label by")
            vertices, triangles = _mesh(mesh_file(item.kind))
            found.append(((item.X_WG @ (vertices * item.shape.scale3()).T).T, triangles))
    return found


class Studio:
    """A renderer of labelled pictures of a room; with `rng`, looks, lamps and background are random."""

    def __init__(
        self, room: Room, classes: tuple[str, ...], camera: CameraModel, rng: np.random.Generator | None = None
    ):
        items = scene_items(room)
        light: dict[str, Any] = {}
        if rng is not None:
            recolored = Recolored(rng)
            items = [recolored.item(item) for item in items]
            light = {"lamps": random_lamps(rng), "background": random_background(rng)}
        if camera.coefficients or camera.aspect != 1.0:
            raise InputError("camera: pictures to train and judge by are drawn with a straight lens and square pixels")
        self._room, self._camera = room, camera
        self._classes = [float(classes.index(landmark.label)) for landmark in room.landmarks]
        self._meshes = landmark_meshes(room)
        self._color, _ = render_cameras(camera)
        self._graph = make_scene_graph(items, **light)
        self._query = self._graph.get_query_output_port().Eval(self._graph.CreateDefaultContext())
        self._world = SceneGraph.world_frame_id()

    def picture(self, X_WC: RigidTransform) -> tuple[np.ndarray, np.ndarray]:
        """Return the RGB picture (height x width x 3) from a pose, and its labels (MAX_OBJECTS x 8), see Frames."""
        image = self._query.RenderColorImage(self._color, self._world, X_WC).data[..., :3].copy()
        label = self._query.RenderLabelImage(self._color, self._world, X_WC).data.ravel()
        count = len(self._meshes)
        seen = np.bincount(label[(label >= 0) & (label < count)], minlength=count)
        rows = []
        f, c = self._camera.focal_length, np.array(self._camera.center)
        size = np.array([self._camera.width, self._camera.height])
        for i, (vertices, triangles) in enumerate(self._meshes):
            p_CV = X_WC.inverse() @ vertices.T
            if np.min(p_CV[2]) < NEAR:
                continue
            uv = (f * p_CV[:2] / p_CV[2] + c[:, np.newaxis]).T
            low, high = np.clip(uv.min(axis=0), -0.5, size - 0.5), np.clip(uv.max(axis=0), -0.5, size - 0.5)
            whole = silhouette_pixels(uv, triangles, *size) if np.all(low < high) else 0
            if whole == 0:
                continue
            visible = min(1.0, seen[i] / whole)
            distance = np.linalg.norm(self._room.landmark_positions[i] - X_WC.translation())
            rows.append([self._classes[i], *low, *high, visible, i, distance])
        rows.sort(key=lambda row: row[DISTANCE])
        labels = np.full((MAX_OBJECTS, LABEL_SIZE), -1.0, dtype=np.float32)
        labels[: len(rows[:MAX_OBJECTS])] = np.array(rows[:MAX_OBJECTS]).reshape(-1, LABEL_SIZE)
        return image, labels


def render_scene(kind: str, seed: int, scene: int, frames: int, width: int) -> Frames:
    """Return the labelled pictures of one scene, `frames` of them, with an image width [px].

    `kind` is 'paper_room' (the surveyed room with random light and textures) or 'random_rooms' (the room is random
    too). `seed` is the seed of the set; each scene, by its number in the set, has its own random stream.
    """
    rng = np.random.default_rng([seed, scene, ("paper_room", "random_rooms").index(kind)])
    scenario = load_scenario("imu_uwb_yolo")
    base = scenario.load_room()
    room = base if kind == "paper_room" else random_room(base, rng)
    path = None
    if kind == "paper_room":
        trajectory = plan(scenario.planner, base, scenario.vehicle)
        times = np.linspace(trajectory.start_time(), trajectory.end_time(), 400)
        path = np.array([np.ravel(trajectory.value(t))[:3] for t in times])
    studio = Studio(room, base.classes, base.camera.scaled_to(width), rng)
    pictures = [studio.picture(random_pose(room, rng, path if rng.random() < 0.7 else None)) for _ in range(frames)]
    return Frames(np.array([image for image, _ in pictures]), np.array([labels for _, labels in pictures]))


@cached_njit
def silhouette_pixels(uv: np.ndarray, triangles: np.ndarray, width: int, height: int) -> int:
    """Return the number of pixels whose centres a mesh covers, as the renderer counts them.

    `uv` has the vertices in the image [px] (n x 2), with pixel centres at integers; `triangles` the indices of three
    vertices each (m x 3).
    """
    left, top = max(0, int(np.ceil(uv[:, 0].min()))), max(0, int(np.ceil(uv[:, 1].min())))
    right, bottom = min(width - 1, int(np.floor(uv[:, 0].max()))), min(height - 1, int(np.floor(uv[:, 1].max())))
    if right < left or bottom < top:
        return 0
    covered = np.zeros((bottom - top + 1, right - left + 1), dtype=np.bool_)
    for k in range(triangles.shape[0]):
        a, b, c = uv[triangles[k, 0]], uv[triangles[k, 1]], uv[triangles[k, 2]]
        twice = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        if twice == 0.0:
            continue
        for v in range(max(top, int(np.ceil(min(a[1], b[1], c[1])))), min(bottom, int(max(a[1], b[1], c[1]))) + 1):
            for u in range(max(left, int(np.ceil(min(a[0], b[0], c[0])))), min(right, int(max(a[0], b[0], c[0]))) + 1):
                # A pixel's centre is inside if its triangles with the three edges have the sign of the whole triangle.
                p = (b[0] - u) * (c[1] - v) - (b[1] - v) * (c[0] - u)
                q = (c[0] - u) * (a[1] - v) - (c[1] - v) * (a[0] - u)
                if p / twice >= 0.0 and q / twice >= 0.0 and (p + q) / twice <= 1.0:
                    covered[v - top, u - left] = True
    return int(covered.sum())
