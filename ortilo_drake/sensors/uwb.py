"""The uwb sensor, ranges to the room's anchors: what the theory knows of it."""

import numpy as np
from pydrake.systems.framework import System

from ortilo_drake.model.measurement import UWB
from ortilo_drake.model.parts import Sensor
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import ARRIVED, FIX_SIZE, PAYLOAD, uwb_size
from ortilo_drake.onboard.ranging.fix_element import fix_box
from ortilo_drake.onboard.ranging.multilateration import fix_of
from ortilo_drake.scenario import Belief, Scenario, Uwb
from ortilo_drake.sensors.information_ranges import range_rows
from ortilo_drake.sensors.information_rows import Information
from ortilo_drake.sensors.messages import solver_system
from ortilo_drake.sensors.unknown_error import Error, gauss_markov, moved, own, spread, walk
from ortilo_drake.world.noise import stream_id
from ortilo_drake.world.sensors.uwb import ranging_settings, uwb_message


def make_solver(scenario: Belief, room: Room) -> System:
    """Return the multilateration as a System."""
    solver = fix_box(scenario.multilateration, room.anchor_positions)
    return solver_system("uwb", uwb_size(len(room.anchors)), solver, scenario.h)


def believed_V(scenario: Belief) -> np.ndarray | None:
    """Return the covariance of a fix as the filter believes it, None where it comes with each."""
    return None if scenario.estimator.V.uwb is None else np.diag(scenario.estimator.V.uwb)


def message_without_noise(scenario: Scenario, room: Room, x: np.ndarray) -> np.ndarray:
    """Return the message at state x (12), its ranges without noise but behind the scenario's walls."""
    boxes = room.wall_boxes if scenario.uwb.walls.kind != "none" else np.empty((0, 7))
    settings = ranging_settings(scenario.uwb)
    settings[:2] = 0.0
    unbiased = np.zeros(len(room.anchors))
    return np.asarray(
        uwb_message(x, room.anchor_positions, unbiased, boxes, settings, 0, stream_id("uwb"), 0.0, scenario.h)
    )


def covariance(scenario: Scenario, room: Room, x: np.ndarray) -> np.ndarray | None:
    """Return the covariance of the fix where the filter believes x (12) to be, by the solver that flies."""
    ranges = message_without_noise(scenario, room, x)
    fix = fix_of(scenario.multilateration, room.anchor_positions, ranges, x)
    return fix[PAYLOAD + 3 : FIX_SIZE].reshape(3, 3) if fix[ARRIVED] else None


def information(scenario: Scenario, room: Room, truth: np.ndarray, seen: np.ndarray) -> Information:
    """Return the information of the ranges; see sensors/information_ranges.py."""
    return Information({"uwb": range_rows(scenario.uwb, room, truth, seen)})


def unknown(scenario: Scenario, room: Room) -> list[Error]:
    """Return what is unknown of the ranges and of where the anchors stand."""
    uwb, survey, n = scenario.truth.uwb, scenario.truth.survey, len(room.anchor_positions)
    return [
        walk(spread(uwb.bias, number=1), 0.0, {"uwb": lambda rows: np.ones((len(rows), 1))}),
        walk(spread(uwb.bias_sd, number=n), 0.0, {"uwb": own(n)}),
        gauss_markov(spread(uwb.slow_sd, number=n), uwb.slow_time, scenario.h, {"uwb": own(n)}),
        walk(spread(survey.anchors), 0.0, {"uwb": moved(-1.0)}),
        walk(spread(survey.anchors_sd, number=3 * n), 0.0, {"uwb": moved(-1.0, n)}),
    ]


SENSOR = Sensor(
    "uwb",
    Uwb,
    UWB,
    make_onboard=make_solver,
    V=believed_V,
    covariance=covariance,
    information=information,
    unknown=unknown,
    stand_in=(0.05, 0.05, 0.05),  # as printed in the paper
)
