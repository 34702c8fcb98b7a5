"""The theory of the boxes: likely boxes, their information and errors, and the errors of a fix made from them.

The camera detects landmarks at random. The theory counts the landmarks with a detection rate of at least one half. The
attitude's covariance for the fix is the settled one of a filter with the imu alone.
"""

from functools import lru_cache

import numpy as np
from scipy.linalg import block_diag

from ortilo_drake.model.pinhole import Camera
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import ARRIVED, DETECTION_SIZE, MAX_DETECTIONS, N_X, N_XBAR, PAYLOAD
from ortilo_drake.onboard.detector.detector import detections_message
from ortilo_drake.onboard.estimator.filter_model import filter_of
from ortilo_drake.onboard.landmarks.landmark_bank import REPEATS
from ortilo_drake.onboard.landmarks.landmark_fix import LandmarkFix, as_known
from ortilo_drake.onboard.ranging.survey_bank import MEMORY
from ortilo_drake.scenario import Scenario
from ortilo_drake.sensors.imu import attitude_covariance
from ortilo_drake.sensors.information_camera import camera_rows, camera_tables
from ortilo_drake.sensors.information_rows import GRADIENT, SOURCE, VARIANCE, Information
from ortilo_drake.sensors.learned_survey import residual_information, share_learned, with_biases
from ortilo_drake.sensors.mismatch import Mismatch, of_truth
from ortilo_drake.sensors.unknown_error import Error, Made, along_position, derivative, spread, walk
from ortilo_drake.world.sensors.camera_tables import Tables, look_up, tables_of
from ortilo_drake.world.sensors.landmark_view import (
    BOX,
    DISTANCE,
    INSIDE,
    LANDMARK,
    VISIBLE,
    cut,
    landmark_views,
    surroundings,
)

STEP = 0.05  # step of the finite differences [px]
MISMATCHES = (
    Mismatch("landmarks surveyed to sd [cm]", of_truth("survey.landmarks_sd", 0.01), 3.0, (5.0,), 160.0),
    Mismatch(
        "only the sizes of landmarks known, not their shapes",
        lambda value: (("landmark_fix.shapes", "boxes"),),
        1.0,
        (1.0,),
        None,
    ),
    Mismatch("camera turned by sd [deg]", of_truth("camera.angles_sd", np.pi / 180.0), 0.5, (1.0,), 32.0),
)


@lru_cache(maxsize=16)
def _camera_of(scenario: Scenario) -> tuple[Camera, Tables]:
    """Return the scenario's camera and its tables of detection rates and errors."""
    room = scenario.load_room()
    return room.camera.scaled_to(scenario.image_width).constants, tables_of(scenario.camera, room, scenario.h)


@lru_cache(maxsize=16)
def _landmark_fix(scenario: Scenario) -> LandmarkFix:
    settings = scenario.landmark_fix
    if settings.survey_bank is not None:
        settings = settings.model_copy(update={"survey_bank": None, "survey_sd": 0.0})
    return LandmarkFix(settings, as_known(settings, scenario.load_room()), scenario.image_width, scenario.h)


def likely_views(scenario: Scenario, room: Room, x: np.ndarray) -> list[tuple[int, int, list[float]]]:
    """Return the landmarks with a detection rate of at least 0.5 at state x (12): index, class, error-free box [px]."""
    camera, tables = _camera_of(scenario)
    found = list[tuple[int, int, list[float]]]()
    for view in landmark_views(x, surroundings(room), camera, tables.limits):
        landmark = int(view[LANDMARK])
        label = int(room.landmark_labels[landmark])
        rate = look_up(tables.found, 1 + label, view[DISTANCE])
        rate *= look_up(tables.inside, 1, view[INSIDE]) * look_up(tables.visible, 1, view[VISIBLE])
        if rate < 0.5 or view[VISIBLE] < tables.limits[2] or len(found) == MAX_DETECTIONS:
            continue
        box = [cut(edge, size) for edge, size in zip(view[BOX], np.tile(camera.image, 2), strict=True)]
        found.append((landmark, label, box))
    return found


def likely_detections(scenario: Scenario, room: Room, x: np.ndarray) -> np.ndarray:
    """Return the detections message with the boxes of likely_views."""
    found = likely_views(scenario, room, x)
    boxes = np.array([box for _, _, box in found]).reshape(-1, 4)
    return detections_message(0.0, np.array([label for _, label, _ in found]), np.ones(len(found)), boxes)


def fix_of_boxes(scenario: Scenario, x: np.ndarray, message: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
    """Return the value (m) of the fix of a detections message, and its covariance (m, m), None if there is no fix.

    The filter's estimate is x (12).
    """
    m, xhat = len(scenario.landmark_fix.rows), np.concatenate([x, np.zeros(N_XBAR - N_X)])
    P = block_diag(np.zeros((3, 3)), attitude_covariance(scenario), np.zeros((N_XBAR - 6, N_XBAR - 6)))
    fix = _landmark_fix(scenario).fix_at(message, xhat, P.ravel())
    value, covariance = fix[PAYLOAD : PAYLOAD + m], fix[PAYLOAD + m : PAYLOAD + m + m * m].reshape(m, m)
    return value, covariance if fix[ARRIVED] else None


def information(scenario: Scenario, room: Room, truth: np.ndarray, seen: np.ndarray) -> Information | None:
    """Return the information of the boxes, see information_camera.py; None if the detector's errors are not known."""
    tables = camera_tables(scenario, room)
    if tables is None:
        return None
    rows = camera_rows(tables, room, scenario.image_width, truth, seen)
    return Information({"camera": rows}, max(int(tables.slow[0, 1]), 1))


def unknown(scenario: Scenario, room: Room) -> list[Error]:
    """Return the unknown errors of the camera's position and angles, and of the landmarks' positions."""
    survey, camera, n = scenario.truth.survey, scenario.truth.camera, len(room.landmark_positions)
    turn = np.cross(np.eye(3), room.camera.position)  # derivative of the camera's position with respect to each angle

    def turned(rows: np.ndarray) -> np.ndarray:
        g = rows[:, GRADIENT]
        return np.asarray(g[:, 3:6] - g[:, :3] @ turn.T)

    return [
        walk(spread(survey.landmarks), 0.0, {"camera": along_position(-1.0)}),
        walk(spread(survey.landmarks_sd, number=3 * n), 0.0, {"camera": along_position(-1.0, n, 2)}),
        walk(spread(camera.position, camera.position_sd), 0.0, {"camera": along_position(1.0)}),
        walk(spread(camera.angles, camera.angles_sd), 0.0, {"camera": turned}),
    ]


def made(scenario: Scenario, room: Room, x: np.ndarray) -> Made | None:
    """Return D (m, l) of the landmark fix at state x (12), and the rows (l, 17) of u and v of the fix's boxes.

    The result is None if the detector's errors are not known.
    """
    found = information(scenario, room, x[np.newaxis], np.ones(1, dtype=bool))
    if found is None:
        return None
    of_source = {int(row[SOURCE]): row for row in found.rows["camera"]}
    at, rows = list[list[int]](), list[np.ndarray]()
    for k, (landmark, _, _) in enumerate(likely_views(scenario, room, x)):
        for axis in range(2):
            if 2 * landmark + axis in of_source:
                edge = PAYLOAD + k * DETECTION_SIZE + 2 + axis
                at.append([edge, edge + 2])
                rows.append(of_source[2 * landmark + axis])

    def fix(message: np.ndarray) -> np.ndarray:
        value, _ = fix_of_boxes(scenario, x, message)
        return value

    return derivative(fix, likely_detections(scenario, room, x), at, STEP), np.array(rows)


def learned(scenario: Scenario, room: Room, x: np.ndarray) -> Scenario:
    """Return the scenario with the landmarks' survey error that the filter's bank learns at state x (12)."""
    settings, h = scenario.landmark_fix, scenario.h
    found = None if settings.survey_bank is None else made(scenario, room, x)
    if found is None:
        return scenario
    biases, rows, n = filter_of(scenario).biases, found[1], len(room.landmark_positions)
    M = residual_information(rows[:, GRADIENT][:, :6], rows[:, VARIANCE])
    A = along_position(-1.0, n, 2)(rows)
    seen = sorted({int(source) // 2 for source in rows[:, SOURCE]})
    # the bank learns each landmark separately
    told = [A[:, 3 * i : 3 * i + 3].T @ np.where(_of(rows, i), M, 0.0) @ A[:, 3 * i : 3 * i + 3] for i in seen]
    fixes = MEMORY / (scenario.every("camera") * h) / REPEATS
    its_information = fixes * np.concatenate([np.linalg.eigvalsh(each) for each in told])
    s = settings.survey_sd
    s *= share_learned(np.array(settings.survey_bank), s, its_information, scenario.truth.survey.landmarks_sd)
    settings = settings.model_copy(update={"survey_bank": None, "survey_sd": s})
    scenario = scenario.model_copy(update={"landmark_fix": settings})
    found = made(scenario, room, x)
    assert found is not None
    sigma = s * np.linalg.norm(found[0][:3] @ A, axis=1)
    own = np.array(biases.camera_sd)
    if not own.any():
        return scenario
    lasts, decays = sigma @ sigma, own @ own
    r = (lasts + np.exp(-h / biases.camera_time) * decays) / (lasts + decays)
    return with_biases(scenario, camera_sd=tuple(np.hypot(sigma, own)), camera_time=float(-h / np.log(r)))


def _of(rows: np.ndarray, landmark: int) -> np.ndarray:
    own = rows[:, SOURCE].astype(int) // 2 == landmark
    return np.logical_and.outer(own, own)


def left_out(scenario: Scenario) -> tuple[dict[str, bool], dict[str, bool]]:
    """Return the settings that the predicted rms neglects, and those that only it includes; see model/parts.py."""
    return {"landmark_fix.noise_scale": scenario.landmark_fix.noise_scale is not None}, {}
