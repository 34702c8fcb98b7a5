"""Covariance of a position fix at a place, as the filter would receive it there.

Nothing is derived here anew. The ranges and boxes of the place, without noise, go through the very systems that fly
(multilateration, landmark fix), and what comes out is V_2 and whether there is a fix at all.

The camera finds landmarks at random. Here it finds those whose detection rate is at least one half. The landmark fix
takes the attitude's covariance from a filter that has long been fed by the IMU alone.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag

from ortilo_drake.model.geometry.line_of_sight import walls_crossed
from ortilo_drake.model.pinhole import Camera
from ortilo_drake.model.signals import (
    ARRIVED,
    DETECTION_SIZE,
    DETECTIONS_SIZE,
    MAX_DETECTIONS,
    N_I,
    N_U,
    N_X,
    N_XBAR,
    PAYLOAD,
)
from ortilo_drake.model.white_noise import white_variances
from ortilo_drake.onboard.estimator.filter_loops import filter_step
from ortilo_drake.onboard.estimator.filter_model import filter_model, initial_covariance
from ortilo_drake.onboard.landmarks.landmark_fix import LandmarkFix
from ortilo_drake.onboard.ranging.multilateration import fix_of
from ortilo_drake.scenario import Scenario
from ortilo_drake.scenario.sensors import ParametricErrors
from ortilo_drake.sensors.described import flown
from ortilo_drake.world.noise import stream_id
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
from ortilo_drake.world.sensors.uwb import ranging_settings, uwb_message

SETTLED = 300  # ticks after which the attitude's covariance no longer changes


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
    return LandmarkFix(scenario.landmark_fix, scenario.load_room(), scenario.image_width, scenario.h)


@lru_cache(maxsize=16)
def attitude_covariance(scenario: Scenario) -> np.ndarray:
    """Return the filter's covariance of roll, pitch and yaw (3 x 3) [rad^2] with the IMU alone, after settling."""
    model = filter_model(scenario.estimator, scenario.vehicle, "estimate", scenario.h, scenario.yaw)
    measurement, every = scenario.measurement, scenario.every("imu")
    belief = np.concatenate((np.zeros(N_XBAR), initial_covariance(scenario.estimator).ravel()))
    y, delta, V2 = (np.zeros(size) for size in measurement.sizes.values())
    V2[measurement.block_of("imu")] = np.diag(white_variances(scenario.estimator.V.imu, scenario.h)).ravel()
    u, r, imu = np.zeros(N_U), np.zeros(N_I), measurement.sensors.index("imu")
    for k in range(SETTLED):
        delta[imu] = float("imu" in scenario.sensors and k % every == 0)
        belief = filter_step(belief, y, delta, V2, u, r, model, measurement.layout)
    return np.array(belief[N_XBAR:].reshape(N_XBAR, N_XBAR)[3:6, 3:6])


def uwb_without_noise(scenario: Scenario, x: np.ndarray) -> np.ndarray:
    """Return the uwb message at state x (12), its ranges without noise but behind the scenario's walls."""
    room = scenario.load_room()
    boxes = room.wall_boxes if scenario.uwb.walls.kind != "none" else np.empty((0, 7))
    settings = ranging_settings(scenario.uwb)
    settings[:2] = 0.0
    unbiased = np.zeros(len(room.anchors))
    message = np.asarray(
        uwb_message(x, room.anchor_positions, unbiased, boxes, settings, 0, stream_id("uwb"), 0.0, scenario.h)
    )
    if scenario.belief.uwb.behind_walls == "left_out":
        n = len(unbiased)
        for i, anchor in enumerate(room.anchor_positions):
            if walls_crossed(x[:3], anchor, room.wall_boxes):
                message[PAYLOAD + i] = message[PAYLOAD + n + i] = 0.0
    return message


def likely_detections(scenario: Scenario, x: np.ndarray) -> np.ndarray:
    """Return the detections message at state x (12) of the landmarks found more often than not, boxes without error."""
    room = scenario.load_room()
    camera, tables = _camera_of(scenario)
    message = np.zeros(DETECTIONS_SIZE)
    message[0] = 1.0
    message[PAYLOAD::DETECTION_SIZE] = -1.0
    row = 0
    for view in landmark_views(x, surroundings(room), camera, tables.limits):
        label = room.landmark_labels[int(view[LANDMARK])]
        rate = look_up(tables.found, 1 + int(label), view[DISTANCE])
        rate *= look_up(tables.inside, 1, view[INSIDE]) * look_up(tables.visible, 1, view[VISIBLE])
        if rate < 0.5 or view[VISIBLE] < tables.limits[2] or row == MAX_DETECTIONS:
            continue
        box = [cut(edge, size) for edge, size in zip(view[BOX], np.tile(camera.image, 2), strict=True)]
        start = PAYLOAD + row * DETECTION_SIZE
        message[start : start + DETECTION_SIZE] = [label, 1.0, *box]
        row += 1
    return message


def landmark_fix_at(scenario: Scenario, x: np.ndarray, detections: np.ndarray) -> np.ndarray:
    """Return the fix message (14) that a detections message yields where the filter believes x (12) to be."""
    landmark_fix = _landmark_fix(scenario)
    context = landmark_fix.CreateDefaultContext()
    P = block_diag(np.zeros((3, 3)), attitude_covariance(scenario), np.zeros((N_XBAR - 6, N_XBAR - 6)))
    landmark_fix.GetInputPort("detections").FixValue(context, detections)
    landmark_fix.GetInputPort("estimate").FixValue(context, np.concatenate([x, np.zeros(N_XBAR - N_X)]))
    landmark_fix.GetInputPort("covariance").FixValue(context, P.ravel())
    return np.asarray(landmark_fix.get_output_port().Eval(context))


def range_fix_at(scenario: Scenario, x: np.ndarray, uwb: np.ndarray) -> np.ndarray:
    """Return the fix message (14) that a uwb message yields where the filter believes x (12) to be."""
    return fix_of(scenario.multilateration, scenario.load_room().anchor_positions, uwb, x)


class FixNoise(NamedTuple):
    """The noise of the fixes at a place, and which there are.

    Attributes:
        V: covariance of each sensor's value, by name [m^2], [rad^2]; the identity where it gives none.
        there: whether a message of each sensor would yield a value there.
    """

    V: dict[str, np.ndarray]
    there: dict[str, bool]


def _fix_at(scenario: Scenario, sensor: str, x: np.ndarray) -> np.ndarray | None:
    """Return the fix message (14) of uwb or camera at state x (12), None where there is none."""
    if sensor == "uwb":
        fix = range_fix_at(scenario, x, uwb_without_noise(scenario, x))
    else:
        fix = landmark_fix_at(scenario, x, likely_detections(scenario, x))
    return fix if fix[ARRIVED] else None


def fix_noise(scenario: Scenario, x: np.ndarray) -> FixNoise:
    """Return V_2 and what is there at state x (12). Links and blackouts are left out."""
    room, V, there = scenario.load_room(), {}, {}
    for name in scenario.measurement.sensors:
        sensor, m = flown(name, scenario), len(scenario.measurement.C_of(name))
        V[name], there[name] = np.eye(m), name in scenario.sensors
        if not there[name]:
            continue
        believed = sensor.V(scenario)
        if name in ("uwb", "camera"):
            fix = _fix_at(scenario, name, x)
            there[name] = fix is not None
            if fix is not None and believed is None:
                believed = fix[PAYLOAD + m :].reshape(m, m)
        else:
            sd = sensor.sd(scenario, room, x[np.newaxis])[0]
            there[name] = bool(np.isfinite(sd).all())
            if there[name] and believed is None:
                believed = np.diag(sd**2)
        if believed is not None and (there[name] or sensor.V(scenario) is not None):
            V[name] = believed
    return FixNoise(V, there)


def _hovering_at(scenario: Scenario, p_WB: np.ndarray) -> np.ndarray:
    x = np.zeros(N_X)
    x[:3], x[5] = p_WB, scenario.yaw
    return x
