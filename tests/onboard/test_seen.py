"""Paths that keep fixes coming: what is seen, against sampled lines and closed forms, and where such a path goes."""

import numpy as np
import pytest
from example_rooms import two_ways

from ortilo_drake.flight.flight import fly
from ortilo_drake.model.room import Landmark, Room
from ortilo_drake.model.vehicle import M100
from ortilo_drake.onboard.planner.free_cells import Cell, within, without_places
from ortilo_drake.onboard.planner.planner import plan
from ortilo_drake.onboard.planner.seen import FixSources, fix_sources, seen_at, seen_on_grid
from ortilo_drake.scenario import GcsPlanner, load_scenario
from ortilo_drake.studies.room_design.place import room_text

UWB = FixSources(boxes=False)
CAMERA = FixSources(ranges=False)
TWO_WAYS = two_ways()
ENDS = {"start": (1.5, -2.2), "goal": (18.5, -2.2), "clearance": 0.8}


def hall(**changes: object) -> Room:
    """Return the hall with two ways without its walls, and with what changes."""
    return TWO_WAYS.model_copy(update={"walls": ()} | changes)


def heard(p: np.ndarray, room: Room) -> int:
    """Return how many anchors a point (3) hears, by points on the lines to them."""
    count = 0
    for anchor in room.anchor_positions:
        points = p + np.linspace(0.0, 1.0, 1500)[:, None] * (anchor - p)
        blocked = False
        for x, y, z, yaw, a, b, c in room.wall_boxes:
            dx, dy = points[:, 0] - x, points[:, 1] - y
            u, v = np.cos(yaw) * dx + np.sin(yaw) * dy, np.cos(yaw) * dy - np.sin(yaw) * dx
            blocked |= bool(np.any((np.abs(u) < a) & (np.abs(v) < b) & (np.abs(points[:, 2] - z) < c)))
        count += not blocked
    return count


def path_of(room: Room, prefer: str, **changes: object) -> np.ndarray:
    """Return 200 points of the planned path (200, 3)."""
    settings = GcsPlanner.model_validate({**ENDS, "prefer": prefer, **changes})
    path = plan(settings, room, M100, UWB)
    return np.asarray(path.vector_values(np.linspace(0.0, path.end_time(), 200)).T)


@pytest.mark.long
def test_the_way_that_is_seen_is_taken_from_end_to_end() -> None:
    short, seen = path_of(TWO_WAYS, "none"), path_of(TWO_WAYS, "seen")
    assert short[:, 1].max() < -1.0
    assert min(heard(p, TWO_WAYS) for p in short) < 3
    assert seen[:, 1].max() > 0.0
    assert min(heard(p, TWO_WAYS) for p in seen) >= 3
    np.testing.assert_allclose(seen[[0, -1], :2], [ENDS["start"], ENDS["goal"]], atol=1e-6)


@pytest.mark.long
def test_in_the_open_the_path_goes_around_a_shadow() -> None:
    # A wall that hides the north from the path's middle: no obstacle stands in the way itself.
    room = hall(walls=((10.0, 1.5, 0.0),), wall_size=(8.0, 0.4, 3.0))
    ends = {"start": (1.5, -0.5), "goal": (18.5, -0.5), "clearance": 0.3}
    short, seen = path_of(room, "none", **ends), path_of(room, "seen", **ends)
    assert min(heard(p, room) for p in short) < 3
    assert min(heard(p, room) for p in seen) >= 3
    assert np.abs(short[:, 1] + 0.5).max() < 0.3
    assert seen[:, 1].min() < -1.5 or seen[:, 1].max() > 2.0


def test_where_nothing_is_seen_the_goal_is_reached_all_the_same() -> None:
    dark = hall(anchors=((1.0, 4.9, 1.0), (1.1, 4.9, 1.0), (1.2, 4.9, 1.0)))
    assert not seen_at(path_of(dark, "none"), dark, UWB).any()
    np.testing.assert_allclose(path_of(dark, "seen")[-1, :2], ENDS["goal"], atol=1e-6)


@pytest.mark.long
def test_a_fix_is_one_that_the_ranges_make_certain_enough() -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform([0.3, -4.7, 0.3], [19.7, 4.7, 2.7], (300, 3))
    points = points[np.abs(points[:, 1] + 0.5) > 0.2]  # not inside a wall
    sources = FixSources(boxes=False, noise=(0.05, 0.01))
    found = seen_at(points, TWO_WAYS, sources)
    for p, seen in zip(points, found, strict=True):
        to = p - TWO_WAYS.anchor_positions
        there = np.array(
            [heard(p, TWO_WAYS.model_copy(update={"anchors": (tuple(a),) * 3})) == 3 for a in TWO_WAYS.anchor_positions]
        )
        d = np.linalg.norm(to, axis=1)
        J = (to / d[:, None] / (0.05 + 0.01 * d)[:, None])[there]
        N = J.T @ J
        certain = there.sum() >= 3 and np.linalg.cond(N) < 1e12 and np.trace(np.linalg.inv(N)) <= 0.5**2
        assert seen == certain
    assert 0.2 < found.mean() < 0.9


@pytest.mark.long
def test_two_landmarks_in_view_make_a_fix() -> None:
    ahead = (
        Landmark(label="person", position=(8.0, 1.0, 1.0)),
        Landmark(label="person", position=(8.0, -1.0, 1.0)),
    )
    p = np.array([[3.0, 0.0, 1.5]])
    assert seen_at(p, hall(landmarks=ahead), CAMERA).all()
    assert not seen_at(p, hall(landmarks=ahead[:1]), CAMERA).any()
    assert not seen_at(p, hall(landmarks=ahead), FixSources(ranges=False, yaw=np.pi)).any()
    hidden = hall(landmarks=ahead, walls=((6.0, 1.0, np.pi / 2),), wall_size=(1.0, 0.4, 3.0))
    assert not seen_at(p, hidden, CAMERA).any()
    far = np.array([[-60.0, 0.0, 1.5]])
    assert not seen_at(far, hall(landmarks=ahead), CAMERA).any()


@pytest.mark.long
def test_a_grid_is_seen_where_its_places_and_their_neighbours_are() -> None:
    x, y = np.arange(0.0, 20.0, 0.05), np.arange(-5.0, 5.0, 0.05)
    seen, hidden = seen_on_grid(x, y, 1.5, TWO_WAYS, UWB)
    assert seen.shape == (400, 200)
    points = np.array([[x[i], y[j], 1.5] for i, j in np.argwhere(seen)[::150]])
    points = points[np.abs(points[:, 1] + 0.5) > 0.2]  # not inside a wall
    assert len(points) > 100
    assert min(heard(p, TWO_WAYS) for p in points) >= 3
    assert len(hidden) * 16 == (~seen).sum()


def test_a_cell_without_places_holds_its_seed_and_none_of_them() -> None:
    rng = np.random.default_rng(1)
    square = Cell(np.vstack([np.eye(2), -np.eye(2)]), np.full(4, 2.0))
    for _ in range(50):
        seed, places = rng.uniform(-1.5, 1.5, 2), rng.uniform(-3.0, 3.0, (40, 2))
        cut = without_places(square, seed, places)
        assert cut.contains(seed[None])[0]
        assert not cut.contains(places).any()
        inside = rng.uniform(-2.0, 2.0, (500, 2))
        inside = inside[cut.contains(inside)]
        assert square.contains(inside).all()


def test_within_is_the_meeting_of_cell_and_square() -> None:
    square = Cell(np.vstack([np.eye(2), -np.eye(2)]), np.full(4, 2.0))
    points = np.random.default_rng(2).uniform(-3.0, 3.0, (500, 2))
    expected = (np.abs(points) <= 2.0).all(axis=1) & (np.abs(points - [1.5, 0.0]) <= 1.0).all(axis=1)
    np.testing.assert_array_equal(within(square, np.array([1.5, 0.0]), 1.0).contains(points), expected)


@pytest.mark.long
@pytest.mark.parametrize("seed", [0, 1])
def test_flown_the_longest_stretch_without_a_fix_is_less_than_half(
    tmp_path_factory: pytest.TempPathFactory, seed: int
) -> None:
    file = tmp_path_factory.mktemp("room") / "room.yaml"
    file.write_text(room_text(TWO_WAYS, "two ways"))
    longest = {}
    for prefer in ("none", "seen"):
        planner = f"planner={{kind: gcs, start: [1.5, -2.2], goal: [18.5, -2.2], clearance: 0.8, prefer: {prefer}}}"
        settings = ("uwb.walls.kind=block", "uwb.link.blackouts=[]", f"room={file}", planner)
        scenario = load_scenario("nominal_imu_uwb", settings, seed)
        flight = fly(scenario)
        fixes = np.flatnonzero(flight["arrival"].sel(sensor="uwb").values)
        longest[prefer] = np.diff(np.concatenate([[0], fixes, [flight.sizes["tick"] - 1]])).max() * scenario.h
    assert longest["none"] > 5.0
    assert longest["seen"] < 0.5 * longest["none"]
    assert fix_sources(scenario) == FixSources(True, False, (0.0, 0.0075), 0.0, 320)
