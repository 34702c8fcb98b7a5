"""A smooth path through free cells: a coarse route decides on which side to pass, convex optimisation gives the shape.

The route is the shortest way over a fine grid, on which steps with little room cost more. Cells are grown along the
route. Drake's GcsTrajectoryOptimization (Marcucci, Petersen, von Wrangel, Tedrake: Motion planning around obstacles
with convex optimization, Science Robotics 2023) chooses among the cells and puts a Bezier curve into each. A curve lies
in the convex hull of its control points, so the whole path stays in the cells, not only its samples.
"""

import logging
from collections.abc import Callable

import numpy as np
from pydrake.geometry.optimization import GraphOfConvexSetsOptions, HPolyhedron, Point
from pydrake.planning import GcsTrajectoryOptimization
from pydrake.solvers import Binding, ClarabelSolver, Cost, QuadraticCost
from pydrake.trajectories import CompositeTrajectory
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.planner.free_cells import (
    ELBOW,
    Cell,
    FreeSpace,
    cells_along,
    grow_cell,
    within,
    without_places,
)

SPACING = 0.05  # spacing of the route's grid: narrower gaps are not found [m]
ORDER = 5  # order of the Bezier curves
MAX_GRID = 4_000_000  # largest number of grid points; each takes about 420 bytes
UNSEEN = 6.0  # factor on the cost of a route step at a point without a fix
UNSEEN_REACH = 0.75  # half side of the square that limits a cell about a point without a fix [m]
BENDING = 10.0  # cost of the squared second differences of the control points, per metre of path length

SeenOn = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


def shortest_route(
    room: np.ndarray, comfort: float, start: int, goal: int, seen: np.ndarray | None = None
) -> np.ndarray | None:
    """Return the cheapest way over an 8-connected grid as flat indices (n), or None if there is no way.

    A step needs positive `room` (n_x, n_y) [m] at both ends. A step with less than `comfort` [m] costs sqrt(comfort /
    room) times as much, a step that is not `seen` (n_x, n_y) UNSEEN times as much. start and goal are flat indices.
    """
    n_x, n_y = room.shape
    index = np.arange(room.size).reshape(room.shape)
    cost = np.sqrt(np.maximum(1.0, comfort / np.maximum(room, 1.0e-3)))
    if seen is not None:
        cost = np.where(seen, cost, UNSEEN * cost)
    starts, ends, costs = [], [], []
    for i, j in ((1, 0), (0, 1), (1, 1), (1, -1)):
        a = (slice(0, n_x - i), slice(max(0, -j), n_y - max(0, j)))
        b = (slice(i, n_x), slice(max(0, j), n_y - max(0, -j)))
        free = (room[a] > 0) & (room[b] > 0)
        starts.append(index[a][free])
        ends.append(index[b][free])
        costs.append((np.hypot(i, j) * (cost[a] + cost[b]))[free])
    edges = (np.concatenate(costs), (np.concatenate(starts), np.concatenate(ends)))
    graph = coo_array(edges, shape=(room.size, room.size)).tocsr()
    _, before = dijkstra(graph, directed=False, indices=start, return_predecessors=True)
    route = [goal]
    while route[-1] != start:
        if before[route[-1]] < 0:
            return None
        route.append(int(before[route[-1]]))
    return np.array(route[::-1])


def find_cells(space: FreeSpace, start: np.ndarray, goal: np.ndarray, seen: SeenOn | None = None) -> list[Cell] | None:
    """Return cells along the way from start to goal (2) [m], both with positive room; None if there is no way.

    With `seen`, the path does not leave the route for a place without a fix: a cell from a point with a fix contains no
    place without one, and a cell from another point is limited to UNSEEN_REACH. `seen` maps a grid's x and y to a mask
    of the points with a fix (n_x, n_y) and the places without one (k, 2). InputError if the room is too large.
    """
    sides = space.bounds[1, :2] - space.bounds[0, :2]
    if np.prod(np.ceil(sides / SPACING)) > MAX_GRID:
        raise InputError(
            f"room: interior: {sides[0]:g} m x {sides[1]:g} m: for a planner of kind 'gcs' must not exceed "
            f"{MAX_GRID * SPACING**2:g} m^2; give waypoints"
        )
    x, y = (np.arange(low, high, SPACING) for low, high in space.bounds.T[:2])
    points = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    room = space.room_on_grid(x, y)
    ends = []
    for p in (start, goal):
        distance = np.linalg.norm(points - p, axis=1)
        distance[~grow_cell(p, space).contains(points)] = np.inf
        ends.append(int(np.argmin(distance)))
    is_seen, hidden = (None, None) if seen is None else seen(x, y)
    route = shortest_route(room, space.clearance + ELBOW, ends[0], ends[1], is_seen)
    if route is None:
        return None
    way = np.vstack([start, points[route], goal])
    if is_seen is None or hidden is None:
        return cells_along(way, space)
    flat = is_seen.ravel()

    def grow(p: np.ndarray, space: FreeSpace) -> Cell:
        cell = grow_cell(p, space)
        nearest = int(np.argmin(np.abs(x - p[0]))) * len(y) + int(np.argmin(np.abs(y - p[1])))
        return without_places(cell, p, hidden) if flat[nearest] else within(cell, p, UNSEEN_REACH)

    return cells_along(way, space, grow)


def smooth_path(cells: list[Cell], start: np.ndarray, goal: np.ndarray) -> CompositeTrajectory | None:
    """Return a path r(s) in the plane with continuous r' and r'', or None if the cells do not connect.

    The path goes from start to goal (2) [m] through the convex cells in their order, and may skip some cells.
    """
    sets = [HPolyhedron(cell.A, cell.b) for cell in cells]
    forward = [(i, j) for i in range(len(sets)) for j in range(i + 1, len(sets)) if sets[i].IntersectsWith(sets[j])]
    gcs = GcsTrajectoryOptimization(2)
    # The parameter s is not time here: each curve covers one unit of s.
    regions = gcs.AddRegions(sets, forward, ORDER, h_min=1.0, h_max=1.0)
    source = gcs.AddRegions([Point(start)], 0, h_min=0.0)
    target = gcs.AddRegions([Point(goal)], 0, h_min=0.0)
    gcs.AddEdges(source, regions)
    gcs.AddEdges(regions, target)
    gcs.AddPathContinuityConstraints(1)
    gcs.AddPathContinuityConstraints(2)
    gcs.AddPathLengthCost(1.0)
    D = np.diff(np.eye(ORDER + 1), n=2, axis=0)
    # Given as a matrix: NumPy's products of symbols would read floating-point flags that Drake's C++ leaves set.
    bending = QuadraticCost(2.0 * BENDING * np.kron(np.eye(2), D.T @ D), np.zeros(2 * (ORDER + 1)), 0.0)
    regions.AddVertexCost(Binding[Cost](bending, regions.vertex_control_points().flatten()))
    options = GraphOfConvexSetsOptions()
    options.convex_relaxation = True
    options.max_rounded_paths = 20
    options.preprocessing = False
    options.solver = ClarabelSolver()
    log = logging.getLogger("drake")
    level = log.level
    log.setLevel(logging.WARNING)  # Drake reports each solved path at INFO
    try:
        path, result = gcs.SolvePath(source, target, options)
    finally:
        log.setLevel(level)
    return GcsTrajectoryOptimization.NormalizeSegmentTimes(path) if result.is_success() else None
