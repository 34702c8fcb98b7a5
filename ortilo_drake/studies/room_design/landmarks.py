"""Placement of landmarks, so that the camera helps where the ranges help least.

They stand on the floor on a grid of free spots, away from the path, of the room's own classes in turn, so that
neighbours differ. The search is that for anchors (place.py), with their ranges as they are. A box's centre depends as
much on the attitude as on the position: with the angles known to a covariance Q from the imu alone, it informs p_WB by

    J = J_pp - J_pt (J_tt + Q^-1)^-1 J_tp,

as if the angles erred anew for each landmark. What is reported of the room is the bound with all of it.
"""

from collections.abc import Sequence

import numpy as np

from ortilo_drake.floor.cramer_rao import dynamics
from ortilo_drake.floor.information_arrivals import arrived
from ortilo_drake.floor.information_filter import predicted_bound
from ortilo_drake.model.footprints import footprints
from ortilo_drake.model.input_error import InputError
from ortilo_drake.model.room import Landmark, Room
from ortilo_drake.model.signals import N_X
from ortilo_drake.scenario import Scenario
from ortilo_drake.sensors.described import measuring
from ortilo_drake.sensors.information_camera import camera_rows, camera_tables
from ortilo_drake.studies.room_design.path_bound import step_information

AWAY = 0.5  # from the vehicle's outline on its path [m]
ON_FLOOR = 0.1  # a class stands on the floor if one of the room's does, by so much [m]


def standing_classes(room: Room) -> list[str]:
    """Return the landmark classes that stand on the floor of a room, or all it has sizes of where it has no landmark.

    InputError if there is none.
    """
    found = [
        landmark.label
        for landmark in room.landmarks
        if landmark.position[2] - 0.5 * (landmark.size or room.landmark_size[landmark.label])[2] < ON_FLOOR
    ]
    classes = list(dict.fromkeys(found)) or sorted(room.landmark_size)
    if not classes:
        raise InputError("landmark_size: the room knows no class of landmarks that could be placed")
    return classes


def floor_spots(
    room: Room, classes: Sequence[str], spacing: float, path: np.ndarray, vehicle_radius: float
) -> list[Landmark]:
    """Return landmarks that could stand on the floor, one on each free spot of a grid [m], their classes in turn.

    Spots keep off the room's obstacles, and off the vehicle's outline on its path, p_WB (k, 3), of a radius [m].
    """
    things, near = footprints(room), path[:: max(1, len(path) // 400), :2]
    low, high = np.array(room.interior.min), np.array(room.interior.max)
    found: list[Landmark] = []
    for x in np.arange(low[0] + spacing / 2.0, high[0], spacing):
        for y in np.arange(low[1] + spacing / 2.0, high[1], spacing):
            label, p = classes[len(found) % len(classes)], np.array([x, y])
            size = room.landmark_size[label]
            reach = 0.5 * float(np.hypot(size[0], size[1]))
            beyond = [np.hypot(*(p - np.clip(p, item.low, item.high))) - item.radius for item in things]
            aside = min([*beyond, *(p - low[:2]), *(high[:2] - p)])
            on_path = np.hypot(*(near - p).T).min() - vehicle_radius - AWAY
            if min(aside, on_path) > reach and size[2] < high[2] - low[2]:
                where = (round(float(x), 3), round(float(y), 3), round(float(low[2]) + size[2] / 2.0, 4))
                found.append(Landmark(label=label, position=where))
    return found


def angle_information(scenario: Scenario, imu_rows: np.ndarray, ticks: int) -> np.ndarray:
    """Return Q^-1 (3, 3) of the angles that rows of the imu alone leave at the end of a flight."""
    Phi, W = dynamics(scenario)
    P = predicted_bound(imu_rows, ticks, Phi, W, np.zeros((N_X, N_X)), 1)
    return np.asarray(np.linalg.inv(P[-1, 3:6, 3:6] + 1e-12 * np.eye(3)))


def landmark_information(
    scenario: Scenario, truth: np.ndarray, room: Room, spots: Sequence[Landmark], Q_inverse: np.ndarray, m: int
) -> np.ndarray:
    """Return each landmark's information on p_WB in each step of m ticks [1/m^2] (c, steps, 3, 3).

    Each of the spots (c) is looked at alone, along states x_k (n, 12), by the scenario's camera; the room hides them,
    and the angles are known by Q^-1 (3, 3).
    """
    steps, seen = -(-len(truth) // m), arrived(scenario, measuring("landmarks"), truth)
    J = np.zeros((len(spots), steps, 3, 3))
    alone = [room.model_copy(update={"landmarks": (spot,)}) for spot in spots]
    tables = {its.landmarks[0].label: its for its in alone}
    known = {label: camera_tables(scenario, its) for label, its in tables.items()}
    for c, its in enumerate(alone):
        of_class = known[its.landmarks[0].label]
        assert of_class is not None, "there is a floor"
        both = step_information(camera_rows(of_class, its, scenario.image_width, truth, seen), steps, m)
        J_pp, J_pt, J_tt = both[:, :3, :3], both[:, :3, 3:6], both[:, 3:6, 3:6]
        J[c] = J_pp - J_pt @ np.linalg.solve(J_tt + Q_inverse, J_pt.transpose(0, 2, 1))
    return J
