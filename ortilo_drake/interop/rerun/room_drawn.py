"""The room in a recording: its box, walls, stands, anchors and landmarks, in W [m]; they never change."""

import numpy as np
import rerun as rr

from ortilo_drake.model.room import Room
from ortilo_drake.world.scenery.meshcat_room import class_color

ROOM_GREY, WALL_RED, STAND_GREY, ANCHOR_YELLOW = (150, 152, 156), (173, 92, 66), (110, 112, 118), (255, 184, 0)
ANCHOR_RADIUS = 0.1  # [m]


def class_colors(room: Room) -> list[tuple[int, int, int]]:
    """Return the colour of each landmark class, red, green, blue."""
    rgba = [class_color(room, label) for label in room.classes]
    return [(round(255 * c.r()), round(255 * c.g()), round(255 * c.b())) for c in rgba]


def turned(yaws: np.ndarray) -> np.ndarray:
    """Return turns about W's z [rad] (n) as quaternions (x, y, z, w) (n, 4)."""
    zero = np.zeros_like(yaws)
    return np.column_stack([zero, zero, np.sin(yaws / 2), np.cos(yaws / 2)])


def send_room(recording: rr.RecordingStream, room: Room) -> None:
    """Write the surveyed room below world/room."""
    recording.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    classes = [(i, name, color) for i, (name, color) in enumerate(zip(room.classes, class_colors(room), strict=True))]
    recording.log("world", rr.AnnotationContext(classes), static=True)
    low, high = np.array(room.interior.min), np.array(room.interior.max)
    recording.log("world/room", rr.Boxes3D(mins=[low], sizes=[high - low], colors=[ROOM_GREY]), static=True)
    walls, stands = room.wall_boxes, room.stand_cylinders
    if len(walls):
        boxes = rr.Boxes3D(
            centers=walls[:, 0:3],
            half_sizes=walls[:, 4:7],
            quaternions=turned(walls[:, 3]),
            colors=[WALL_RED],
            fill_mode=rr.components.FillMode.TransparentFillMajorWireframe,
        )
        recording.log("world/room/walls", boxes, static=True)
    if len(stands):
        centers = np.column_stack([stands[:, 0:2], stands[:, 3] / 2])
        cylinders = rr.Cylinders3D(
            centers=centers,
            radii=stands[:, 2],
            lengths=stands[:, 3],
            colors=[STAND_GREY],
            fill_mode=rr.components.FillMode.Solid,
        )
        recording.log("world/room/stands", cylinders, static=True)
    anchors = rr.Points3D(
        room.anchor_positions,
        colors=[ANCHOR_YELLOW],
        radii=[ANCHOR_RADIUS],
        labels=[f"anchor_{i}" for i in range(len(room.anchors))],
    )
    recording.log("world/room/anchors", anchors, static=True)
    if room.landmarks:
        _send_landmarks(recording, room)


def _send_landmarks(recording: rr.RecordingStream, room: Room) -> None:
    sizes = np.array([landmark.size or room.landmark_size[landmark.label] for landmark in room.landmarks])
    boxes = rr.Boxes3D(
        centers=room.landmark_positions,
        sizes=sizes,
        quaternions=turned(np.array([landmark.yaw for landmark in room.landmarks])),
        class_ids=room.landmark_labels.astype(int),
        labels=[landmark.label for landmark in room.landmarks],
    )
    recording.log("world/room/landmarks", boxes, static=True)
