"""Random rooms, and random camera poses in a room."""

from collections.abc import Sequence

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw

from ortilo_drake.model.footprints import footprints
from ortilo_drake.model.room import Room
from ortilo_drake.world.scenery.rendering import camera_in_body
from ortilo_drake.world.scenery.scene import MESHES

SURFACES = ("wall", "floor", "floor32x10", "stand", "m100")  # meshes that are not used as clutter
_CLEARANCE = 0.45  # horizontal distance from the camera to anything below its height [m]
_STAND_HEIGHT = 0.86  # height of a stand [m]


def clutter_kinds(room: Room) -> list[str]:
    """Return the kinds of clutter: those with a mesh that are no landmark class."""
    landmarks = {label.replace(" ", "_") for label in room.landmark_size}
    return sorted(path.stem for path in MESHES.glob("*.obj") if path.stem not in {*landmarks, *SURFACES})


def _walls(length: float, width: float, rng: np.random.Generator) -> list[list[float]]:
    """Return x, y [m] and yaw [rad] of outer and some inner walls, for a room of this size (x from 0, y about 0)."""
    walls = [
        [float(x), y, 0.0] for x in np.arange(-1.5, length + 3.0, 3.0) for y in (-width / 2 - 0.5, width / 2 + 0.5)
    ]
    ends = (-0.5, length + 0.5)
    walls += [[x, float(y), np.pi / 2] for x in ends for y in np.arange(-width / 2 + 1.5, width / 2 + 1.5, 3.0)]
    for _ in range(rng.integers(1, 4)):
        yaw = float(rng.choice([0.0, np.pi / 2]))
        walls.append([rng.uniform(2.5, length - 1.5), rng.uniform(-width / 2, width / 2), yaw])
    return walls


def _is_clear(x: float, y: float, taken: Sequence[Sequence[float]], walls: Sequence[Sequence[float]]) -> bool:
    if any(np.hypot(x - a, y - b) < 0.75 for a, b, *_ in taken):
        return False
    for wall_x, wall_y, yaw in walls:
        half_x, half_y = (1.5, 0.5) if yaw == 0.0 else (0.5, 1.5)
        if abs(x - wall_x) < half_x + 0.45 and abs(y - wall_y) < half_y + 0.45:
            return False
    return True


def random_room(base: Room, rng: np.random.Generator) -> Room:
    """Return a room with random walls, landmarks, stands and clutter; classes and camera are the ones of `base`."""
    length, width = rng.uniform(8.0, 18.0), rng.uniform(6.0, 9.0)
    walls = _walls(length, width, rng)
    taken: list[tuple[float, float]] = []

    def place() -> tuple[float, float] | None:
        for _ in range(30):
            x, y = rng.uniform(0.6, length - 0.6), rng.uniform(-width / 2 + 0.6, width / 2 - 0.6)
            if _is_clear(x, y, taken, walls):
                taken.append((x, y))
                return x, y
        return None

    landmarks, stands, furniture = [], [], []
    classes = list(base.landmark_size)
    for _ in range(rng.integers(12, 24)):
        where = place()
        if where is None:
            continue
        label = classes[rng.integers(len(classes))]
        scale = rng.uniform(0.55, 1.6) if label == "fire hydrant" else rng.uniform(0.9, 1.1)
        size = np.round(scale * np.array(base.landmark_size[label]), 4)
        bottom = 0.0
        if label == "clock":
            bottom = rng.uniform(0.9, 2.3)
        elif label in ("bird", "cat", "potted plant", "fire hydrant", "dog") and rng.random() < 0.5:
            bottom = rng.uniform(0.2, 1.2)
            if rng.random() < 0.6:
                bottom = _STAND_HEIGHT
                stands.append(where)
        center = (*where, bottom + size[2] / 2)
        landmarks.append({"label": label, "position": center, "yaw": rng.uniform(-np.pi, np.pi), "size": tuple(size)})
    stands += [spot for spot in (place() for _ in range(rng.integers(0, 6))) if spot]
    kinds = clutter_kinds(base)
    for _ in range(rng.integers(6, 20)):
        where = place()
        if where is not None:
            kind = kinds[rng.integers(len(kinds))]
            furniture.append((kind, *where, 0.0, 0.0, 0.0, rng.uniform(-np.pi, np.pi)))
    changes = {
        "name": "random",
        "interior": {"min": (0.0, -width / 2, 0.0), "max": (length, width / 2, 3.0)},
        "landmarks": landmarks,
        "walls": walls,
        "stands": stands,
        "furniture": furniture,
        "furniture_size": dict.fromkeys(kinds, (0.5, 0.5, 0.6)),
    }
    return Room.model_validate_json(
        Room.model_construct(**{**base.model_dump(), **changes}).model_dump_json(warnings=False)
    )


def _is_free(p_WB: np.ndarray, room: Room) -> bool:
    p, low, high = p_WB[:2], np.array(room.interior.min[:2]) + 0.3, np.array(room.interior.max[:2]) - 0.3
    if np.any(p < low) or np.any(p > high):
        return False
    for item in footprints(room):
        beyond = p - np.clip(p, item.low, item.high)
        if np.hypot(*beyond) < item.radius + _CLEARANCE and p_WB[2] < item.top + 0.2:
            return False
    return True


def random_pose(room: Room, rng: np.random.Generator, path: np.ndarray | None = None) -> RigidTransform:
    """Return the pose X_WC of a camera on a vehicle at a random place in a room, tilted as in flight.

    With a path p_W (n x 3) [m], the camera is near a point of the path and looks along W's x axis, as on the paper's
    vehicle. Without a path, the camera is anywhere in the room and mostly looks towards a landmark.
    """
    low, high = np.array(room.interior.min), np.array(room.interior.max)
    for _ in range(1000):
        if path is not None:
            p_WB = path[rng.integers(len(path))] + rng.normal(0.0, [0.3, 0.5, 0.2])
            yaw = rng.normal(0.0, 0.08)
        else:
            p_WB = np.array([rng.uniform(low[0], high[0]), rng.uniform(low[1], high[1]), rng.uniform(0.5, 2.3)])
            yaw = rng.uniform(-np.pi, np.pi)
            if rng.random() < 0.8 and len(room.landmarks):
                target = room.landmark_positions[rng.integers(len(room.landmarks))]
                if np.hypot(*(target - p_WB)[:2]) > 9.0:
                    continue
                yaw = np.arctan2(target[1] - p_WB[1], target[0] - p_WB[0]) + rng.uniform(-0.6, 0.6)
        if _is_free(p_WB, room):
            roll, pitch = rng.normal(0.0, 0.06, 2)
            X_WB = RigidTransform(RollPitchYaw(roll, pitch, yaw), p_WB)
            return X_WB @ camera_in_body(room.camera)
    raise RuntimeError("no free place in the room")
