"""Placement of anchors, so that the worst point of the planned path becomes as good as possible.

    minimise over n mounting places   max_k sqrt(tr P_k)

P_k is the Cramer-Rao bound on the position at tick k of the path as it is planned (floor/cramer_rao.py). The search
uses the same recursion in long steps (path_bound.py): first greedily and then by Fedorov's exchange (exchange.py) on
the power mean over the path with exponent POWER, which every exchange changes, and then on the maximum itself. Since a
fix takes three ranges, the exchange ignores the ranges of fewer anchors.

Landmarks are placed so that the camera helps where the ranges help least. They stand on the floor on a grid of free
spots, away from the path, of the room's own classes in turn, so that neighbours differ. The search is the same, with
the anchors' ranges as they are. A box's centre depends as much on the attitude as on the position: with the angles
known to a covariance Q from the imu alone, it informs p_WB by

    J = J_pp - J_pt (J_tt + Q^-1)^-1 J_tp,

as if each landmark had new errors of the angles. The reported bound of the room includes all of this.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import yaml

from ortilo_drake.floor.cramer_rao import arrived, dynamics, information_rows, position_floor
from ortilo_drake.floor.information_filter import predicted_bound
from ortilo_drake.model.footprints import footprints
from ortilo_drake.model.input_error import InputError
from ortilo_drake.model.room import Landmark, Room
from ortilo_drake.model.signals import N_X
from ortilo_drake.scenario import Scenario
from ortilo_drake.sensors.described import measuring
from ortilo_drake.sensors.information_camera import camera_rows, camera_tables
from ortilo_drake.sensors.information_rows import GRADIENT, TICK, VARIANCE
from ortilo_drake.sensors.information_uwb import range_rows
from ortilo_drake.studies.room_design.exchange import exchange, greedy
from ortilo_drake.studies.room_design.mounting import mounting_places
from ortilo_drake.studies.room_design.path_bound import (
    STEPS,
    PathModel,
    path_model,
    position_variance,
    step_information,
)
from ortilo_drake.studies.rooms.planned_floor import planned_truth

POWER = 16.0
FIX = 3  # ranges that a fix takes
FINER = 3  # the grid of floor spots is finer than that of mounting places by this factor


AWAY = 0.5  # distance from the vehicle's outline on its path [m]
ON_FLOOR = 0.1  # a landmark whose bottom is lower than this stands on the floor [m]


def standing_classes(room: Room) -> list[str]:
    """Return the landmark classes that stand on the floor of a room; if none does, all that the room has sizes of.

    InputError if there is none.
    """
    found = [
        landmark.label
        for landmark in room.landmarks
        if landmark.position[2] - 0.5 * (landmark.size or room.landmark_size[landmark.label])[2] < ON_FLOOR
    ]
    classes = list(dict.fromkeys(found)) or sorted(room.landmark_size)
    if not classes:
        raise InputError("landmark_size: the room knows no class of landmarks that could be placed")
    return classes


def floor_spots(
    room: Room, classes: Sequence[str], spacing: float, path: np.ndarray, vehicle_radius: float
) -> list[Landmark]:
    """Return landmarks that could stand on the floor, one on each free spot of a grid, with the classes in turn.

    The grid has the spacing [m]. Spots keep away from the room's obstacles and from the vehicle's outline, of
    vehicle_radius [m], on its path p_WB (k, 3).
    """
    things, near = footprints(room), path[:: max(1, len(path) // 400), :2]
    low, high = np.array(room.interior.min), np.array(room.interior.max)
    found: list[Landmark] = []
    for x in np.arange(low[0] + spacing / 2.0, high[0], spacing):
        for y in np.arange(low[1] + spacing / 2.0, high[1], spacing):
            label, p = classes[len(found) % len(classes)], np.array([x, y])
            size = room.landmark_size[label]
            reach = 0.5 * float(np.hypot(size[0], size[1]))
            aside = min([*(item.away(p) for item in things), *(p - low[:2]), *(high[:2] - p)])
            on_path = np.hypot(*(near - p).T).min() - vehicle_radius - AWAY
            if min(aside, on_path) > reach and size[2] < high[2] - low[2]:
                where = (round(float(x), 3), round(float(y), 3), round(float(low[2]) + size[2] / 2.0, 4))
                found.append(Landmark(label=label, position=where))
    return found


def angle_information(scenario: Scenario, imu_rows: np.ndarray, ticks: int) -> np.ndarray:
    """Return Q^-1 (3, 3), Q the covariance of the angles at the end of a flight with the imu's rows alone."""
    Phi, W = dynamics(scenario)
    P = predicted_bound(imu_rows, ticks, Phi, W, np.zeros((N_X, N_X)), 1)
    return np.asarray(np.linalg.inv(P[-1, 3:6, 3:6] + 1e-12 * np.eye(3)))


def landmark_information(
    scenario: Scenario, truth: np.ndarray, room: Room, spots: Sequence[Landmark], Q_inverse: np.ndarray, m: int
) -> np.ndarray:
    """Return each landmark's information on p_WB in each step of m ticks [1/m^2] (c, steps, 3, 3).

    The scenario's camera sees each of the spots (c) alone, along states x_k (n, 12); the room may hide them. Q_inverse
    (3, 3) is the information on the angles.
    """
    steps, seen = -(-len(truth) // m), arrived(scenario, measuring("landmarks"), truth)
    J = np.zeros((len(spots), steps, 3, 3))
    alone = [room.model_copy(update={"landmarks": (spot,)}) for spot in spots]
    tables = {its.landmarks[0].label: its for its in alone}
    known = {label: camera_tables(scenario, its) for label, its in tables.items()}
    for c, its in enumerate(alone):
        of_class = known[its.landmarks[0].label]
        assert of_class is not None, "there is a floor"
        both = step_information(camera_rows(of_class, its, scenario.image_width, truth, seen), steps, m)
        J_pp, J_pt, J_tt = both[:, :3, :3], both[:, :3, 3:6], both[:, 3:6, 3:6]
        J[c] = J_pp - J_pt @ np.linalg.solve(J_tt + Q_inverse, J_pt.transpose(0, 2, 1))
    return J


@dataclass(frozen=True)
class Worst:
    """The worst point of a path: its floor is the least RMS position error that any estimator can have there [m].

    time [s] and place p_WB [m] are those of the point; no_fix is the longest time without enough ranges for a fix [s].
    """

    floor: float
    time: float
    place: tuple[float, float, float]
    no_fix: float


@dataclass(frozen=True)
class Placement:
    """The result of placing anchors: the path's worst points before and after, and the room with the placed anchors.

    candidates is the number of mounting places to choose from.
    """

    candidates: int
    before: Worst
    after: Worst
    room: Room


def with_anchors(room: Room, anchors: np.ndarray) -> Room:
    """Return the room with these anchors, p_W (n, 3) [m], in place of its own."""
    return room.model_copy(update={"anchors": tuple(tuple(p) for p in np.asarray(anchors, dtype=float).tolist())})


@contextmanager
def flown_in(scenario: Scenario, room: Room) -> Iterator[Scenario]:
    """Yield the scenario with another room, whose file exists as long as the context does."""
    with TemporaryDirectory() as folder:
        file = Path(folder) / "room.yaml"
        file.write_text(room_text(room, room.name), encoding="utf-8")
        yield scenario.model_copy(update={"room": str(file)})


def worst_floor(scenario: Scenario) -> Worst:
    """Return the worst point of a scenario's planned flight.

    InputError if there is no path, or no floor because the errors of the camera's detector have not been measured.
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
    """Return the longest time between ticks with as many ranges as a fix takes [s], for a flight of states (n, 12)."""
    rows = range_rows(scenario.uwb, scenario.load_room(), truth, arrived(scenario, measuring("anchors"), truth))
    fixes = np.flatnonzero(np.bincount(rows[:, TICK].astype(int), minlength=len(truth)) >= FIX)
    return float(np.diff(np.concatenate([[0], fixes, [len(truth) - 1]])).max() * scenario.h)


def range_information(
    scenario: Scenario, truth: np.ndarray, room: Room, places: np.ndarray, m: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return an anchor's information on p_WB from each place in each step of m ticks, and whether it is heard then.

    These are J [1/m^2] (c, steps, 3, 3) and there (c, steps), for places p_W (c, 3) [m] in a room along states x_k (n,
    12), with noise, walls and link of the scenario's ranges.
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
    """Return the room of a scenario with n anchors placed for its path, and then landmarks, if any are wanted.

    The mounting places have a spacing [m]. `landmarks` landmarks replace those of the room; 0 keeps those. `start` gets
    the name of each part of the search before it begins, and `tick` is called after each step. InputError if there is
    no path or no floor, if uwb (or the camera, with landmarks) does not fly or gives differences, or if there are fewer
    places than anchors or landmarks.
    """
    placing = {measuring(things): things for things in ("anchors", *(("landmarks",) if landmarks else ()))}
    for sensor, placed in placing.items():
        if sensor not in scenario.sensors:
            raise InputError(f"sensors: {list(scenario.sensors)}: must have {sensor}, whose {placed} are placed")
    if scenario.uwb.kind == "differences":
        raise InputError(f"{measuring('anchors')}.kind: differences: must be ranges: these place anchors")
    room, before = scenario.load_room(), worst_floor(scenario)
    if landmarks:  # the room's own landmarks go, and obstruct nothing
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
    """Return the cost of a design: the power mean over the path of the position's bound [m]; the maximum for inf.

    `beside` is the other information on p_WB in each step (steps, 3, 3).
    """

    def cost(J: np.ndarray, there: np.ndarray) -> float:
        sd = np.sqrt(position_variance(model, J + beside, there, least))
        worst = float(sd.max())
        if worst == 0.0 or not np.isfinite(power):
            return worst
        return float(worst * np.mean((sd / worst) ** power) ** (1.0 / power))

    return cost


def room_text(room: Room, about: str) -> str:
    """Return a room as the text of a file, with the line `about` at the top."""
    data = room.model_dump(mode="json")
    return f"# {about}\n" + yaml.safe_dump(data, sort_keys=False, default_flow_style=None, width=120)
