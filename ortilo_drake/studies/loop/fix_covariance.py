"""Covariance of a position fix at a place: the one that the filter would be told there.

Nothing is derived here anew. The ranges and boxes of the place, without noise, go through the very systems that fly
(multilateration, landmark fix, handler), and what comes out is V_2 and whether there is a fix at all.

What the camera finds is random; here it finds each landmark that it finds more often than not. The landmark fix
believes of the attitude what the filter, fed by the IMU alone, believes of it in the long run.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag

from ortilo_drake.model.hover import discretize, hover_A, hover_B
from ortilo_drake.model.pinhole import Camera
from ortilo_drake.model.signals import (
    DETECTION_SIZE,
    DETECTIONS_SIZE,
    FIX_SIZE,
    IMU_SIZE,
    MAX_DETECTIONS,
    MEASUREMENT_DELTA,
    MEASUREMENT_SIZE,
    MEASUREMENT_V2,
    N_X,
    N_XBAR,
    PAYLOAD,
    SENSORS,
)
from ortilo_drake.onboard.estimator.intermittent_filter import INTEGRATOR_ESTIMATE, filter_step
from ortilo_drake.onboard.estimator.kalman_filter import initial_covariance, process_noise
from ortilo_drake.onboard.estimator.measurement_handler import MeasurementHandler
from ortilo_drake.onboard.landmarks.landmark_fix import LandmarkFix
from ortilo_drake.onboard.ranging.multilateration import Multilateration
from ortilo_drake.scenario import Scenario
from ortilo_drake.scenario.sensors import ParametricErrors
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
def _systems(scenario: Scenario) -> tuple[Multilateration, LandmarkFix, MeasurementHandler]:
    """Return what flies between the messages and the filter."""
    room = scenario.load_room()
    return (
        Multilateration(scenario.multilateration, room.anchor_positions),
        LandmarkFix(scenario.landmark_fix, room, scenario.image_width),
        MeasurementHandler(scenario.estimator.gates, scenario.estimator.V, scenario.h, SENSORS),
    )


@lru_cache(maxsize=16)
def attitude_covariance(scenario: Scenario) -> np.ndarray:
    """Return the filter's covariance of roll, pitch and yaw (3 x 3) [rad^2] with the IMU alone, after settling."""
    Phi, Gamma = discretize(hover_A(), hover_B(scenario.vehicle), scenario.h)
    W = process_noise(scenario.estimator, scenario.vehicle, scenario.h)
    every = scenario.every("imu")
    xhat, P = np.zeros(N_XBAR), initial_covariance(scenario.estimator).ravel()
    measurement = np.zeros(MEASUREMENT_SIZE)
    measurement[MEASUREMENT_V2] = np.concatenate([np.eye(3).ravel()] * 2 + [np.diag(scenario.estimator.V.imu).ravel()])
    for k in range(SETTLED):
        measurement[11] = float("imu" in scenario.sensors and k % every == 0)
        P = filter_step(xhat, P, measurement, np.zeros(4), np.zeros(3), Phi, Gamma, W, INTEGRATOR_ESTIMATE)[N_XBAR:]
    return np.array(P.reshape(N_XBAR, N_XBAR)[3:6, 3:6])


def uwb_without_noise(scenario: Scenario, x: np.ndarray) -> np.ndarray:
    """Return the uwb message at state x (12), its ranges without noise but behind the scenario's walls."""
    room = scenario.load_room()
    boxes = room.wall_boxes if scenario.uwb.walls.kind != "none" else np.empty((0, 7))
    settings = ranging_settings(scenario.uwb)
    settings[:2] = 0.0
    unbiased = np.zeros(len(room.anchors))
    return np.asarray(
        uwb_message(x, room.anchor_positions, unbiased, boxes, settings, 0, stream_id("uwb"), 0.0, scenario.h)
    )


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
    _, landmark_fix, _ = _systems(scenario)
    context = landmark_fix.CreateDefaultContext()
    P = block_diag(np.zeros((3, 3)), attitude_covariance(scenario), np.zeros((N_XBAR - 6, N_XBAR - 6)))
    landmark_fix.GetInputPort("detections").FixValue(context, detections)
    landmark_fix.GetInputPort("estimate").FixValue(context, np.concatenate([x, np.zeros(N_XBAR - N_X)]))
    landmark_fix.GetInputPort("covariance").FixValue(context, P.ravel())
    return np.asarray(landmark_fix.get_output_port().Eval(context))


def range_fix_at(scenario: Scenario, x: np.ndarray, uwb: np.ndarray) -> np.ndarray:
    """Return the fix message (14) that a uwb message yields where the filter believes x (12) to be."""
    multilateration, _, _ = _systems(scenario)
    context = multilateration.CreateDefaultContext()
    multilateration.GetInputPort("uwb").FixValue(context, uwb)
    multilateration.GetInputPort("estimate").FixValue(context, np.concatenate([x, np.zeros(N_XBAR - N_X)]))
    return np.asarray(multilateration.get_output_port().Eval(context))


class FixNoise(NamedTuple):
    """What would reach the filter at a place.

    Attributes:
        V: covariances of uwb, camera and imu (3, 3, 3) [m^2], [rad^2]; the identity where there is no fix.
        there: whether a message of uwb, camera and imu would yield a measurement there (3).
    """

    V: np.ndarray
    there: np.ndarray


def fix_noise(scenario: Scenario, x: np.ndarray) -> FixNoise:
    """Return V_2 and what is there at state x (12), by the handler's own output. Links and blackouts are left out."""
    _, _, handler = _systems(scenario)
    context = handler.CreateDefaultContext()
    imu = np.zeros(IMU_SIZE)
    imu[0] = float("imu" in scenario.sensors)
    nothing = np.zeros(FIX_SIZE)
    uwb = range_fix_at(scenario, x, uwb_without_noise(scenario, x)) if "uwb" in scenario.sensors else nothing
    found = landmark_fix_at(scenario, x, likely_detections(scenario, x)) if "camera" in scenario.sensors else nothing
    for name, value in (("uwb", uwb), ("camera", found), ("imu", imu)):
        handler.GetInputPort(name).FixValue(context, value)
    if handler.HasInputPort("estimate"):  # gates: a fix without noise passes them
        handler.GetInputPort("estimate").FixValue(context, np.concatenate([x, np.zeros(N_XBAR - N_X)]))
        handler.GetInputPort("covariance").FixValue(context, np.zeros(N_XBAR**2))
    measurement = handler.get_output_port().Eval(context)
    return FixNoise(measurement[MEASUREMENT_V2].reshape(3, 3, 3).copy(), measurement[MEASUREMENT_DELTA] > 0.0)


def uwb_covariance(scenario: Scenario, p_WB: np.ndarray) -> np.ndarray | None:
    """Return the covariance (3 x 3) [m^2] of a UWB fix at p_WB (3), None where there is none."""
    noise = fix_noise(scenario.model_copy(update={"sensors": ("uwb",)}), _hovering_at(scenario, p_WB))
    return noise.V[0] if noise.there[0] else None


def camera_covariance(scenario: Scenario, x: np.ndarray) -> np.ndarray | None:
    """Return the covariance (3 x 3) [m^2] of a landmark fix at state x (12, or the first six), None without one."""
    state = np.zeros(N_X)
    state[: len(x)] = x
    noise = fix_noise(scenario, state)
    return noise.V[1] if noise.there[1] else None


def V_at(scenario: Scenario, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return V (9 x 9) at state x (12) and which of uwb, camera and imu are there (3).

    The rows of a sensor that is not there hold the identity.
    """
    noise = fix_noise(scenario, x)
    return block_diag(*noise.V), noise.there


def _hovering_at(scenario: Scenario, p_WB: np.ndarray) -> np.ndarray:
    x = np.zeros(N_X)
    x[:3], x[5] = p_WB, scenario.servo.yaw
    return x
