"""Limits of each signal of a scenario, given by its vehicle, its room, its sensors' noise and its links.

The limits of the vehicle's motion follow from the largest command and the room (sensors/envelope.py). Each sensor's
description has the limits of its payload. The limits are wide: an honest half never exceeds them, even in a bad flight.
"""

from typing import Final, NamedTuple

import numpy as np

from ortilo_drake.model.signals import ACTS, ARRIVED, N_I, N_X, PAYLOAD, SENSORS, size_of_samples
from ortilo_drake.scenario import Scenario
from ortilo_drake.sensors.described import described, measuring, port_of
from ortilo_drake.sensors.envelope import envelope_of
from ortilo_drake.sensors.messages import message_size

LOOSE: Final = 1000.0  # limit of an estimate over the vehicle's own limit, for a filter that has diverged
LARGEST: Final = 1e6  # limit of the values of a registered sensor that names no limits itself
LATEST: Final = 1e6  # limit of reported times, longer than any flight [s]; onboard does not use times in the future
FARTHEST: Final = 1e4  # limit of a requested goal [m]; the onboard half refuses goals outside the room


class Limits(NamedTuple):
    """The limits `low` and `high` of a vector's entries; message vectors begin with arrived and stamp.

    Entries at the indices `whole` are whole numbers. A stamp may be `oldest` ticks old. The message carries `samples`
    samples, 0 if it is a single sample itself.
    """

    low: np.ndarray
    high: np.ndarray
    whole: np.ndarray = np.empty(0, dtype=int)
    oldest: int = 0
    samples: int = 0


def _symmetric(high: np.ndarray) -> Limits:
    return Limits(-high, high)


def _message(
    low: np.ndarray, high: np.ndarray, oldest: int, whole: list[int] | None = None, samples: int = 1
) -> Limits:
    """Return the limits of a message, given the limits of one sample's payload; check_stamp checks the stamps."""
    head = np.array([0.0, -np.inf]), np.array([1.0, np.inf])
    one = np.concatenate((head[0], low)), np.concatenate((head[1], high))
    indices = np.array([ARRIVED, *(PAYLOAD + i for i in whole or ())])
    if samples == 1:
        return Limits(*one, indices, oldest)
    indices = np.concatenate([[ARRIVED], *(size_of_samples(one[0].size, i) + indices for i in range(samples))])
    low, high = (np.concatenate((ends, np.tile(of_one, samples))) for ends, of_one in zip(head, one, strict=True))
    return Limits(low, high, indices, oldest, samples)


def limits_of(scenario: Scenario) -> dict[str, Limits]:
    """Return the limits of every signal by name: those of ports, MEASUREMENT, TELEMETRY, command and goal."""
    room = scenario.load_room()
    low, high = np.array(room.interior.min), np.array(room.interior.max)
    u, size, force, speed, rate, angles = envelope_of(scenario, room)
    euler_rates = 4.0 * rate * np.ones(3)  # up to MAX_TILT, Euler rates are at most 4 times the body rates

    def oldest(sensor: str) -> int:
        link = scenario.link_of(sensor)
        return link.delay + link.random_delay

    def of_sensor(name: str) -> Limits:
        sensor = described(name)
        payload = message_size(sensor, scenario, room) - PAYLOAD
        largest = np.full(payload, LARGEST)
        bounds = sensor.limits(scenario, room) if sensor.limits else (-largest, largest)
        late, samples = oldest(name) + scenario.latency_of(name), scenario.samples(name)
        return _message(*bounds, late, sensor.whole(scenario, room), samples)

    motion = np.concatenate((speed * np.ones(3), euler_rates))
    position = size * np.ones(3)
    state = LOOSE * np.concatenate((position, angles, motion, size * np.ones(N_I)))
    measurement = scenario.measurement
    values = np.abs(measurement.layout.C) @ state[:N_X]
    path = np.concatenate((speed * np.ones(3), force * np.ones(3)))
    nothing, pictures = np.empty(0), oldest(measuring("landmarks"))
    acts_low, acts_high = (np.tile(row, ACTS) for row in ([-1.0, -1.0, *-u], [LATEST, LATEST, *u]))
    report = scenario.report_link
    return {port_of(name): of_sensor(name) for name in dict.fromkeys((*SENSORS, *scenario.sensors))} | {
        "shutter": _message(nothing, nothing, pictures),
        "image": Limits(nothing, nothing, oldest=pictures),
        "velocity": _message(-motion, motion, 0),
        "acted": _message(acts_low, acts_high, report.delay + report.random_delay),
        "command": _symmetric(u),
        "y": _symmetric(values),
        "delta": Limits(np.zeros(measurement.sizes["delta"]), np.ones(measurement.sizes["delta"])),
        "V2": _symmetric((LOOSE * size) ** 2 * np.ones(measurement.sizes["V2"])),
        "estimate": _symmetric(state),
        "covariance": _symmetric(np.outer(state, state).ravel()),
        "reference": Limits(np.concatenate((low - 1e-6, -path)), np.concatenate((high + 1e-6, path))),
        "goal": _symmetric(FARTHEST * np.ones(2)),
    }
