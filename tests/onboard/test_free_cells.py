import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.geometry.optimization import HPolyhedron, Hyperellipsoid, Hyperrectangle, MinkowskiSum

from ortilo_drake.model.room import ORTILO_ROOM, load_room
from ortilo_drake.onboard.planner.free_cells import FreeSpace, cells_along, first_false, free_space, grow_cell
from ortilo_drake.onboard.planner.gcs_path import shortest_route

SPACE = free_space(load_room(ORTILO_ROOM), height=1.5, vehicle_radius=0.49, clearance=0.7, vertical_clearance=0.6)


@settings(max_examples=25, deadline=None)
@given(st.floats(-1.0, 29.0), st.floats(-3.8, 4.0))
def test_a_cell_holds_its_seed_and_touches_no_inflated_obstacle_by_drakes_geometry(x: float, y: float) -> None:
    seed = np.array([x, y])
    if SPACE.room(seed).min() < 0.02:
        return
    cell = grow_cell(seed, SPACE)
    assert cell.contains(seed[None, :]).all()
    region = HPolyhedron(cell.A, cell.b)
    assert region.IsBounded()
    for low, high, radius in zip(SPACE.low, SPACE.high, SPACE.radius, strict=True):
        disc = Hyperellipsoid.MakeHypersphere(radius - 1e-6, np.zeros(2))
        assert not region.IntersectsWith(MinkowskiSum(Hyperrectangle(low, high), disc))


def test_a_cell_keeps_the_clearance_where_there_is_room_and_half_the_room_where_there_is_little() -> None:
    roomy = np.array([5.0, 2.2])
    assert SPACE.room(roomy).min() > 0.7 + 0.15
    points = np.random.default_rng(1).uniform([-1.5, -4.3], [29.4, 4.5], (20000, 2))
    inside = points[grow_cell(roomy, SPACE).contains(points)]
    assert len(inside) > 100
    assert min(SPACE.room(p).min() for p in inside) >= 0.7 - 1e-6

    tight = np.array([15.0, 3.98])  # between a wall block and the outer wall
    room = SPACE.room(tight).min()
    assert 0.0 < room < 0.15
    points = tight + np.random.default_rng(1).uniform(-0.2, 0.2, (20000, 2))
    inside = points[grow_cell(tight, SPACE).contains(points)]
    assert len(inside) > 100
    assert min(SPACE.room(p).min() for p in inside) == pytest.approx(room / 2, abs=5e-3)


def boxes_in_the_open(*boxes: tuple[float, float, float, float]) -> FreeSpace:
    """Boxes (x and y of the lower, of the upper corner) in a field of 40 m, inflated by 0.5 m, nothing else."""
    outer = np.array([[-21, -21, -20, 21], [20, -21, 21, 21], [-21, -21, 21, -20], [-21, 20, 21, 21]], dtype=float)
    corners = np.vstack([boxes, outer])
    n = len(corners)
    bounds = np.array([[-20.0, -20.0, 0.0], [20.0, 20.0, 3.0]])
    return FreeSpace(("box",) * n, corners[:, :2], corners[:, 2:], np.full(n, 0.5), np.full(n, 3.0), 0.2, bounds)


def test_a_long_obstacle_that_reaches_past_a_near_one_bounds_the_cell_too() -> None:
    """Its middle lies behind the near one's half-plane, its end does not."""
    space = boxes_in_the_open((3.0, -0.1, 3.2, 0.1), (1.0, 5.0, 15.0, 5.2))
    cell = grow_cell(np.zeros(2), space)
    assert not cell.contains(np.array([[1.5, 4.8]])).any()
    assert len(cell.b) == 4  # both boxes and two sides of the field, the others lie behind the boxes
    hidden = grow_cell(np.zeros(2), boxes_in_the_open((3.0, -0.1, 3.2, 0.1), (5.0, -4.0, 15.0, 4.0)))
    assert len(hidden.b) == 4


def test_in_the_open_one_cell_holds_the_whole_route() -> None:
    route = np.column_stack([np.linspace(-3.0, 3.0, 61), np.zeros(61)])
    assert len(cells_along(route, boxes_in_the_open((0.0, 5.0, 1.0, 6.0)))) == 1


def test_a_step_that_no_cell_holds_is_left_out() -> None:
    """A wall between two points of the route: each side has its cell, and the search goes on."""
    space = boxes_in_the_open((1.9, -10.0, 2.1, 10.0))
    route = np.array([[0.0, 0.0], [1.0, 0.0], [3.0, 0.0], [4.0, 0.0]])
    cells = cells_along(route, space)
    inside = np.array([cell.contains(route) for cell in cells])
    assert (inside[:, :-1] & inside[:, 1:]).any(axis=0).tolist() == [True, False, True]


@pytest.mark.parametrize("steps", range(60, 160, 7))
def test_cells_along_a_route_hold_every_step_of_it(steps: int) -> None:
    x = 0.05 * np.arange(steps + 1)
    route = np.column_stack([x, 0.3 * x])
    assert min(SPACE.room(p).min() for p in route) > 0.1
    cells = cells_along(route, SPACE)
    inside = np.array([cell.contains(route) for cell in cells])
    assert (inside[:, :-1] & inside[:, 1:]).any(axis=0).all()
    assert len(cells) < 10


def test_first_false_counts_leading_trues() -> None:
    rows = np.array([[True, True, False, True], [False, True, True, True], [True, True, True, True]])
    assert first_false(rows).tolist() == [2, 0, 4]


def test_room_on_a_grid_is_the_room_at_its_points() -> None:
    x, y = np.linspace(-1, 29, 13), np.linspace(-4, 4, 7)
    on_grid = SPACE.room_on_grid(x, y)
    one_by_one = [[SPACE.room(np.array([a, b])).min() for b in y] for a in x]
    np.testing.assert_allclose(on_grid, one_by_one, atol=1e-12)


def test_what_is_low_enough_is_flown_over() -> None:
    assert "stand" not in SPACE.names  # 0.86 m
    assert {"wall", "plant", "person", "bicycle"} <= set(SPACE.names)


def test_the_route_goes_through_the_only_gap_and_prefers_the_wider_one() -> None:
    room = np.ones((21, 21))
    room[10, :] = -1.0
    room[10, 4], room[10, 16] = 0.1, 0.9
    route = shortest_route(room, 1.0, start=10, goal=20 * 21 + 10)
    assert route is not None
    assert 10 * 21 + 16 in route
    room[10, 16] = -1.0
    route = shortest_route(room, 1.0, start=10, goal=20 * 21 + 10)
    assert route is not None
    assert 10 * 21 + 4 in route
    room[10, 4] = 0.0
    assert shortest_route(room, 1.0, start=10, goal=20 * 21 + 10) is None


def test_the_route_over_an_open_grid_is_as_long_as_octile_distance() -> None:
    route = shortest_route(np.full((30, 40), 2.0), 1.0, start=0, goal=29 * 40 + 39)
    assert route is not None
    steps = np.diff(np.column_stack(np.unravel_index(route, (30, 40))), axis=0)
    assert np.hypot(*steps.T).sum() == pytest.approx(29 * np.sqrt(2) + 10)
