"""The landmarks of a room that a detector recognises: along the planned path, and from near."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

from ortilo_drake.model.room import Room
from ortilo_drake.onboard.planner.planner import plan
from ortilo_drake.scenario import Scenario
from ortilo_drake.training.judging.evaluate import Detect, match_detections
from ortilo_drake.training.pictures.labels import LANDMARK, is_to_be_found
from ortilo_drake.training.pictures.renders import Studio
from ortilo_drake.world.scenery.rendering import camera_in_body

NEAR = 2.0  # distance of a view from near [m]
DIRECTIONS = 12  # number of views around the landmark
STEP = 0.25  # distance between pictures along the path [m]


@dataclass(frozen=True)
class Views:
    """The detector's results for one landmark in a number `pictures` of pictures in which it must be found.

    `found` is the number of pictures in which a box of the landmark's class, with at least the score of flights, lies
    on the landmark. `best` is the highest score of such a box, even below the score of flights; 0 without a box.
    """

    pictures: int
    found: int
    best: float


@dataclass(frozen=True)
class Recognised:
    """The detector's results for one landmark: its number in the room, its class, and the results of two sets of views.

    `way` has the views along the planned path, `near` the views from all sides at a distance of NEAR metres.
    """

    number: int
    label: str
    way: Views
    near: Views


def way_poses(scenario: Scenario, room: Room) -> list[RigidTransform]:
    """Return the camera's poses X_WC along the planned path, for a level vehicle."""
    path = plan(scenario.planner, room, scenario.vehicle)
    times = np.linspace(path.start_time(), path.end_time(), 2000)
    points = np.array([np.ravel(path.value(t))[:3] for t in times])
    flown = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    rows = np.searchsorted(flown, np.arange(0.0, flown[-1], STEP))
    return [RigidTransform(points[i]) @ camera_in_body(room.camera) for i in rows]


def near_poses(room: Room, number: int) -> list[RigidTransform]:
    """Return level camera poses X_WC around a landmark, at the landmark's height and towards the landmark."""
    p_WL = np.array(room.landmark_positions[number])
    poses = []
    for angle in np.linspace(0.0, 2.0 * np.pi, DIRECTIONS, endpoint=False):
        R_WB = RotationMatrix.MakeZRotation(angle)
        X_BC = camera_in_body(room.camera)
        forward = R_WB @ X_BC.rotation() @ np.array([0.0, 0.0, 1.0])
        poses.append(RigidTransform(R_WB @ X_BC.rotation(), p_WL - NEAR * forward))
    return poses


def _views(
    detect: Detect, studio: Studio, poses: Iterable[RigidTransform], threshold: float
) -> dict[int, tuple[int, int, float]]:
    """Return the fields of Views (pictures, found, best) for each landmark that was seen, by its number."""
    counted: dict[int, tuple[int, int, float]] = {}
    for X_WC in poses:
        picture, truth = studio.picture(X_WC)
        labels, scores, boxes = detect(picture)
        hit = match_detections(labels, scores, boxes, truth)
        for row in np.flatnonzero(is_to_be_found(truth)):
            score = float(np.max(scores[hit == row], initial=0.0))
            pictures, found, best = counted.get(int(truth[row, LANDMARK]), (0, 0, 0.0))
            counted[int(truth[row, LANDMARK])] = pictures + 1, found + (score >= threshold), max(best, score)
    return counted


def recognised(detect: Detect, scenario: Scenario, threshold: float) -> list[Recognised]:
    """Return a detector's results for each landmark of a scenario's room; `threshold` is the score of flights.

    The detector's own threshold should be far below `threshold`.
    """
    room = scenario.load_room()
    studio = Studio(room, room.classes, room.camera.scaled_to(scenario.camera.width))
    nothing = (0, 0, 0.0)
    way = _views(detect, studio, way_poses(scenario, room), threshold)
    found = []
    for i, landmark in enumerate(room.landmarks):
        near = _views(detect, studio, near_poses(room, i), threshold).get(i, nothing)
        found.append(Recognised(i, landmark.label, Views(*way.get(i, nothing)), Views(*near)))
    return found
