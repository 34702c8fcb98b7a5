"""The descriptions of the sensors that a scenario flies, built-in and registered ones alike."""

import numpy as np
from pydrake.systems.framework import System

from ortilo_drake.model.measurement import CAMERA, IMU, UWB
from ortilo_drake.model.parts import Sensor, find_sensor
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import IMU_SIZE, PAYLOAD, uwb_size
from ortilo_drake.model.white_noise import white_variances
from ortilo_drake.onboard.landmarks.landmark_fix import LandmarkFix
from ortilo_drake.onboard.ranging.fix_element import fix_box
from ortilo_drake.scenario import Belief, Scenario
from ortilo_drake.scenario import Camera as CameraSettings
from ortilo_drake.scenario import Imu as ImuSettings
from ortilo_drake.scenario import Uwb as UwbSettings
from ortilo_drake.sensors.faster import with_samples
from ortilo_drake.sensors.messages import solver_system


def _diagonal(variances: tuple[float, ...] | None) -> np.ndarray | None:
    return None if variances is None else np.diag(variances)


def _of_fix(scenario: Scenario, room: Room, states: np.ndarray) -> np.ndarray:
    """Say that a position's noise follows from geometry: studies/loop/fix_covariance.py has it."""
    raise NotImplementedError("the noise of a fix from ranges or boxes is that of studies/loop/fix_covariance.py")


def as_known(scenario: Belief, room: Room) -> Room:
    """Return the room with the landmarks' shapes as far as they are known onboard."""
    return room if scenario.landmark_fix.shapes == "outlines" else room.model_copy(update={"landmark_outline": {}})


def _uwb_solver(scenario: Belief, room: Room) -> System:
    solver = fix_box(scenario.multilateration, room.anchor_positions)
    return solver_system("uwb", uwb_size(len(room.anchors)), solver, scenario.h)


BUILT_IN = {
    "uwb": Sensor(
        "uwb",
        UwbSettings,
        UWB,
        sd=_of_fix,
        make_onboard=_uwb_solver,
        V=lambda scenario: _diagonal(scenario.estimator.V.uwb),
    ),
    "camera": Sensor(
        "camera",
        CameraSettings,
        CAMERA,
        sd=_of_fix,
        make_onboard=lambda scenario, room: LandmarkFix(
            scenario.landmark_fix, as_known(scenario, room), scenario.image_width, scenario.h
        ),
        V=lambda scenario: _diagonal(scenario.estimator.V.camera),
    ),
    "imu": Sensor(
        "imu",
        ImuSettings,
        IMU,
        sd=lambda scenario, room, states: np.full((len(states), 3), scenario.imu.sds(scenario.imu_period)[0]),
        payload=IMU_SIZE - PAYLOAD,
        V=lambda scenario: np.diag(white_variances(scenario.estimator.V.imu, scenario.imu_period)),
    ),
}


def described(name: str) -> Sensor:
    """Return the description of a sensor; KeyError if it is neither built in nor registered."""
    found = BUILT_IN.get(name) or find_sensor(name)
    if found is None:
        raise KeyError(name)
    return found


def flown(name: str, scenario: Belief) -> Sensor:
    """Return the description of a sensor as a scenario flies it: of one faster than the tick, that of its means."""
    n = scenario.samples(name)
    return described(name) if n == 1 else with_samples(described(name), n)
