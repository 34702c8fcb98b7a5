"""The Cramer-Rao floor along a planned path, with all sensors, and without each sensor in turn."""

from typing import NamedTuple

import numpy as np

from ortilo_drake.floor.cramer_rao import position_floor
from ortilo_drake.model.signals import N_X
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.model.vehicle import GRAVITY
from ortilo_drake.onboard.planner.free_cells import free_space
from ortilo_drake.scenario import Scenario
from ortilo_drake.studies.tube.tube import planned_reference

ALL = "all"
WORST = 0.8  # a floor above this share of the greatest belongs to the worst stretch
SIGMAS = 3.0  # so many times the floor must fit into the free room
NEEDED = 1.1  # a sensor decides a stretch if its loss raises the floor by at least this factor


class PlannedFlight(NamedTuple):
    """A path as it is planned, at every tick: times [s] (n), and the distance flown since the start [m] (n).

    truth: states with the path's position and velocity, and roll and pitch for its acceleration (n, 12); free: distance
    from the vehicle's outline to walls, floor and ceiling [m] (n).
    """

    time: np.ndarray
    distance: np.ndarray
    truth: np.ndarray
    free: np.ndarray


def planned_flight(scenario: Scenario) -> PlannedFlight:
    """Return a flight that follows the scenario's path without error; InputError if there is no path."""
    time, truth = planned_truth(scenario)
    ticks = max(len(time) - round(scenario.settle * scenario.control_rate), 2)
    p = truth[:ticks, :3]
    distance = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(p, axis=0), axis=1))])
    return PlannedFlight(time[:ticks], distance, truth[:ticks], free_room(scenario, p))


def planned_truth(scenario: Scenario) -> tuple[np.ndarray, np.ndarray]:
    """Return t_k [s] (n) and states (n, 12) of a flight that follows its plan, then settles; InputError without one."""
    time, reference = planned_reference(scenario)
    p, v, a = (reference[:, 3 * i : 3 * i + 3] for i in range(3))
    yaw = scenario.yaw
    truth = np.zeros((len(time), N_X))
    truth[:, 0:3], truth[:, 6:9] = p, v
    truth[:, 3] = (a[:, 0] * np.sin(yaw) - a[:, 1] * np.cos(yaw)) / GRAVITY
    truth[:, 4] = (a[:, 0] * np.cos(yaw) + a[:, 1] * np.sin(yaw)) / GRAVITY
    truth[:, 5] = yaw
    truth[:, 9:12] = np.gradient(truth[:, 3:6], scenario.h, axis=0)
    return time, truth


def free_room(scenario: Scenario, points: np.ndarray) -> np.ndarray:
    """Return the distance from the outline to walls, floor and ceiling at points p_WB (n, 3) [m] (n), at least 0.

    Only these end a flight (flight/lost.py); paths avoid furniture, but touching it is no loss.
    """
    room, radius = scenario.load_room(), scenario.vehicle.radius
    space = free_space(room, 0.0, radius, 0.0, 0.0)
    ends = np.array(["wall" in name for name in space.names])
    free = np.array([space.room(p[:2])[ends].min() for p in points])
    above = np.minimum(points[:, 2] - room.interior.min[2], room.interior.max[2] - points[:, 2])
    return np.asarray(np.maximum(np.minimum(free, above), 0.0))


def without_sensor(scenario: Scenario, sensor: str) -> Scenario:
    """Return the scenario without one of its sensors."""
    return scenario.model_copy(update={"sensors": tuple(name for name in scenario.sensors if name != sensor)})


def floors(scenario: Scenario, truth: np.ndarray) -> dict[str, np.ndarray]:
    """Return the floor of the position's error at every tick [m] (n) with all sensors, and without each sensor.

    truth: states (n, 12). The floor is the root of the sum of the three axes' bounds, the least sqrt(E |p_hat - p|^2);
    see floor/cramer_rao.py. InputError if the errors of the camera's detector have not been measured.
    """
    cases = {ALL: scenario} | {sensor: without_sensor(scenario, sensor) for sensor in scenario.sensors}
    found = {}
    for name, case in cases.items():
        bound = position_floor(case, truth)
        if bound is None:
            unknown = "detector: is not ours, so its errors have not been measured"
            raise InputError(f"{unknown}; leave it out, or fly with camera.kind projected and camera.errors")
        found[name] = np.sqrt(bound.sum(axis=1))
    return found


class Stretch(NamedTuple):
    """The stretch of the way where the floor is worst, from its first tick to its last, with its greatest floor [m].

    hangs_on: the sensor whose loss raises this floor most, to floor_without [m], None if no loss raises it much;
    silent: the sensors that tell nothing in the stretch.
    """

    first: int
    last: int
    floor: float
    hangs_on: str | None
    floor_without: float
    silent: tuple[str, ...]


def worst_stretch(found: dict[str, np.ndarray], tells: dict[str, np.ndarray]) -> Stretch:
    """Return the stretch around the greatest floor in which the floor is at least WORST times the greatest.

    found: the floors by name (n each); tells: by sensor, the ticks at which it tells something (n each).
    """
    floor = found[ALL]
    peak = int(np.argmax(floor))
    below = np.flatnonzero(floor < WORST * floor[peak])
    first = int(np.max(below[below < peak], initial=-1)) + 1
    last = int(np.min(below[below > peak], initial=len(floor))) - 1
    without = {name: float(rows[first : last + 1].max()) for name, rows in found.items() if name != ALL}
    # The floor holds before a tick's own messages: those of the last tick may end the stretch, so they do not count.
    silent = tuple(sensor for sensor, rows in tells.items() if not rows[first : max(last, first + 1)].any())
    name = max(without, key=lambda sensor: without[sensor], default=None)
    if name is None or without[name] < NEEDED * floor[peak]:
        return Stretch(first, last, float(floor[peak]), None, float(floor[peak]), silent)
    return Stretch(first, last, float(floor[peak]), name, without[name], silent)


def first_lost(floor: np.ndarray, free: np.ndarray) -> int | None:
    """Return the first tick at which SIGMAS times the floor exceed the free distance; None if there is none."""
    lost = np.flatnonzero(SIGMAS * floor > free)
    return int(lost[0]) if len(lost) else None
