"""Limits of each signal of a scenario: what its vehicle, its room, its sensors' noise and its links can give.

The largest command gives the largest accelerations. These and the room give the largest velocities, and the positions
and attitudes until the flight counts as lost (flight/lost.py). From all of these follow the sensors' limits:

    a = f / m + g,  v = sqrt(2 a L),  alpha_i = tau_i / I_i,  w = sqrt(2 alpha 2 pi) + alpha h

with L the room's diagonal: v is the speed after crossing the room, w that after a full turn, under the largest command
from rest. Noise counts with SIGMAS standard deviations. These limits are wide: an honest half never exceeds them, even
if it flies badly.
"""

import math
from itertools import product
from typing import Final, NamedTuple

import numpy as np

from ortilo_drake.flight.lost import MAX_TILT
from ortilo_drake.model.range_pairs import ROW, THERE, A, B
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import (
    ACTS,
    ARRIVED,
    DETECTION_SIZE,
    MAX_DETECTIONS,
    N_I,
    N_X,
    PAYLOAD,
    SENSORS,
    size_of_samples,
)
from ortilo_drake.model.vehicle import GRAVITY, Vehicle, mixing_matrix
from ortilo_drake.scenario import Scenario
from ortilo_drake.sensors.described import described
from ortilo_drake.sensors.messages import message_size
from ortilo_drake.world.sensors.fitted_errors import largest_sd
from ortilo_drake.world.sensors.fitted_uwb import noise_of

ASKED: Final = 8.0  # a servo may ask for this many times what the rotors give; ideal rotors give it
SIGMAS: Final = 10.0
MEANS: Final = 50.0  # of an exponential length: as rare as 10 standard deviations
LOOSE: Final = 1000.0  # times what the vehicle does: so wrong an estimate may be, of a filter that has lost it
LARGEST: Final = 1e6  # of what a registered sensor sends, where it names no limits itself
LATEST: Final = 1e6  # longer than any flight [s]; what it reports of later than now is not used onboard
FARTHEST: Final = 1e4  # of a goal that somebody may ask for [m]; onboard it is refused if it is not in the room


class Limits(NamedTuple):
    """Limits of a vector's entries; message vectors begin with arrived and stamp.

    Attributes:
        low: least values.
        high: greatest values.
        whole: indices of the entries that are whole numbers.
        oldest: how old a stamp may be, in ticks.
        samples: how many samples the message carries, 0 where it is one itself.
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
    """Return the limits of a message from those of the payload of one sample; check_stamp checks its stamps."""
    head = np.array([0.0, -np.inf]), np.array([1.0, np.inf])
    one = np.concatenate((head[0], low)), np.concatenate((head[1], high))
    indices = np.array([ARRIVED, *(PAYLOAD + i for i in whole or ())])
    if samples == 1:
        return Limits(*one, indices, oldest)
    indices = np.concatenate([[ARRIVED], *(size_of_samples(one[0].size, i) + indices for i in range(samples))])
    low, high = (np.concatenate((ends, np.tile(of_one, samples))) for ends, of_one in zip(head, one, strict=True))
    return Limits(low, high, indices, oldest, samples)


def largest_command(vehicle: Vehicle) -> np.ndarray:
    """Return the largest size of u (4) that a servo may ask for [N, N m]."""
    by_rotor = mixing_matrix(vehicle) * vehicle.rotor_max_speed**2
    either_way = [np.maximum(sign * by_rotor, 0.0).sum(axis=1) for sign in (1.0, -1.0)]
    return ASKED * np.maximum(*either_way)


def largest_ranges(scenario: Scenario, room: Room, reach: float) -> np.ndarray:
    """Return the largest range to each anchor (n) [m], of a vehicle in the room or up to `reach` outside."""
    low, high = np.array(room.interior.min) - reach, np.array(room.interior.max) + reach
    corners = np.array(list(product(*zip(low, high, strict=True))))
    distances = np.linalg.norm(corners[:, np.newaxis] - room.anchor_positions, axis=2).max(axis=0)
    (s_0, s_1), walls = scenario.uwb.sds, scenario.uwb.walls
    sd = s_0 + s_1 * distances
    if scenario.uwb.errors == "fitted":
        sd = np.full(len(distances), largest_sd(noise_of(scenario.uwb)))
    wall = walls.per_wall if walls.kind == "bias" else MEANS * walls.mean if walls.kind == "excess" else 0.0
    bias = wall * len(room.wall_boxes)
    return distances + bias + SIGMAS * sd


def payload_of_ranges(scenario: Scenario, ranges: np.ndarray) -> tuple[np.ndarray, np.ndarray, list[int]]:
    """Return the least and the largest payload of the uwb's message, and which of its numbers are whole.

    Args:
        scenario: the scenario.
        ranges: the largest range to each anchor (n) [m].
    """
    n, uwb = ranges.size, scenario.uwb
    if uwb.kind == "ranges":
        return np.zeros(2 * n), np.concatenate((ranges, np.ones(n))), list(range(n, 2 * n))
    rows, most, oldest = uwb.rows(scenario.h), 2.0 * ranges.max(), uwb.link.every(scenario.h) * scenario.h
    low, high = [0.0, 0.0, -most, 0.0, 0.0], [n - 1.0, n - 1.0, most, 1.0, oldest]
    return np.tile(low, rows), np.tile(high, rows), [ROW * j + i for j in range(rows) for i in (A, B, THERE)]


def limits_of(scenario: Scenario) -> dict[str, Limits]:
    """Return the limits of every signal by its name: of the ports, MEASUREMENT and TELEMETRY, command and goal."""
    room, vehicle, h, disturbance = scenario.load_room(), scenario.vehicle, scenario.h, scenario.world.disturbance
    low, high = np.array(room.interior.min), np.array(room.interior.max)
    size = float(np.linalg.norm(high - low))
    u, (force_sd, torque_sd) = largest_command(vehicle), disturbance.sds(h)
    force = (u[0] + SIGMAS * force_sd) / vehicle.mass
    speed = math.sqrt(2.0 * (force + GRAVITY) * size)
    alpha = float(np.max((u[1:] + SIGMAS * torque_sd) / vehicle.inertia))
    rate = math.sqrt(2.0 * alpha * 2.0 * math.pi) + alpha * h
    tilt = MAX_TILT + rate * h
    angles = np.array([tilt, tilt, abs(scenario.yaw) + 2.0 * math.pi + rate * h])
    euler_rates = 4.0 * rate * np.ones(3)  # at MAX_TILT, Euler rates are at most 4 times the body's

    def oldest(sensor: str) -> int:
        link = scenario.link_of(sensor)
        return link.delay + link.random_delay

    angle_sd, rate_sd, specific_force_sd = scenario.imu.sds(scenario.imu_period)
    inertial = np.concatenate(
        (
            angles + SIGMAS * angle_sd + (0.0 if scenario.imu.ahrs is None else math.pi),
            (2.0 * rate + SIGMAS * rate_sd) * np.ones(3),
            (force + SIGMAS * specific_force_sd) * np.ones(3),
        )
    )
    ranges = largest_ranges(scenario, room, speed * (h + scenario.uwb.round))
    uwb_low, uwb_high, uwb_whole = payload_of_ranges(scenario, ranges)
    camera = room.camera.scaled_to(scenario.image_width)
    width, height = camera.width - 0.5, camera.height - 0.5  # of a pixel's centre at whole numbers
    box_low = np.tile([-1.0, 0.0, -0.5, -0.5, -0.5, -0.5], MAX_DETECTIONS)
    box_high = np.tile([len(room.classes) - 1.0, 1.0, width, height, width, height], MAX_DETECTIONS)
    labels = list(range(0, MAX_DETECTIONS * DETECTION_SIZE, DETECTION_SIZE))
    motion = np.concatenate((speed * np.ones(3), euler_rates))
    position = size * np.ones(3)
    state = LOOSE * np.concatenate((position, angles, motion, size * np.ones(N_I)))
    measurement = scenario.measurement
    values = np.abs(measurement.layout.C) @ state[:N_X]
    path = np.concatenate((speed * np.ones(3), force * np.ones(3)))
    latency = scenario.camera.latency
    nothing = np.empty(0)
    own = {}
    for name in set(scenario.sensors) - set(SENSORS):
        sensor = described(name)
        payload = message_size(sensor, scenario, room) - PAYLOAD
        bounds = np.full(payload, -LARGEST), np.full(payload, LARGEST)
        own[name] = _message(
            *(sensor.limits(scenario, room) if sensor.limits else bounds), oldest(name), samples=scenario.samples(name)
        )
    acts_low, acts_high = (np.tile(row, ACTS) for row in ([-1.0, -1.0, *-u], [LATEST, LATEST, *u]))
    report = scenario.report_link
    return own | {
        "imu": _message(-inertial, inertial, oldest("imu"), samples=scenario.samples("imu")),
        "uwb": _message(uwb_low, uwb_high, oldest("uwb"), uwb_whole),
        "detections": _message(box_low, box_high, oldest("camera") + latency, labels),
        "shutter": _message(nothing, nothing, oldest("camera")),
        "image": Limits(nothing, nothing, oldest=oldest("camera")),
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
