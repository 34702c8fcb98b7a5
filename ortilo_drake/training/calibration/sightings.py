"""Sightings: every landmark in every picture of a flight, with the box in which the detector found the landmark."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw
from scipy.optimize import linear_sum_assignment

from ortilo_drake.model.room import Room
from ortilo_drake.onboard.detector.detector import Boxes
from ortilo_drake.training.judging.evaluate import iou_matrix
from ortilo_drake.world.scenery.rendering import camera_in_body, make_scene_graph, render_cameras
from ortilo_drake.world.scenery.scene import scene_items
from ortilo_drake.world.sensors.landmark_view import (
    BOX,
    INSIDE,
    LANDMARK,
    VIEW_SIZE,
    VISIBLE,
    landmark_views,
    surroundings,
)

LIMITS = np.array([25.0, 1.0])  # landmarks farther away [m], or with a smaller part in the image [px], are left out
LEAST_OVERLAP = 0.3  # least IoU of a box and its landmark; errors of small boxes are large relative to their size


@dataclass(frozen=True)
class Sightings:
    """Landmarks in the pictures of flights, found or not, and false boxes.

    Each landmark in a picture has the number of its picture among all flights' (n), the number of its flight (n), its
    class (n), its view as in landmark_view.py (n x 8), and the box that was seen: u_min, v_min, u_max, v_max [px], NaN
    if not found (n x 4). Each row of `false` has flight, picture, class and box of a false box (m x 7). `pictures` is
    the number of pictures.
    """

    picture: np.ndarray
    flight: np.ndarray
    label: np.ndarray
    view: np.ndarray
    seen: np.ndarray
    false: np.ndarray
    pictures: int

    @property
    def found(self) -> np.ndarray:
        """The mask (n) of landmarks that were found."""
        return np.isfinite(self.seen[:, 0])


def cut_boxes(boxes: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Return boxes (n x 4) [px], cut at the border of an image of this width and height [px]."""
    return np.clip(boxes, -0.5, np.array([*size, *size]) - 0.5)


def match_landmarks(
    labels: np.ndarray, boxes: np.ndarray, truth_labels: np.ndarray, truth: np.ndarray, visible: np.ndarray
) -> np.ndarray:
    """Return the index of each box's landmark, -1 for none (k).

    Boxes (k x 4) and the picture's landmarks, `truth` (m x 4) cut at the image's border, are paired within each class
    so that the sum of IoU is greatest. The visible share of a landmark (m) counts a little, so that of two landmarks
    of a class in the same place, the box goes to the one in front.
    """
    iou, of = iou_matrix(boxes, truth), np.full(len(labels), -1)
    gain = np.where((labels[:, None] == truth_labels) & (iou > LEAST_OVERLAP), iou + 0.2 * visible, 0.0)
    found, which = linear_sum_assignment(-gain)
    there = gain[found, which] > 0.0
    of[found[there]] = which[there]
    return of


def sightings(room: Room, width: int, flights: list[tuple[np.ndarray, list[Boxes]]]) -> Sightings:
    """Return the sightings of flights in a room; each flight has states (k x 12) and the boxes found at each state."""
    camera, around = room.camera.scaled_to(width), surroundings(room)
    size = camera.width, camera.height
    rows, seen, false, picture = [], [], [np.empty((0, 7))], 0
    for flight, (states, found) in enumerate(flights):
        for x, (labels, _, boxes) in zip(states, found, strict=True):
            views = landmark_views(x, around, camera.constants, LIMITS)
            classes = room.landmark_labels[views[:, LANDMARK].astype(int)]
            of = match_landmarks(labels, boxes, classes, cut_boxes(views[:, BOX], size), views[:, VISIBLE])
            box = np.full((len(views), 4), np.nan)
            box[of[of >= 0]] = boxes[of >= 0]
            rows.append(np.column_stack([np.full(len(views), picture), np.full(len(views), flight), classes, views]))
            seen.append(box)
            others = of < 0
            place = np.tile([float(flight), float(picture)], (int(others.sum()), 1))
            false.append(np.column_stack([place, labels[others], boxes[others]]))
            picture += 1
    table = np.concatenate(rows).reshape(-1, 3 + VIEW_SIZE)
    return Sightings(
        picture=table[:, 0].astype(int),
        flight=table[:, 1].astype(int),
        label=table[:, 2].astype(int),
        view=table[:, 3:],
        seen=np.concatenate(seen),
        false=np.concatenate(false),
        pictures=picture,
    )


def is_whole(view: np.ndarray) -> np.ndarray:
    """Return the mask (n) of views (n x 8) whose landmark the image's border does not cut."""
    return view[:, INSIDE] > 1.0 - 1e-9


def detect_in_flight(
    room: Room, width: int, states: np.ndarray, detect: Callable[[np.ndarray], Boxes], done: Callable[[], None]
) -> list[Boxes]:
    """Return the boxes that a detector finds in the pictures at states (k x 12), in the light of flights.

    `width` is the image's width [px]; `done` is called after each picture. InputError if there is no EGL.
    """
    camera = room.camera.scaled_to(width)
    (color, _), X_BC = render_cameras(camera), camera_in_body(camera)
    scene_graph = make_scene_graph(scene_items(room))
    query = scene_graph.get_query_output_port().Eval(scene_graph.CreateDefaultContext())
    world = scene_graph.world_frame_id()
    found = []
    for x in states:
        X_WB = RigidTransform(RollPitchYaw(x[3:6]), x[:3])
        found.append(detect(query.RenderColorImage(color, world, X_WB @ X_BC).data[..., :3]))
        done()
    return found
