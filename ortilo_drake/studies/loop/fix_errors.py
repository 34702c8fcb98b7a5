"""The errors of the filter's measurement rows at a place, from errors of the world.

A fix errs by D e where its ranges, or the boxes' centres in the image, err by e. D is the derivative of the very
solver that flies, by differences.
"""

from collections.abc import Callable

import numpy as np

from ortilo_drake.floor.unknown_errors import force_errors, unknown_of
from ortilo_drake.model.measurement import Measurement
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import DETECTION_SIZE, N_X, PAYLOAD
from ortilo_drake.onboard.ranging.multilateration import fix_of
from ortilo_drake.scenario import Scenario
from ortilo_drake.sensors.camera import fix_of_boxes, likely_detections, likely_views
from ortilo_drake.sensors.described import described, information_of
from ortilo_drake.sensors.information_ranges import range_rows
from ortilo_drake.sensors.information_rows import SOURCE, rows_of
from ortilo_drake.sensors.unknown_error import Error
from ortilo_drake.sensors.uwb import message_without_noise

RANGE_STEP, PIXEL_STEP = 1e-4, 0.05  # of the differences [m], [px]

Fixed = tuple[np.ndarray, np.ndarray]  # D (m, l), and the rows (l, 17) of which it is the derivative


def of_ranges(scenario: Scenario, room: Room, x: np.ndarray) -> Fixed:
    """Return D (3, l) of the multilateration at state x (12), and the ranges' rows."""
    anchors, ranges = room.anchor_positions, message_without_noise(scenario, room, x)
    rows = range_rows(scenario.uwb, room, x[np.newaxis], np.ones(1, dtype=bool))
    rows = rows[ranges[PAYLOAD + len(anchors) :][rows[:, SOURCE].astype(int)] > 0.0]

    def fix(message: np.ndarray) -> np.ndarray:
        return fix_of(scenario.multilateration, anchors, message, x)[PAYLOAD : PAYLOAD + 3]

    return _derivative(fix, ranges, PAYLOAD + rows[:, SOURCE].astype(int), RANGE_STEP), rows


def of_boxes(scenario: Scenario, room: Room, x: np.ndarray) -> Fixed | None:
    """Return D (m, l) of the landmark fix at state x (12), and the rows of u and v of the boxes that it takes.

    None of a detector that was not measured.
    """
    found = information_of("camera", scenario, room, x[np.newaxis], np.ones(1, dtype=bool))
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

    D = _derivative(fix, likely_detections(scenario, room, x), at, PIXEL_STEP)
    return D, np.array(rows)


def _derivative(
    fix: Callable[[np.ndarray], np.ndarray], message: np.ndarray, at: list[list[int]] | np.ndarray, step: float
) -> np.ndarray:
    """Return the derivative of a fix by each of some numbers of its message, or of several that move together."""
    columns = []
    for places in at:
        moved = np.zeros(len(message))
        moved[places] = step
        columns.append((fix(message + moved) - fix(message - moved)) / (2.0 * step))
    return np.column_stack(columns)


def errors_of_rows(scenario: Scenario, measurement: Measurement, x: np.ndarray) -> list[tuple[Error, np.ndarray]]:
    """Return the unknown errors of a scenario's world, and their coefficients in the rows of y at state x (p, e).

    They are those of floor/unknown_errors.py, of mean zero and a variance that is the square of the value plus that of
    the spread. Not among them is how an attitude filter leans.

    Args:
        scenario: the scenario flown.
        measurement: the rows that its filter gets, see hover_loop.filter_measurement.
        x: true state, hovering (12).
    """
    room, p = scenario.load_room(), measurement.sizes["y"]
    found = [(error, np.zeros((p, len(error.sd)))) for error in force_errors(scenario, 0.0)]
    for error, C in found:  # one that drives the vehicle is in the force f already, the others are the imu's
        if "accelerometer" in measurement.sensors and "force" in error.sees and not error.G.any():
            C[measurement.rows_of("accelerometer")] = error.sees["force"](numbered(3)) / scenario.vehicle.mass
    for name in scenario.sensors:
        made = _rows_and_what_makes_them(scenario, room, measurement, name, x)
        for error in unknown_of(scenario, room, name):
            if error.by_x.any():
                continue
            C = np.zeros((p, len(error.sd)))
            for kind, (sensor, D, rows) in made.items():
                if kind in error.sees:
                    C[measurement.rows_of(sensor)] += D @ error.sees[kind](rows)
            found.append((error, C))
    return found


def numbered(number: int) -> np.ndarray:
    """Return rows whose sources are 0, 1, ... (number, 17)."""
    return rows_of(np.zeros(number), np.zeros((number, N_X)), np.ones(number), np.arange(number))


def _rows_and_what_makes_them(
    scenario: Scenario, room: Room, measurement: Measurement, name: str, x: np.ndarray
) -> dict[str, tuple[str, np.ndarray, np.ndarray]]:
    """Return by the kind of rows that a sensor's errors are seen in: whose rows of y they make, D, and the rows."""
    if name == "uwb":
        return {"uwb": ("uwb", *of_ranges(scenario, room, x))}
    if name == "camera":
        fixed = of_boxes(scenario, room, x)
        return {} if fixed is None else {"camera": ("camera", *fixed)}
    rows = numbered(len(described(name).rows))
    found = {name: (name, np.eye(len(rows)), rows)}
    if name == "imu" and "gyroscope" in measurement.sensors:
        found["rates"] = ("gyroscope", np.eye(3), numbered(3))
    return found
