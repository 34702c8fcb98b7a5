"""The planner: the reference trajectory from a scenario's settings, and the system that plays it."""

import dataclasses
from functools import lru_cache
from pathlib import Path

import numpy as np
from pydrake.systems.primitives import TrajectorySource
from pydrake.trajectories import PiecewisePolynomial, StackedTrajectory, Trajectory

from ortilo_drake.model.room import Room
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.model.vehicle import Vehicle
from ortilo_drake.model.vehicle_units import vehicle_units
from ortilo_drake.onboard.planner.free_cells import FreeSpace, free_space
from ortilo_drake.onboard.planner.gcs_path import SeenOn, find_cells, smooth_path
from ortilo_drake.onboard.planner.retime import retime
from ortilo_drake.onboard.planner.seen import ALL_SOURCES, FixSources, seen_on_grid
from ortilo_drake.scenario import GcsPlanner, HoverPlanner, WaypointPlanner, read_waypoints

SHARES = (1.0, 0.9, 0.8, 0.6, 0.4, 0.2, 0.0)  # shares of the clearance, tried in turn until a smooth path is found
CHECKS = 2000  # number of points of a waypoint path that are checked for contact


@lru_cache(maxsize=16)
def plan(
    settings: GcsPlanner | WaypointPlanner | HoverPlanner,
    room: Room,
    vehicle: Vehicle,
    sources: FixSources = ALL_SOURCES,
) -> PiecewisePolynomial:
    """Return the planned p_WB(t) (3 rows) [m] from t = 0; the same settings give the same bits.

    The path keeps the vehicle's radius from the room's obstacles. `sources` are the sources of fixes, for a path that
    prefers places with a fix. InputError if a point is outside the room or too close to an obstacle, or if no way leads
    to the goal.
    """
    if isinstance(settings, HoverPlanner):
        point = np.array(settings.point)
        refuse_contact("planner.point", point[None, :], free_space(room, 0.0, vehicle.radius, 0.0, 0.0), vehicle)
        return PiecewisePolynomial.ZeroOrderHold([0.0, settings.duration], np.column_stack([point, point]))
    if isinstance(settings, GcsPlanner):
        path = gcs_path(settings, room, vehicle, sources)
    else:
        path = waypoint_path(settings)
        samples = path.vector_values(np.linspace(path.start_time(), path.end_time(), CHECKS)).T
        refuse_contact("planner.points", samples, free_space(room, 0.0, vehicle.radius, 0.0, 0.0), vehicle)
    try:
        return retime(path, settings.speed, settings.acceleration)
    except InputError as error:
        raise InputError(f"planner: {error}") from None


def make_planner(trajectory: Trajectory) -> TrajectorySource:
    """Return the system that plays a planned p_WB(t) (3 rows) [m] and then stays at the end of the path.

    Ports:
        y0 (9, output): r, r_dot and r_ddot in W, see model/signals.py.
    """
    source = TrajectorySource(trajectory, output_derivative_order=2, zero_derivatives_beyond_limits=True)
    source.set_name("planner")
    return source


def gcs_path(settings: GcsPlanner, room: Room, vehicle: Vehicle, sources: FixSources) -> Trajectory:
    """Return a collision-free path r(s) (3 rows) [m] at constant height; InputError as in plan."""
    low, high = room.interior.min[2], room.interior.max[2]
    if not low < settings.height < high:
        raise InputError(f"planner.height: {settings.height:g}: must lie between {low:g} and {high:g} m")
    space = free_space(room, settings.height, vehicle.radius, settings.clearance, settings.vertical_clearance)
    start, goal = np.array(settings.start), np.array(settings.goal)
    refuse_contact("planner.start", np.array([[*start, settings.height]]), space, vehicle)
    refuse_contact("planner.goal", np.array([[*goal, settings.height]]), space, vehicle)
    if np.array_equal(start, goal):
        raise InputError(f"planner.goal: {settings.goal}: is the start; to stay there use kind 'hover'")
    path = None
    if settings.prefer == "seen":
        path = _first_path(space, start, goal, lambda x, y: seen_on_grid(x, y, settings.height, room, sources))
    if path is None:
        path = _first_path(space, start, goal)
    if path is None:
        raise InputError(
            f"planner.goal: {settings.goal}: no free way leads there from {settings.start} at height "
            f"{settings.height:g} m for a vehicle of radius {vehicle.radius:g} m{_doubt(vehicle)}"
        )
    lifted = StackedTrajectory(rowwise=True)
    lifted.Append(path)
    ends = [path.start_time(), path.end_time()]
    lifted.Append(PiecewisePolynomial.ZeroOrderHold(ends, np.full((1, 2), settings.height)))
    return lifted


def _first_path(space: FreeSpace, start: np.ndarray, goal: np.ndarray, seen: SeenOn | None = None) -> Trajectory | None:
    """Return the path with the largest share of the clearance for which a path exists; None if none exists."""
    for share in SHARES:
        cells = find_cells(dataclasses.replace(space, clearance=share * space.clearance), start, goal, seen)
        path = None if cells is None else smooth_path(cells, start, goal)
        if path is not None:
            return path
    return None


def waypoint_path(settings: WaypointPlanner) -> PiecewisePolynomial:
    """Return a smooth curve r(u) (3 rows) [m] through the waypoints; InputError as in plan.

    A C2 cubic spline over u with du = sqrt(chord), the centripetal parameters of Lee (1989), which overshoots little.
    """
    source = f"planner.file: {settings.file}" if settings.file is not None else "planner.points"
    p = read_waypoints(Path(settings.file)) if settings.file is not None else np.array(settings.points)
    if len(p) < 2:
        raise InputError(f"{source}: {len(p)} given, a path needs at least 2")
    chords = np.diff(p, axis=0)
    lengths = np.linalg.norm(chords, axis=1)
    if not lengths.all():
        i = int(np.argmin(lengths))
        raise InputError(f"{source}: points {i + 1} and {i + 2} are the same: {tuple(p[i].tolist())}")
    du = np.sqrt(lengths)
    ends = chords[[0, -1]] / du[[0, -1], None]
    u = np.concatenate([[0.0], np.cumsum(du)])
    return PiecewisePolynomial.CubicWithContinuousSecondDerivatives(u, p.T, ends[0], ends[1])


def refuse_contact(field: str, points: np.ndarray, space: FreeSpace, vehicle: Vehicle) -> None:
    """Raise InputError if the vehicle, centred at one of the points (n, 3) [m], is outside or touches an obstacle."""
    low, high = space.bounds
    for p in points:
        where = f"{field}: ({p[0]:.6g}, {p[1]:.6g}, {p[2]:.6g})"
        if not (np.all(low <= p) and np.all(p <= high)):
            box = ", ".join(f"{axis} in [{a:g}, {b:g}]" for axis, a, b in zip("xyz", low, high, strict=True))
            raise InputError(f"{where}: outside the room, which is {box} m")
        room = np.where(p[2] < space.top, space.room(p[:2]), np.inf)
        i = int(np.argmin(room))
        if room[i] <= 0.0:
            gap = max(0.0, room[i] + vehicle.radius)
            raise InputError(
                f"{where}: {gap:.2f} m from '{space.names[i]}', must be more than the vehicle's radius, "
                f"{vehicle.radius:g} m{_doubt(vehicle)}"
            )


def _doubt(vehicle: Vehicle) -> str:
    """Return a hint for an error message if the vehicle's numbers, and so its radius, may be in a wrong unit."""
    return "".join(f"; {line}" for line in vehicle_units(vehicle)[:1])
