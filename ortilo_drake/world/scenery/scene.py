"""The scene of a room: each thing with its shape and pose, for Drake's renderer and for Meshcat.

The meshes are our own (scripts/make_room_meshes.py). A landmark fills its surveyed size about its surveyed centre; a
landmark without a support stands on a post. A class or kind without a mesh is shown as a plain block.
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from pydrake.geometry import Box, Cylinder, Mesh, Rgba, Shape
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from ortilo_drake.model.room import Room

MESHES = Path(__file__).with_name("meshes")
SAME_OBJECT = 0.4  # [m] furniture this near to a landmark, seen from above, is that landmark
NO_LANDMARK = -1

# Furniture whose origin is its middle; the origin of all other kinds is on the floor below.
_CENTERED = ("cardboard_box", "euro_pallet", "ball", "tennis_racket", "baseball_bat")
_BLOCK = Rgba(0.74, 0.62, 0.46, 1.0)
_POST = Rgba(0.45, 0.46, 0.48, 1.0)
_POST_RADIUS = 0.06
_LEAST_POST = 0.08  # a landmark less than this above its support needs no post [m]
_NEAR_WALL = 0.35  # a landmark this near to a wall hangs on it [m]


@dataclass(frozen=True)
class SceneItem:
    """One thing in the room."""

    group: str
    """its group: floor, walls, stands, furniture, landmarks or posts."""
    kind: str
    """its kind in the group: a landmark's class, a piece of furniture's kind."""
    shape: Shape
    """its shape in its own frame G."""
    X_WG: RigidTransform
    """the pose of G in the world."""
    landmark: int = NO_LANDMARK
    """its number among the room's landmarks, or NO_LANDMARK."""
    rgba: Rgba = field(default_factory=lambda: _BLOCK)
    """the colour of a shape that has no texture."""


def mesh_file(kind: str) -> Path:
    """Return the path of the mesh file of a landmark class or kind of furniture; the file need not exist."""
    return MESHES / f"{kind.lower().replace(' ', '_')}.obj"


def _pose(p_WG: np.ndarray, yaw: float = 0.0) -> RigidTransform:
    return RigidTransform(RotationMatrix.MakeZRotation(yaw), p_WG)


def _floor(room: Room) -> list[SceneItem]:
    low, high = np.array(room.interior.min), np.array(room.interior.max)
    middle = np.round((low + high) / 2)  # whole tiles
    return [SceneItem("floor", "floor", Mesh(mesh_file("floor32x10")), _pose(np.array([middle[0], middle[1], low[2]])))]


def _walls(room: Room) -> list[SceneItem]:
    items = []
    for x, y, z, yaw, *half in room.wall_boxes:
        scale = 2.0 * np.array(half) / [3.0, 1.0, 3.0]  # the mesh's own size
        items.append(SceneItem("walls", "wall", Mesh(mesh_file("wall"), scale), _pose(np.array([x, y, z]), yaw)))
    return items


def _stands(room: Room) -> list[SceneItem]:
    scale = np.array([room.stand_radius / 0.25, room.stand_radius / 0.25, room.stand_height / 0.86])
    mesh = Mesh(mesh_file("stand"), scale)
    return [SceneItem("stands", "stand", mesh, _pose(np.array([x, y, 0.0]))) for x, y in room.stands]


def _furniture(room: Room) -> list[SceneItem]:
    items = []
    for kind, x, y, z, roll, pitch, yaw in room.furniture:
        away = np.hypot(*(room.landmark_positions[:, :2] - [x, y]).T)
        if np.any(away < SAME_OBJECT):
            continue
        size = np.array(room.furniture_size[kind])
        X_WO = RigidTransform(RollPitchYaw(roll, pitch, yaw), [x, y, z])
        if mesh_file(kind).exists():
            below = size[2] if kind in _CENTERED else 0.0  # furniture_size is the height above the origin
            X_OG = RigidTransform(np.array([0.0, 0.0, -below]))
            items.append(SceneItem("furniture", kind, Mesh(mesh_file(kind)), X_WO @ X_OG))
        else:
            height = z + size[2]
            items.append(
                SceneItem("furniture", kind, Box(size[0], size[1], height), _pose(np.array([x, y, height / 2])))
            )
    return items


def _support(room: Room, x: float, y: float, bottom: float) -> float:
    """Return the height of a landmark's support: the floor, a stand, or bottom itself where it hangs on a wall."""
    for wall_x, wall_y, wall_z, yaw, half_x, half_y, half_z in room.wall_boxes:
        c, s = np.cos(yaw), np.sin(yaw)
        along, across = c * (x - wall_x) + s * (y - wall_y), -s * (x - wall_x) + c * (y - wall_y)
        if max(abs(along) - half_x, abs(across) - half_y) < _NEAR_WALL and bottom < wall_z + half_z:
            return bottom
    for stand_x, stand_y, radius, height in room.stand_cylinders:
        if np.hypot(x - stand_x, y - stand_y) < radius and height < bottom + _LEAST_POST:
            return float(height)
    return float(room.interior.min[2])


def _landmarks(room: Room) -> list[SceneItem]:
    items = []
    for i, landmark in enumerate(room.landmarks):
        class_size = np.array(room.landmark_size[landmark.label])
        size = class_size if landmark.size is None else np.array(landmark.size)
        p_WG = np.array(landmark.position)
        mesh = mesh_file(landmark.label)
        shape = Mesh(mesh, size / mesh_extent(mesh)) if mesh.exists() else Box(*size)
        items.append(SceneItem("landmarks", landmark.label, shape, _pose(p_WG, landmark.yaw), i))
        bottom = p_WG[2] - size[2] / 2
        support = _support(room, p_WG[0], p_WG[1], bottom)
        if bottom - support > _LEAST_POST:
            post = Cylinder(_POST_RADIUS, bottom - support)
            middle = np.array([*p_WG[:2], (bottom + support) / 2])
            items.append(SceneItem("posts", "post", post, _pose(middle), rgba=_POST))
    return items


def mesh_extent(path: Path) -> np.ndarray:
    """Return the size of a mesh along its own axes (3) [m]."""
    lines = (line.split() for line in path.read_text().splitlines() if line.startswith("v "))
    vertices = np.array([[float(word) for word in words[1:4]] for words in lines])
    return vertices.max(axis=0) - vertices.min(axis=0)


def scene_items(room: Room) -> list[SceneItem]:
    """Return the visible things in a room: floor, walls, stands, furniture, landmarks and their posts."""
    return _floor(room) + _walls(room) + _stands(room) + _furniture(room) + _landmarks(room)
