"""Placement of anchors, so that the worst point of the planned path becomes as good as possible.

    minimise over n mounting places   max_k sqrt(tr P_k)

P_k is the Cramer-Rao bound on the position at tick k of the path as it is planned (floor/cramer_rao.py). The search
goes by the same recursion in long steps (path_bound.py): first greedily and then by Fedorov's exchange (exchange.py) on
a mean over the path of the power POWER, which every exchange changes, and then on the maximum itself. Since a
fix takes three ranges, the exchange counts those of fewer anchors as nothing.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import yaml

from ortilo_drake.floor.cramer_rao import dynamics, information_rows, position_floor
from ortilo_drake.floor.information_arrivals import arrived
from ortilo_drake.model.input_error import InputError
from ortilo_drake.model.room import Room
from ortilo_drake.scenario import Scenario
from ortilo_drake.sensors.described import measuring
from ortilo_drake.sensors.information_ranges import range_rows
from ortilo_drake.sensors.information_rows import GRADIENT, TICK, VARIANCE
from ortilo_drake.studies.room_design.exchange import exchange, greedy
from ortilo_drake.studies.room_design.landmarks import (
    angle_information,
    floor_spots,
    landmark_information,
    standing_classes,
)
from ortilo_drake.studies.room_design.mounting import mounting_places
from ortilo_drake.studies.room_design.path_bound import STEPS, PathModel, path_model, position_variance
from ortilo_drake.studies.rooms.planned_floor import planned_truth

POWER = 16.0
FIX = 3  # ranges
FINER = 3  # by which the grid of free spots of the floor is finer than that of mounting places


@dataclass(frozen=True)
class Worst:
    """The worst point of a path: least RMS error of the position there that any estimator can have, its floor [m].

    It is at a time [s] and a place p_WB [m]; no_fix is the longest time without as many ranges as a fix takes [s].
    """

    floor: float
    time: float
    place: tuple[float, float, float]
    no_fix: float


@dataclass(frozen=True)
class Placement:
    """A room before and after its anchors were placed, and its worst points with those it had and with those placed.

    So many candidates were there to choose from; the room is that with the anchors placed.
    """

    candidates: int
    before: Worst
    after: Worst
    room: Room


def with_anchors(room: Room, anchors: np.ndarray) -> Room:
    """Return the room with other anchors, p_W (n, 3) [m]."""
    return room.model_copy(update={"anchors": tuple(tuple(p) for p in np.asarray(anchors, dtype=float).tolist())})


@contextmanager
def flown_in(scenario: Scenario, room: Room) -> Iterator[Scenario]:
    """Lend the scenario with another room, kept in a file for that long."""
    with TemporaryDirectory() as folder:
        file = Path(folder) / "room.yaml"
        file.write_text(room_text(room, room.name), encoding="utf-8")
        yield scenario.model_copy(update={"room": str(file)})


def worst_floor(scenario: Scenario) -> Worst:
    """Return the worst point of a flight as it is planned.

    InputError if there is no path, or no floor, as the errors of the camera's detector have not been measured.
    """
    _, truth = planned_truth(scenario)
    floor = position_floor(scenario, truth)
    if floor is None:
        raise InputError(f"{measuring('landmarks')}.errors: of these no floor is known: must be measured or parametric")
    total = floor.sum(axis=1)
    k = int(np.argmax(total))
    x, y, z = truth[k, :3].tolist()
    return Worst(float(np.sqrt(total[k])), k * scenario.h, (x, y, z), longest_gap(scenario, truth))


def longest_gap(scenario: Scenario, truth: np.ndarray) -> float:
    """Return the longest time along a flight of states (n, 12) between ticks with as many ranges as a fix takes [s]."""
    rows = range_rows(scenario.uwb, scenario.load_room(), truth, arrived(scenario, measuring("anchors"), truth))
    fixes = np.flatnonzero(np.bincount(rows[:, TICK].astype(int), minlength=len(truth)) >= FIX)
    return float(np.diff(np.concatenate([[0], fixes, [len(truth) - 1]])).max() * scenario.h)


def range_information(
    scenario: Scenario, truth: np.ndarray, room: Room, places: np.ndarray, m: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the information on p_WB of an anchor at each place in each step of m ticks, and whether it is heard there.

    They are J [1/m^2] (c, steps, 3, 3) and there (c, steps), for places p_W (c, 3) [m] in a room's walls along states
    x_k (n, 12), with noise, walls and link of the scenario's ranges.
    """
    steps, seen = -(-len(truth) // m), arrived(scenario, measuring("anchors"), truth)
    J, there = np.zeros((len(places), steps, 3, 3)), np.zeros((len(places), steps), dtype=bool)
    for c, place in enumerate(places):
        rows = range_rows(scenario.uwb, with_anchors(room, place[None]), truth, seen)
        step, g = rows[:, TICK].astype(int) // m, rows[:, GRADIENT][:, :3]
        np.add.at(J[c], step, g[:, :, None] * g[:, None, :] / rows[:, VARIANCE, None, None])
        there[c, step] = True
    return J, there


def place_anchors(
    scenario: Scenario,
    n: int,
    spacing: float = 1.5,
    landmarks: int = 0,
    start: Callable[[str], None] = lambda part: None,
    tick: Callable[[], None] = lambda: None,
) -> Placement:
    """Return the room of a scenario with n anchors placed for its path, and maybe landmarks after them.

    The mounting places have a spacing [m]. So many landmarks are placed in place of those that the room has; 0 leaves
    those. `start` is told each part of the search before it, and `tick` called after each step. InputError if there is
    no path or no floor, uwb (or the camera, with landmarks) does not fly or gives differences, or there are fewer
    places than anchors or landmarks.
    """
    placing = {measuring(things): things for things in ("anchors", *(("landmarks",) if landmarks else ()))}
    for sensor, placed in placing.items():
        if sensor not in scenario.sensors:
            raise InputError(f"sensors: {list(scenario.sensors)}: must have {sensor}, whose {placed} are placed")
    if scenario.uwb.kind == "differences":
        raise InputError(f"{measuring('anchors')}.kind: differences: must be ranges: these place anchors")
    room, before = scenario.load_room(), worst_floor(scenario)
    if landmarks:  # those that the room has go, and are in nobody's way
        room = room.model_copy(update={"landmarks": ()})
    with flown_in(scenario, room) as emptied:
        _, truth = planned_truth(emptied)
    places = mounting_places(room, spacing, truth[:, :3], scenario.vehicle.radius)
    if len(places) < n:
        raise InputError(f"N: {n}: must not exceed the {len(places)} mounting places {spacing:g} m apart of the room")
    m = max(1, len(truth) // STEPS)
    kept = tuple(sensor for sensor in scenario.sensors if sensor not in placing)
    found = information_rows(scenario.model_copy(update={"sensors": kept}), truth, room)
    assert found is not None, "there is a floor"
    model = path_model(*dynamics(scenario), found[0], len(truth), m)
    J, there = range_information(scenario, truth, room, places, m)
    start("choosing")
    chosen = greedy(J, there, n, _cost(model, POWER, 1), tick)
    for power, part in ((POWER, "exchanging"), (np.inf, "exchanging by the worst point")):
        start(part)
        chosen = exchange(J, there, chosen, _cost(model, power, FIX), tick)
    better = with_anchors(room, places[sorted(chosen)])
    if landmarks:
        ranges = J[chosen].sum(axis=0) * (there[chosen].sum(axis=0) >= FIX)[:, None, None]
        classes = standing_classes(scenario.load_room())
        spots = floor_spots(room, classes, spacing / FINER, truth[:, :3], scenario.vehicle.radius)
        if len(spots) < landmarks:
            raise InputError(f"--landmarks {landmarks}: must not exceed the {len(spots)} free spots of the floor")
        start("choosing landmarks")
        angles = angle_information(scenario, found[0], len(truth))
        of_spots = landmark_information(scenario, truth, room, spots, angles, m)
        cost, nothing = _cost(model, POWER, 0, ranges), np.zeros((len(spots), len(ranges)), dtype=bool)
        stand = greedy(of_spots, nothing, landmarks, cost, tick)
        start("exchanging landmarks")
        stand = exchange(of_spots, nothing, stand, cost, tick)
        better = better.model_copy(update={"landmarks": tuple(spots[i] for i in sorted(stand))})
    with flown_in(scenario, better) as moved:
        return Placement(len(places), before, worst_floor(moved), better)


def _cost(
    model: PathModel, power: float, least: int, beside: np.ndarray | float = 0.0
) -> Callable[[np.ndarray, np.ndarray], float]:
    """Return the cost of a design: the mean of that power over the path of the position's bound [m].

    Beside it is what is known otherwise of p_WB in each step (steps, 3, 3).
    """

    def cost(J: np.ndarray, there: np.ndarray) -> float:
        sd = np.sqrt(position_variance(model, J + beside, there, least))
        worst = float(sd.max())
        if worst == 0.0 or not np.isfinite(power):
            return worst
        return float(worst * np.mean((sd / worst) ** power) ** (1.0 / power))

    return cost


def room_text(room: Room, about: str) -> str:
    """Return a room as the text of a file, with a line about it at the top."""
    data = room.model_dump(mode="json")
    return f"# {about}\n" + yaml.safe_dump(data, sort_keys=False, default_flow_style=None, width=120)
