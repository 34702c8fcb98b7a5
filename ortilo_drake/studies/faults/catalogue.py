"""The faults that the study flies, one at a time, placed where the flight is at that time."""

from math import radians
from typing import Any, Final, NamedTuple

import numpy as np

from ortilo_drake.model.signals import SENSORS
from ortilo_drake.model.typed_yaml import InputError, nearest
from ortilo_drake.onboard.planner.planned import path_of
from ortilo_drake.scenario import Scenario
from ortilo_drake.scenario.faults import sensors_of_kind

START: Final = 22.0  # in the stretch of the ready-made flights where UWB comes without a gap, 19 s to 43 s [s]
LENGTH: Final = 5.0  # duration of the faults that end [s]
AHEAD: Final = (2.0, 8.0)  # distances ahead at which the landmark to move or remove is chosen [m]
_NEAR, _ASIDE = 0.8, 2.0  # how far away people cross a line of sight, and how far aside they start [m]


class Case(NamedTuple):
    """One fault of the catalogue: its name in tables and --faults, and its entry in a scenario's list `faults`.

    It begins at `start` [s] and ends at `end` [s], None if it does not end.
    """

    name: str
    fault: dict[str, Any]
    start: float
    end: float | None


def around(scenario: Scenario, t: float) -> tuple[list[int], int, list[list[float]]]:
    """Return what is around the planned path's place at t [s]: anchors, a landmark, and walks of people.

    They are the indices of the anchors, the nearest first; the index of the nearest landmark ahead, or else of the
    nearest; and walks (x, y, x, y) [m] that cross the lines to the three nearest anchors and the line ahead. InputError
    if the planner is a System.
    """
    path, room = path_of(scenario), scenario.load_room()
    p_WB = np.array(path.value(min(t, path.end_time()))[:, 0])
    anchors = [int(i) for i in np.argsort(np.linalg.norm(room.anchor_positions - p_WB, axis=1))]
    c, s = np.cos(scenario.yaw), np.sin(scenario.yaw)
    r = room.landmark_positions - p_WB
    ahead, distance = c * r[:, 0] + s * r[:, 1], np.linalg.norm(r, axis=1)
    seen = (ahead > AHEAD[0]) & (ahead < AHEAD[1]) & (np.abs(c * r[:, 1] - s * r[:, 0]) < ahead)
    landmark = int(np.argmin(np.where(seen, distance, 1e3 + distance))) if len(r) else 0
    directions = [room.anchor_positions[i, :2] - p_WB[:2] for i in anchors[:3]] + [np.array([c, s])]
    walks = []
    for direction in directions:
        e = direction / max(float(np.linalg.norm(direction)), 1e-9)
        middle, aside = p_WB[:2] + _NEAR * e, _ASIDE * np.array([-e[1], e[0]])
        walks.append([float(round(v, 3)) for v in (*(middle - aside), *(middle + aside))])
    return anchors, landmark, walks


def catalogue(scenario: Scenario, start: float = START, length: float = LENGTH) -> tuple[Case, ...]:
    """Return the faults that apply to a scenario's sensors and parts, from start [s] on, for length [s] if they end."""
    anchors, landmark, walks = around(scenario, start + 0.5 * length)
    passing: dict[str, dict[str, Any]] = {
        "nlos_storm": {"kind": "nlos_storm", "share": 0.5, "mean": 1.0},
        "outlier_bursts": {"kind": "outlier_bursts", "every": 0.5, "length": 0.2, "sd": 2.0},
        **{f"{sensor}_stuck": {"kind": "stuck", "sensor": sensor} for sensor in SENSORS},
        "yaw_jump": {"kind": "yaw_jump", "by": radians(15.0)},
        "camera_blinded": {"kind": "camera_blinded"},
        "people": {"kind": "people", "walks": walks},
        "gust": {"kind": "gust", "force": [0.0, 2.0, 0.0]},
    }
    lasting: dict[str, dict[str, Any]] = {
        "anchor_moved": {"kind": "anchor_moved", "anchor": anchors[0], "by": [0.3, 0.0, 0.0]},
        "anchors_dying": {"kind": "anchors_dying", "anchors": anchors[:6], "every": 1.0},
        "clock_jump": {"kind": "clock_jump", "by": 0.5},
        "landmark_moved": {"kind": "landmark_moved", "landmark": landmark, "by": [0.0, 0.5, 0.0]},
        "landmark_gone": {"kind": "landmark_gone", "landmark": landmark},
        "gyro_bias": {"kind": "gyro_bias", "by": [0.01, 0.01, 0.01]},
        "load_dropped": {"kind": "load_dropped", "mass_factor": 0.9},
        "rotor_weak": {"kind": "rotor_weak", "rotor": 0, "factor": 0.8},
    }
    end = start + length
    cases = [Case(name, fault | {"start": start, "end": end}, start, end) for name, fault in passing.items()]
    cases += [Case(name, fault | {"start": start}, start, None) for name, fault in lasting.items()]
    flown = {None, *scenario.sensors}  # a fault of the vehicle needs none
    kinds = {case.name: next(iter(sensors_of_kind(case.fault["kind"])), None) for case in cases}
    return tuple(case for case in cases if (case.fault.get("sensor") or kinds[case.name]) in flown)


NAMES: Final = (
    *("nlos_storm", "outlier_bursts", "uwb_stuck", "camera_stuck", "imu_stuck", "yaw_jump", "camera_blinded"),
    *("people", "gust", "anchor_moved", "anchors_dying", "clock_jump", "landmark_moved", "landmark_gone"),
    *("gyro_bias", "load_dropped", "rotor_weak"),
)


def chosen_names(text: str | None) -> tuple[str, ...]:
    """Return the fault names in a comma-separated list, all names for None; InputError if a name is unknown."""
    if text is None:
        return NAMES
    names = tuple(name.strip() for name in text.split(","))
    for name in names:
        if name not in NAMES:
            raise InputError(f"--faults {name!r}: is unknown{nearest(name, NAMES)}: give some of {', '.join(NAMES)}")
    return tuple(dict.fromkeys(names))
