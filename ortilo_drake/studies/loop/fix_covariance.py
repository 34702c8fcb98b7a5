"""Covariance of what each sensor tells at a place, as the filter would receive it there.

Nothing is derived here anew: each sensor says it itself (model/parts.py, `covariance` and `sd`). Of ranges and boxes
those of the place, without noise, go through the very solvers that fly.
"""

from typing import NamedTuple

import numpy as np

from ortilo_drake.floor.unknown_errors import unknown_of
from ortilo_drake.model.signals import PAYLOAD
from ortilo_drake.onboard.ranging.multilateration import fix_of
from ortilo_drake.scenario import Scenario
from ortilo_drake.sensors.described import covariance_at, flown
from ortilo_drake.sensors.information_ranges import range_rows
from ortilo_drake.sensors.information_rows import SOURCE
from ortilo_drake.sensors.uwb import message_without_noise

STEP = 1e-4  # of the differences [m]


class FixNoise(NamedTuple):
    """The noise of the fixes at a place, and which there are.

    Attributes:
        V: covariance of each sensor's value, by name [m^2], [rad^2]; the identity where it gives none.
        there: whether a message of each sensor would yield a value there.
    """

    V: dict[str, np.ndarray]
    there: dict[str, bool]


def value_noise(scenario: Scenario, name: str, x: np.ndarray) -> tuple[np.ndarray, bool]:
    """Return the covariance (m, m) of the value of a sensor that flies at state x (12), and whether it gives one."""
    found = covariance_at(name, scenario, scenario.load_room(), x)
    believed = flown(name, scenario).V(scenario)
    if believed is None:
        believed = np.eye(len(scenario.measurement.C_of(name))) if found is None else found
    return believed, found is not None


def lasting_offset(scenario: Scenario, x: np.ndarray) -> np.ndarray:
    """Return the covariance (3 x 3) of the fix's error that stays as it is at state x (12): survey and ranges' biases.

    Ranges that err by c move the fix by G c, G the derivative of the solver that flies. The integral of the position's
    error holds the vehicle where the fix says r, so that its own error is -G c. The truth's errors count as of mean
    zero, see floor/unknown_errors.py. It is 0 where other fixes than uwb's hold the position, which is not in it.
    """
    if "uwb" not in scenario.sensors or len(position_sensors(scenario)) > 1:
        return np.zeros((3, 3))
    room, settings = scenario.load_room(), scenario.multilateration
    rows = range_rows(scenario.uwb, room, x[np.newaxis], np.ones(1, dtype=bool))
    anchors, ranges = room.anchor_positions, message_without_noise(scenario, room, x)

    def fix(longer: float, i: int) -> np.ndarray:
        message = ranges.copy()
        message[PAYLOAD + i] += longer
        return fix_of(settings, anchors, message, x)[PAYLOAD : PAYLOAD + 3]

    heard = ranges[PAYLOAD + len(anchors) :] > 0.0
    zero = np.zeros(3)
    G = np.column_stack(
        [(fix(STEP, i) - fix(-STEP, i)) / (2.0 * STEP) if heard[i] else zero for i in rows[:, SOURCE].astype(int)]
    )
    moved = np.zeros((3, 3))
    for error in unknown_of(scenario, room, "uwb"):
        if (error.keeps == 1.0).all() and not error.step_sd.any():
            by = G @ error.sees["uwb"](rows) * error.sd
            moved += by @ by.T
    return moved


def position_sensors(scenario: Scenario) -> list[str]:
    """Return the sensors of a scenario that fly and give the position."""
    measurement = scenario.measurement
    return [name for name in measurement.positions if name in scenario.sensors]


def fix_noise(scenario: Scenario, x: np.ndarray) -> FixNoise:
    """Return V_2 and what is there at state x (12). Links and blackouts are left out."""
    V, there = {}, {}
    for name in scenario.measurement.sensors:
        V[name], there[name] = np.eye(len(scenario.measurement.C_of(name))), name in scenario.sensors
        if there[name]:
            V[name], there[name] = value_noise(scenario, name, x)
    return FixNoise(V, there)
