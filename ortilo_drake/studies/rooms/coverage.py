"""Coverage: how well a vehicle can know its position in a room, along the planned path and over the floor."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ortilo_drake.floor.cramer_rao import arrived
from ortilo_drake.onboard.planner.free_cells import free_space
from ortilo_drake.scenario import Scenario
from ortilo_drake.sensors.described import measuring
from ortilo_drake.studies.rooms.in_sight import Eyes, anchors_in_sight, dilution, middles
from ortilo_drake.studies.rooms.planned_floor import (
    PlannedFlight,
    Stretch,
    first_lost,
    floors,
    planned_flight,
    worst_stretch,
)

CELLS = 4000  # cells of the grid, about
FINEST = 0.1  # least side of a cell [m]
SAMPLES = 400  # places along the path, at most
HEADINGS = 8  # headings at which landmarks are looked for, over the floor
HEADINGS_ALONG = 24  # and along the path


@dataclass(frozen=True)
class Along:
    """The coverage at n places along the planned path, with times [s] and distances flown [m] since the start (n).

    position: p_WB [m] (n, 3); free: from the vehicle's outline to walls, floor and ceiling [m] (n); anchors: number in
    sight (n); pdop: position dilution of precision [1] (n), infinite if the ranges give no position; landmarks: number
    in view at the heading flown (n), and at each of the headings [rad] (n, h); floor: the least error of the position
    [m] (n) with 'all' sensors, and by the name of each sensor left out.
    """

    time: np.ndarray
    distance: np.ndarray
    position: np.ndarray
    free: np.ndarray
    anchors: np.ndarray
    pdop: np.ndarray
    landmarks: np.ndarray
    headings: np.ndarray
    landmarks_by_heading: np.ndarray
    floor: dict[str, np.ndarray]


@dataclass(frozen=True)
class OverFloor:
    """The coverage over the floor at one height [m], on a grid of cells with middles x (c) and y (r) [m].

    free: whether nothing stands there at this height (r, c); anchors: number in sight (r, c); pdop: position dilution
    of precision [1] (r, c), infinite if the ranges give no position; headings: [rad], first the one flown (h);
    landmarks: number in view at each heading (h, r, c).
    """

    height: float
    x: np.ndarray
    y: np.ndarray
    free: np.ndarray
    anchors: np.ndarray
    pdop: np.ndarray
    headings: np.ndarray
    landmarks: np.ndarray


@dataclass(frozen=True)
class Case:
    """The greatest floor of the position's error with all sensors, or without one [m], its time [s] and way flown [m].

    lost_at: the time when three sigma of the floor first reach a wall, floor or ceiling [s]; None if they never do.
    """

    floor: float
    time: float
    distance: float
    lost_at: float | None


@dataclass(frozen=True)
class Coverage:
    """The coverage of a room: how well a vehicle can know its position there, along its path and over the floor.

    answer: a sentence or two on where the room loses the vehicle, and which sensor decides this; worst: the worst
    stretch, in ticks of the control clock; worst_times: its first and last time [s]; cases: the greatest floor with
    'all' sensors, and by the name of each sensor left out.
    """

    scenario: str
    room: str
    answer: str
    worst: Stretch
    worst_times: tuple[float, float]
    cases: dict[str, Case]
    along: Along
    over_floor: OverFloor


def coverage(scenario: Scenario, progress: Callable[[float], None] = lambda share: None) -> Coverage:
    """Return the coverage of a scenario's room, along a path that is planned before the flight; tell the share done.

    Walls hide anchors unless the scenario lets radio pass them (uwb.walls none); uwb.max_distance limits the sight.
    InputError if there is no path, or if the errors of the camera's detector have not been measured.
    """
    flight = planned_flight(scenario)
    found = floors(scenario, flight.truth)
    progress(0.3)
    room, eyes, yaw = scenario.load_room(), Eyes(scenario), scenario.yaw
    blocks = scenario.uwb.walls.kind != "none"
    keep = np.unique(np.linspace(0, len(flight.time) - 1, min(SAMPLES, len(flight.time))).round().astype(int))
    p = flight.truth[keep, :3]
    seen = anchors_in_sight(p, room, scenario.uwb.max_distance, blocks)
    headings = np.arange(HEADINGS_ALONG) * 2.0 * np.pi / HEADINGS_ALONG - np.pi
    along = Along(
        time=flight.time[keep],
        distance=flight.distance[keep],
        position=p,
        free=flight.free[keep],
        anchors=seen.sum(axis=1),
        pdop=dilution(p, room.anchor_positions, seen),
        landmarks=np.array([len(eyes.in_view(at, yaw)) for at in p]),
        headings=headings,
        landmarks_by_heading=np.array([[len(eyes.in_view(at, way)) for way in headings] for at in p]),
        floor={name: rows[keep] for name, rows in found.items()},
    )
    progress(0.5)
    worst = worst_stretch(found, _tells(scenario, flight, along))
    cases = {}
    for name, rows in found.items():
        k, lost = int(np.argmax(rows)), first_lost(rows, flight.free)
        lost_at = None if lost is None else float(flight.time[lost])
        cases[name] = Case(float(rows[k]), float(flight.time[k]), float(flight.distance[k]), lost_at)
    height = float(np.median(p[:, 2]))
    over = over_floor(scenario, height, eyes, lambda share: progress(0.5 + 0.5 * share))
    times = float(flight.time[worst.first]), float(flight.time[worst.last])
    answer = _answer(scenario, worst, cases, flight.distance, flight.time)
    return Coverage(scenario.name, room.name, answer, worst, times, cases, along, over)


def over_floor(
    scenario: Scenario, height: float, eyes: Eyes, progress: Callable[[float], None] = lambda share: None
) -> OverFloor:
    """Return the coverage over the floor at a height [m]."""
    room = scenario.load_room()
    low, high = np.array(room.interior.min[:2]), np.array(room.interior.max[:2])
    sides = high - low
    step = max(FINEST, float(np.sqrt(np.prod(sides) / CELLS)))
    x, y = middles(low, high, np.maximum(np.ceil(sides / step - 1e-9), 1).astype(int))
    free = free_space(room, height, 0.0, 0.0, 0.0).room_on_grid(x, y).T > 0.0
    points = np.stack([*np.meshgrid(x, y), np.full(free.shape, height)], axis=-1)
    inside = points[free]
    seen = anchors_in_sight(inside, room, scenario.uwb.max_distance, scenario.uwb.walls.kind != "none")
    anchors, pdop = np.zeros(free.shape, dtype=int), np.full(free.shape, np.inf)
    anchors[free], pdop[free] = seen.sum(axis=1), dilution(inside, room.anchor_positions, seen)
    headings = scenario.yaw + np.arange(HEADINGS) * 2.0 * np.pi / HEADINGS
    landmarks = np.zeros((HEADINGS, *free.shape), dtype=int)
    for i, yaw in enumerate(headings):
        landmarks[i][free] = [len(eyes.in_view(at, float(yaw))) for at in inside]
        progress((i + 1) / HEADINGS)
    return OverFloor(height, x, y, free, anchors, pdop, headings, landmarks)


def _answer(scenario: Scenario, worst: Stretch, cases: dict[str, Case], distance: np.ndarray, time: np.ndarray) -> str:
    """Return a sentence or two: where the room loses the vehicle, and which sensor decides this."""
    metres = f"{distance[worst.first]:.1f} to {distance[worst.last]:.1f} m of the way"
    seconds = f"{time[worst.first]:.1f} to {time[worst.last]:.1f} s"
    measure = "measures" if len(worst.silent) == 1 else "measure"
    silent = f"{' and '.join(worst.silent)} {measure} nothing there; " if worst.silent else ""
    hangs = f"{worst.hangs_on} matters most, without it the error is {worst.floor_without:.2g} m"
    hangs = "no single sensor decides it" if worst.hangs_on is None else hangs
    worst_is = f"{metres} ({seconds}), where even the best estimator errs by {worst.floor:.2g} m; {silent}{hangs}."
    lost = cases["all"].lost_at
    if lost is None:
        nowhere = f"Nowhere with {', '.join(scenario.sensors)}: three sigma of the floor stay off the walls."
        return f"{nowhere} The worst stretch is from {worst_is}"
    return f"From {worst_is} From {lost:.1f} s on three sigma of the floor reach a wall."


def _tells(scenario: Scenario, flight: PlannedFlight, along: Along) -> dict[str, np.ndarray]:
    """Return by sensor the mask of ticks at which an informative message arrives (n)."""
    there = {measuring("anchors"): along.anchors > 0, measuring("landmarks"): along.landmarks > 0}
    nearest = np.abs(flight.time[:, np.newaxis] - along.time).argmin(axis=1)
    return {
        sensor: arrived(scenario, sensor, flight.truth) & (there[sensor][nearest] if sensor in there else True)
        for sensor in scenario.sensors
    }
