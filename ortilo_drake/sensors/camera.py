"""The complete description of the camera, which measures boxes of the room's landmarks."""

from collections.abc import Mapping

import numpy as np

from ortilo_drake.loop.element import Box, Values
from ortilo_drake.model.input_error import InputError
from ortilo_drake.model.measurement import CAMERA
from ortilo_drake.model.parts import Sensor
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import DETECTION_SIZE, DETECTIONS_SIZE, MAX_DETECTIONS, PAYLOAD
from ortilo_drake.onboard.detector.detector_network import load_detector
from ortilo_drake.onboard.landmarks.fix_element import ELEMENTS, camera_fix_box
from ortilo_drake.onboard.landmarks.landmark_fix import LandmarkFix, as_known
from ortilo_drake.scenario import Belief, Scenario
from ortilo_drake.scenario import Camera as CameraSettings
from ortilo_drake.sensors import camera_theory
from ortilo_drake.world.drawn_truth import Drawn
from ortilo_drake.world.radio.image_delay import check_kept
from ortilo_drake.world.scenery.bent_picture import straight_model
from ortilo_drake.world.scenery.rendering import check_egl
from ortilo_drake.world.sensors.camera_calibration import load_calibration
from ortilo_drake.world.sensors.projected_camera import camera_box


def make_solver(scenario: Belief, room: Room) -> LandmarkFix:
    """Return the landmark fix as a System."""
    return LandmarkFix(scenario.landmark_fix, as_known(scenario.landmark_fix, room), scenario.image_width, scenario.h)


def believed_V(scenario: Belief) -> np.ndarray | None:
    """Return the fix's noise covariance in the filter's settings, None if each fix has its own covariance."""
    its = scenario.linear_filter
    return None if its is None or its.V.camera is None else np.diag(its.V.camera)


def covariance(scenario: Scenario, room: Room, x: np.ndarray) -> np.ndarray | None:
    """Return the covariance of the fix if the estimate is x (12), computed by the onboard solver."""
    return camera_theory.fix_of_boxes(scenario, x, camera_theory.likely_detections(scenario, room, x))[1]


def solver(scenario: Belief, room: Room) -> Box | None:
    """Return the landmark fix as an element; None if its method is OpenCV's."""
    if scenario.landmark_fix.method not in ELEMENTS:
        return None
    period = scenario.every("camera") * scenario.h
    return camera_fix_box(scenario.landmark_fix, as_known(scenario.landmark_fix, room), scenario.image_width, period)


def drawn(scenario: Scenario, room: Room, its: Drawn, boxes: Mapping[str, Box]) -> dict[str, Values]:
    """Return the true camera (position, angles, focal length) and the true positions of the landmarks."""
    if scenario.is_rendered:
        return {}
    believed = room.camera.scaled_to(scenario.image_width)
    f = believed.focal_length * float(its["camera.focal_factor"])
    tables = {
        "camera_p_BC": np.array(room.camera.position) + its["camera.position"],
        "camera_lens_reach": believed.model_copy(update={"focal_length": f}).constants.lens.reach,
        "room_positions": room.landmark_positions + its["survey.landmarks"],
    }
    return {"camera": Values({"camera_f": f, "turned": its["camera.angles"]}, tables=tables)}


def only_drake(scenario: Scenario) -> str | None:
    """Return the setting of the camera or its fix that only Drake can play; the tight filter does not use the fix."""
    if scenario.is_rendered:
        return "camera.kind: rendered"
    method = scenario.landmark_fix.method
    return None if scenario.estimator.kind == "tight" or method in ELEMENTS else f"landmark_fix.method: {method}"


def check(scenario: Scenario, room: Room) -> None:
    """Check the camera's settings; InputError names the wrong setting.

    The image may be too small or be stored too long, files may be wrong, or this machine may be unable to render.
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


def limits(scenario: Scenario, room: Room) -> tuple[np.ndarray, np.ndarray]:
    """Return the smallest and the largest payload, a row for each box."""
    camera = room.camera.scaled_to(scenario.image_width)
    width, height = camera.width - 0.5, camera.height - 0.5  # a pixel's centre has integer coordinates
    low, high = [-1.0, 0.0, *[-0.5] * 4], [len(room.classes) - 1.0, 1.0, width, height, width, height]
    return np.tile(low, MAX_DETECTIONS), np.tile(high, MAX_DETECTIONS)


SENSOR = Sensor(
    "camera",
    CameraSettings,
    CAMERA,
    make_onboard=make_solver,
    V=believed_V,
    covariance=covariance,
    information=camera_theory.information,
    unknown=camera_theory.unknown,
    made=camera_theory.made,
    learned=camera_theory.learned,
    left_out=camera_theory.left_out,
    mismatches=camera_theory.MISMATCHES,
    payload=DETECTIONS_SIZE - PAYLOAD,
    members=lambda scenario, payload: (
        (
            f"double boxes[{MAX_DETECTIONS}][{DETECTION_SIZE}];",
            "label (-1: unused), score, u_min, v_min, u_max, v_max [px]",
        ),
    ),
    limits=limits,
    whole=lambda scenario, room: list(range(0, MAX_DETECTIONS * DETECTION_SIZE, DETECTION_SIZE)),
    element=lambda scenario, room, whole: camera_box(scenario.camera, room, scenario.faults, scenario.h),
    solver=solver,
    drawn=drawn,
    measures="landmarks",
    port="detections",
    only_drake=only_drake,
    check=check,
    advice="not one camera fix: `ortilo detector recognise` says which landmarks the detector knows",
    components="xyz",
    noise_settings=("landmark_fix.center_sd",),
    noise_numbers=lambda scenario: {"landmark_fix.center_sd": scenario.landmark_fix.center_sd},
    nominal_variances=(*(0.08,) * 3, *(0.0025,) * 3),  # position: the paper's [m^2]; angles: ours [rad^2]
)
