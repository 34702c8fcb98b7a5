"""Draw a room in Meshcat: floor, walls, stands, furniture, anchors and landmarks under the path /room."""

import itertools
import logging

import numpy as np
from pydrake.geometry import Box, Mesh, Meshcat, MeshcatParams, Rgba, Shape, Sphere
from pydrake.math import RigidTransform, RotationMatrix

from ortilo_drake.model.room import Room
from ortilo_drake.world.scenery.obj_normals import without_normals
from ortilo_drake.world.scenery.scene import scene_items

FLOOR = Rgba(0.86, 0.87, 0.88, 1.0)
GRID = Rgba(0.72, 0.74, 0.76, 1.0)
OUTER_WALL = Rgba(0.62, 0.42, 0.34, 0.09)
INNER_WALL = Rgba(0.68, 0.36, 0.26, 0.55)
ANCHOR = Rgba(1.00, 0.72, 0.00, 1.0)
ANCHOR_LINE = Rgba(0.80, 0.60, 0.10, 1.0)
CLASS_COLORS = (
    Rgba(0.12, 0.30, 0.85, 1.0),
    Rgba(0.85, 0.10, 0.10, 1.0),
    Rgba(0.55, 0.33, 0.10, 1.0),
    Rgba(0.20, 0.65, 0.15, 1.0),
    Rgba(0.10, 0.10, 0.12, 1.0),
    Rgba(0.00, 0.70, 0.85, 1.0),
    Rgba(0.00, 0.60, 0.50, 1.0),
    Rgba(0.95, 0.45, 0.05, 1.0),
    Rgba(0.90, 0.35, 0.65, 1.0),
    Rgba(0.50, 0.50, 0.10, 1.0),
)

ANCHOR_RADIUS = 0.14
_SHOWN_AS_SEEN = ("stands", "furniture", "landmarks", "posts")  # drawn with the same shapes as in the renderer
FIELD_OF_VIEW = 40.0  # vertical [deg]; narrow, so that a long room is not distorted


def make_meshcat(port: int | None = None, host: str = "localhost") -> Meshcat:
    """Return a Meshcat that listens on the loopback interface only, on a free port unless one is given.

    Drake's message with its address is suppressed, because it would also appear when only a page is made.
    """
    drake = logging.getLogger("drake")
    level = drake.level
    drake.setLevel(logging.WARNING)
    try:
        return Meshcat(MeshcatParams(host=host, port=port, show_stats_plot=False))
    finally:
        drake.setLevel(level)


def class_color(room: Room, label: str) -> Rgba:
    """Return the colour of a landmark class; the colours repeat after the tenth class."""
    return CLASS_COLORS[room.classes.index(label) % len(CLASS_COLORS)]


def aim_camera(meshcat: Meshcat, low: np.ndarray, high: np.ndarray) -> None:
    """Show the box between two corners p_W, from the south and above.

    The distance fits the box's width and depth into a window one and a half times as wide as high.
    """
    width, depth = high[0] - low[0], high[1] - low[1]
    distance = max(width / 1.5, depth) / 2 / np.tan(np.deg2rad(FIELD_OF_VIEW / 2)) + 0.35 * depth
    target = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])
    meshcat.SetCamera(Meshcat.PerspectiveCamera(fov=FIELD_OF_VIEW))
    meshcat.SetCameraPose(target + distance * np.array([0.0, -0.68, 0.73]), target)


def _put(meshcat: Meshcat, path: str, shape: Shape, rgba: Rgba, p_W: np.ndarray, yaw: float = 0.0) -> None:
    meshcat.SetObject(path, shape, rgba)
    meshcat.SetTransform(path, RigidTransform(RotationMatrix.MakeZRotation(yaw), p_W))


def _set_light(meshcat: Meshcat) -> None:
    """Light the room evenly; the viewer's own lamps shine two metres about the origin."""
    for lamp in ("SpotLight", "PointLightNegativeX", "PointLightPositiveX"):
        meshcat.SetProperty(f"/Lights/{lamp}", "visible", False)
    meshcat.SetProperty("/Lights/AmbientLight/<object>", "intensity", 1.7)
    meshcat.SetProperty("/Lights/FillLight/<object>", "intensity", 1.6)
    meshcat.SetProperty("/Lights/FillLight/<object>", "position", [-8.0, 20.0, 12.0])


def _draw_floor(meshcat: Meshcat, low: np.ndarray, high: np.ndarray) -> None:
    """Draw the floor with a line every metre."""
    middle = (low + high) / 2
    size = high - low
    _put(meshcat, "/room/floor", Box(size[0], size[1], 0.02), FLOOR, np.array([*middle[:2], low[2] - 0.01]))
    z = low[2] + 0.005
    x_lines = np.arange(np.ceil(low[0]), high[0])
    y_lines = np.arange(np.ceil(low[1]), high[1])
    start = [[x, low[1], z] for x in x_lines] + [[low[0], y, z] for y in y_lines]
    end = [[x, high[1], z] for x in x_lines] + [[high[0], y, z] for y in y_lines]
    meshcat.SetLineSegments("/room/grid", np.array(start).T, np.array(end).T, 1.0, GRID)


def _draw_walls(meshcat: Meshcat, room: Room) -> None:
    """Draw the walls; those around the interior are nearly transparent, so that one sees in from outside."""
    low, high = np.array(room.interior.min[:2]), np.array(room.interior.max[:2])
    for i, (x, y, z, yaw, *half) in enumerate(room.wall_boxes):
        inside = bool(np.all(low < [x, y]) and np.all([x, y] < high))
        path = f"/room/walls/{'inner' if inside else 'outer'}/{i:02d}"
        _put(meshcat, path, Box(*2 * np.array(half)), INNER_WALL if inside else OUTER_WALL, np.array([x, y, z]), yaw)


def _draw_items(meshcat: Meshcat, room: Room) -> None:
    """Draw the things in the room, each landmark in a frame of its class's colour."""
    numbers = {group: itertools.count() for group in _SHOWN_AS_SEEN}
    for item in scene_items(room):
        if item.group not in _SHOWN_AS_SEEN:
            continue
        kind = "/" + item.kind.replace("/", "_").replace(" ", "_") if item.group in ("landmarks", "furniture") else ""
        path = f"/room/{item.group}{kind}/{next(numbers[item.group]):02d}"
        shape = item.shape
        if isinstance(shape, Mesh):
            shape = Mesh(without_normals(shape.source().path()), shape.scale3())
        meshcat.SetObject(path, shape, item.rgba)
        meshcat.SetTransform(path, item.X_WG)
        if item.group == "landmarks":
            landmark = room.landmarks[item.landmark]
            half = np.array(landmark.size or room.landmark_size[landmark.label]) / 2
            meshcat.SetLineSegments(f"{path}/frame", *_frame(half), 1.0, class_color(room, item.kind))


def _frame(half: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the starts and ends of the 12 edges of a box about the origin, from its half sizes (3, 12)."""
    corners = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
    pairs = itertools.combinations(range(8), 2)
    edges = np.array([(i, j) for i, j in pairs if np.count_nonzero(corners[i] != corners[j]) == 1])
    return (corners[edges[:, 0]] * half).T, (corners[edges[:, 1]] * half).T


def _draw_anchors(meshcat: Meshcat, room: Room) -> None:
    """Draw the anchors with plumb lines to the floor, which show their places."""
    p_W = room.anchor_positions
    for i, p in enumerate(p_W):
        _put(meshcat, f"/room/anchors/{i:02d}", Sphere(ANCHOR_RADIUS), ANCHOR, p)
    feet = p_W * [1.0, 1.0, 0.0]
    meshcat.SetLineSegments("/room/anchors/plumb_lines", p_W.T, feet.T, 1.0, ANCHOR_LINE)


def draw_room(meshcat: Meshcat, room: Room) -> None:
    """Draw a room and aim the viewer's camera at the whole of it.

    Paths: /room/floor, /room/grid, /room/walls/{outer,inner}/NN, /room/anchors/NN; and, with the renderer's shapes,
    /room/stands/NN, /room/posts/NN, /room/furniture/KIND/NN, /room/landmarks/LABEL/NN. Below each landmark, /frame is
    its box in its class's colour. Numbers are those of the room file; furniture that is a landmark is not counted.
    """
    low, high = np.array(room.interior.min), np.array(room.interior.max)
    meshcat.Delete("/room")
    meshcat.SetProperty("/Grid", "visible", False)
    meshcat.SetProperty("/Axes", "visible", False)
    meshcat.SetProperty("/Background", "top_color", [0.93, 0.95, 0.98])
    meshcat.SetProperty("/Background", "bottom_color", [0.98, 0.98, 0.99])
    _set_light(meshcat)
    _draw_floor(meshcat, low, high)
    _draw_walls(meshcat, room)
    _draw_items(meshcat, room)
    _draw_anchors(meshcat, room)
    aim_camera(meshcat, low, high)
