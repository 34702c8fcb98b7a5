"""The camera, boxes of the room's landmarks: what the theory knows of it.

The camera finds landmarks at random. The covariance of its fix is that of the landmarks whose detection rate is at
least one half, and the attitude's covariance, which the fix takes, is that of a filter long fed by the imu alone. A
survey that is learned counts as found exact.
"""

from collections.abc import Mapping
from functools import lru_cache

import numpy as np
from scipy.linalg import block_diag

from ortilo_drake.loop.element import Box, Given
from ortilo_drake.model.input_error import InputError
from ortilo_drake.model.measurement import CAMERA
from ortilo_drake.model.parts import Sensor
from ortilo_drake.model.pinhole import Camera
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import (
    ARRIVED,
    DETECTION_SIZE,
    DETECTIONS_SIZE,
    MAX_DETECTIONS,
    N_X,
    N_XBAR,
    PAYLOAD,
)
from ortilo_drake.onboard.detector.detector_network import load_detector
from ortilo_drake.onboard.landmarks.fix_element import ELEMENTS, camera_fix_box
from ortilo_drake.onboard.landmarks.landmark_fix import LandmarkFix
from ortilo_drake.scenario import Belief, Scenario
from ortilo_drake.scenario import Camera as CameraSettings
from ortilo_drake.scenario.sensors import ParametricErrors
from ortilo_drake.sensors.imu import attitude_covariance
from ortilo_drake.sensors.information_camera import camera_rows, camera_tables
from ortilo_drake.sensors.information_rows import GRADIENT, Information
from ortilo_drake.sensors.unknown_error import Error, moved, spread, walk
from ortilo_drake.world.drawn_truth import Drawn
from ortilo_drake.world.radio.image_delay import check_kept
from ortilo_drake.world.scenery.bent_picture import straight_model
from ortilo_drake.world.scenery.rendering import check_egl
from ortilo_drake.world.sensors.camera_calibration import load_calibration
from ortilo_drake.world.sensors.camera_tables import Tables, look_up, measured_tables, parametric_tables
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
from ortilo_drake.world.sensors.projected_camera_element import camera_box


def as_known(scenario: Belief, room: Room) -> Room:
    """Return the room with the landmarks' shapes as far as they are known onboard."""
    return room if scenario.landmark_fix.shapes == "outlines" else room.model_copy(update={"landmark_outline": {}})


def make_solver(scenario: Belief, room: Room) -> LandmarkFix:
    """Return the landmark fix as a System."""
    return LandmarkFix(scenario.landmark_fix, as_known(scenario, room), scenario.image_width, scenario.h)


def believed_V(scenario: Belief) -> np.ndarray | None:
    """Return the covariance of a fix as the filter believes it, None where it comes with each."""
    V = getattr(scenario.estimator, "V", None)  # of the paper's filter
    return None if V is None or V.camera is None else np.diag(V.camera)


@lru_cache(maxsize=16)
def _camera_of(scenario: Scenario) -> tuple[Camera, Tables]:
    """Return the camera and the rates at which it finds landmarks."""
    room, errors = scenario.load_room(), scenario.camera.errors
    camera = room.camera.scaled_to(scenario.image_width).constants
    if isinstance(errors, ParametricErrors):
        return camera, parametric_tables(errors, room.classes, camera.image)
    return camera, measured_tables(load_calibration(errors), room.classes, scenario.image_width, scenario.h)


@lru_cache(maxsize=16)
def _landmark_fix(scenario: Scenario) -> LandmarkFix:
    settings = scenario.landmark_fix
    if settings.survey_bank is not None:
        settings = settings.model_copy(update={"survey_bank": None, "survey_sd": 0.0})
    return LandmarkFix(settings, scenario.load_room(), scenario.image_width, scenario.h)


def likely_views(scenario: Scenario, room: Room, x: np.ndarray) -> list[tuple[int, int, list[float]]]:
    """Return the landmarks found more often than not at state x (12): number, class, and the box without error."""
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
    """Return the detections message of likely_views."""
    message = np.zeros(DETECTIONS_SIZE)
    message[0] = 1.0
    message[PAYLOAD::DETECTION_SIZE] = -1.0
    for row, (_, label, box) in enumerate(likely_views(scenario, room, x)):
        start = PAYLOAD + row * DETECTION_SIZE
        message[start : start + DETECTION_SIZE] = [label, 1.0, *box]
    return message


def fix_of_boxes(scenario: Scenario, x: np.ndarray, message: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
    """Return the value (m) of the fix of a detections message, and its covariance (m, m); None if there is no fix.

    Args:
        scenario: the scenario.
        x: where the filter believes to be (12).
        message: the detections.
    """
    landmark_fix, m = _landmark_fix(scenario), len(scenario.landmark_fix.rows)
    context = landmark_fix.CreateDefaultContext()
    P = block_diag(np.zeros((3, 3)), attitude_covariance(scenario), np.zeros((N_XBAR - 6, N_XBAR - 6)))
    landmark_fix.GetInputPort("detections").FixValue(context, message)
    landmark_fix.GetInputPort("estimate").FixValue(context, np.concatenate([x, np.zeros(N_XBAR - N_X)]))
    landmark_fix.GetInputPort("covariance").FixValue(context, P.ravel())
    fix = landmark_fix.get_output_port().Eval(context)
    value, covariance = fix[PAYLOAD : PAYLOAD + m], fix[PAYLOAD + m : PAYLOAD + m + m * m].reshape(m, m)
    return np.array(value), np.array(covariance) if fix[ARRIVED] else None


def covariance(scenario: Scenario, room: Room, x: np.ndarray) -> np.ndarray | None:
    """Return the covariance of the fix where the filter believes x (12) to be, by the solver that flies."""
    return fix_of_boxes(scenario, x, likely_detections(scenario, room, x))[1]


def information(scenario: Scenario, room: Room, truth: np.ndarray, seen: np.ndarray) -> Information | None:
    """Return the information of the boxes, see information_camera.py; None of a detector that was not measured."""
    tables = camera_tables(scenario, room)
    if tables is None:
        return None
    rows = camera_rows(tables, room, scenario.image_width, truth, seen)
    return Information({"camera": rows}, max(int(tables.slow[0, 1]), 1))


def unknown(scenario: Scenario, room: Room) -> list[Error]:
    """Return the unknown errors of the camera's and the landmarks' places."""
    survey, camera, n = scenario.truth.survey, scenario.truth.camera, len(room.landmark_positions)
    turn = np.cross(np.eye(3), room.camera.position)  # of the camera's centre by each angle

    def turned(rows: np.ndarray) -> np.ndarray:
        g = rows[:, GRADIENT]
        return np.asarray(g[:, 3:6] - g[:, :3] @ turn.T)

    return [
        walk(spread(survey.landmarks), 0.0, {"camera": moved(-1.0)}),
        walk(spread(survey.landmarks_sd, number=3 * n), 0.0, {"camera": moved(-1.0, n, 2)}),
        walk(spread(camera.position, camera.position_sd), 0.0, {"camera": moved(1.0)}),
        walk(spread(camera.angles, camera.angles_sd), 0.0, {"camera": turned}),
    ]


def solver(scenario: Belief, room: Room) -> Box | None:
    """Return the landmark fix as an element; None where its method is OpenCV's."""
    if scenario.landmark_fix.method not in ELEMENTS:
        return None
    period = scenario.every("camera") * scenario.h
    return camera_fix_box(scenario.landmark_fix, as_known(scenario, room), scenario.image_width, period)


def drawn(scenario: Scenario, room: Room, its: Drawn, boxes: Mapping[str, Box]) -> dict[str, Given]:
    """Return the true camera (place, angles, focal length) and the true places of the landmarks."""
    if scenario.is_rendered:
        return {}
    believed = room.camera.scaled_to(scenario.image_width)
    f = believed.focal_length * float(its["camera.focal_factor"])
    tables = {
        "camera_p_BC": np.array(room.camera.position) + its["camera.position"],
        "camera_lens_reach": believed.model_copy(update={"focal_length": f}).constants.lens.reach,
        "room_positions": room.landmark_positions + its["survey.landmarks"],
    }
    return {"camera": Given({"camera_f": f, "turned": its["camera.angles"]}, tables=tables)}


def only_drake(scenario: Scenario) -> str | None:
    """Return the setting by which Drake alone can play the camera or its fix, which the tight filter does not take."""
    if scenario.is_rendered:
        return "camera.kind: rendered"
    method = scenario.landmark_fix.method
    return None if scenario.estimator.kind == "tight" or method in ELEMENTS else f"landmark_fix.method: {method}"


def check(scenario: Scenario, room: Room) -> None:
    """Refuse a camera whose image is too small or kept too long, whose files are wrong, or that cannot be drawn here.

    Raises:
        InputError: naming the setting.
    """
    try:
        camera = room.camera.scaled_to(scenario.image_width)
    except InputError as error:
        raise InputError(f"camera.{error}") from None
    if scenario.is_rendered:
        if camera.coefficients:
            try:
                straight_model(camera)
            except InputError as error:
                of = "room: camera" if scenario.camera.calibration is None else "camera.calibration"
                raise InputError(f"{of}.{error}") from None
            lens = scenario.truth.camera
            if lens.focal_factor != 1.0 or lens.focal_factor_sd > 0.0:
                raise InputError("truth.camera.focal_factor: must be 1 where a lens that bends is rendered")
        link = scenario.camera.link
        check_kept(scenario.every("camera"), link.delay + link.random_delay, camera.width, camera.height)
        check_egl()
        load_detector(scenario.detector, room, (camera.width, camera.height))
    elif scenario.camera.errors.kind == "measured":
        load_calibration(scenario.camera.errors)


SENSOR = Sensor(
    "camera",
    CameraSettings,
    CAMERA,
    make_onboard=make_solver,
    V=believed_V,
    covariance=covariance,
    information=information,
    unknown=unknown,
    payload=DETECTIONS_SIZE - PAYLOAD,
    element=lambda scenario, room, whole: camera_box(scenario.camera, room, scenario.faults, scenario.h),
    solver=solver,
    drawn=drawn,
    measures="landmarks",
    port="detections",
    only_drake=only_drake,
    check=check,
    advice="not one camera fix: `ortilo detector recognise` says which landmarks the detector knows",
    components="xyz",
    scaled_by=("landmark_fix.center_sd",),
    noise_numbers=lambda scenario: {"landmark_fix.center_sd": scenario.landmark_fix.center_sd},
    stand_in=(0.08, 0.08, 0.08, 0.0025, 0.0025, 0.0025),  # of a position as printed in the paper [m^2], of angles ours
)
