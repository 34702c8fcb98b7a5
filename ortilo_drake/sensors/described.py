"""The descriptions of the sensors that a scenario flies, built-in and registered ones alike."""

import numpy as np
from pydrake.systems.framework import System

from ortilo_drake.loop.element import Box, outside
from ortilo_drake.loop.shell import WiredSystem_
from ortilo_drake.loop.wiring import Wiring
from ortilo_drake.model.measurement import CAMERA, IMU, UWB
from ortilo_drake.model.parts import Sensor, find_sensor
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import IMU_SIZE, N_XBAR, PAYLOAD, uwb_size
from ortilo_drake.model.white_noise import white_variances
from ortilo_drake.onboard.estimator.whole_belief import together_box
from ortilo_drake.onboard.landmarks.landmark_fix import LandmarkFix
from ortilo_drake.onboard.ranging.fix_element import fix_box
from ortilo_drake.scenario import Belief, Scenario
from ortilo_drake.scenario import Camera as CameraSettings
from ortilo_drake.scenario import Imu as ImuSettings
from ortilo_drake.scenario import Uwb as UwbSettings
from ortilo_drake.sensors.faster import with_samples


def _imu_period(scenario: Belief) -> float:
    """Return the time between two samples of the imu [s]."""
    return scenario.h / scenario.samples("imu")


def _diagonal(variances: tuple[float, ...] | None) -> np.ndarray | None:
    return None if variances is None else np.diag(variances)


def _of_fix(scenario: Scenario, room: Room, states: np.ndarray) -> np.ndarray:
    """Say that a position's noise follows from geometry: studies/loop/fix_covariance.py has it."""
    raise NotImplementedError("the noise of a fix from ranges or boxes is that of studies/loop/fix_covariance.py")


def as_known(scenario: Belief, room: Room) -> Room:
    """Return the room with the landmarks' shapes as far as they are known onboard."""
    return room if scenario.landmark_fix.shapes == "outlines" else room.model_copy(update={"landmark_outline": {}})


def solver_system(port: str, size: int, solver: Box, h: float) -> System:
    """Return an element that makes fixes as a System with the ports of make_onboard (model/parts.py).

    Args:
        port: name of the messages' port.
        size: of a message.
        solver: reads `message` and `belief`.
        h: tick [s].
    """
    prior = together_box("prior")
    inputs = [outside(port, size), outside("estimate", N_XBAR), outside("covariance", N_XBAR**2)]
    wiring = Wiring([*inputs, prior, solver.reading(message=port, belief="prior")])
    return WiredSystem_[float](solver.name, wiring, {"fix": (solver.name,)}, h)


def _uwb_solver(scenario: Belief, room: Room) -> System:
    solver = fix_box(scenario.multilateration, room.anchor_positions)
    return solver_system("uwb", uwb_size(len(room.anchors)), solver, scenario.h)


BUILT_IN = {
    "uwb": Sensor(
        "uwb",
        UwbSettings,
        UWB,
        make_world=None,
        sd=_of_fix,
        make_onboard=_uwb_solver,
        V=lambda scenario: _diagonal(scenario.estimator.V.uwb),
    ),
    "camera": Sensor(
        "camera",
        CameraSettings,
        CAMERA,
        make_world=None,
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
        make_world=None,
        sd=lambda scenario, room, states: np.full((len(states), 3), scenario.imu.sds(_imu_period(scenario))[0]),
        payload=IMU_SIZE - PAYLOAD,
        V=lambda scenario: np.diag(white_variances(scenario.estimator.V.imu, _imu_period(scenario))),
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
