"""The errors of the filter's measurement rows at a place, from errors of the world.

A fix errs by D e where what it is made of errs by e: ranges, or the boxes' centres in the image. Its sensor says D, the
derivative of the very solver that flies, by differences (`made` of model/parts.py).
"""

import numpy as np

from ortilo_drake.floor.unknown_errors import force_errors, unknown_of
from ortilo_drake.model.measurement import Measurement
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import N_X
from ortilo_drake.scenario import Scenario
from ortilo_drake.sensors.described import described
from ortilo_drake.sensors.information_rows import rows_of
from ortilo_drake.sensors.unknown_error import Error
from ortilo_drake.studies.loop.hover_loop import message_of


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
    sensor = described(name)
    if sensor.made is not None:
        made = sensor.made(scenario, room, x)
        return {} if made is None else {name: (name, *made)}
    rows = numbered(len(sensor.rows))
    found = {name: (name, np.eye(len(rows)), rows)}
    if "gyroscope" in measurement.sensors and message_of("gyroscope", measurement) == name:
        found["rates"] = ("gyroscope", np.eye(3), numbered(3))
    return found
