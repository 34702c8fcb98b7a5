import hashlib
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from pydrake.trajectories import PiecewisePolynomial
from scipy.interpolate import CubicSpline

from ortilo_drake.model.room import ORTILO_ROOM, Room, load_room
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.model.vehicle import M100
from ortilo_drake.onboard.planner.planner import make_planner, plan, waypoint_path
from ortilo_drake.onboard.planner.players import PathPlayer, path_value
from ortilo_drake.scenario import GcsPlanner, HoverPlanner, WaypointPlanner

ROOM = load_room(ORTILO_ROOM)
SETTINGS = GcsPlanner()
FLIGHT = plan(SETTINGS, ROOM, M100)
TIMES = np.linspace(0.0, FLIGHT.end_time(), 20001)
P = FLIGHT.vector_values(TIMES)


def wall_distance(points: np.ndarray) -> float:
    """Least distance of points (n, 2) from the walls, in each wall's own turned frame."""
    least = np.inf
    for x, y, _, yaw, half_x, half_y, _ in ROOM.wall_boxes:
        c, s = np.cos(yaw), np.sin(yaw)
        local = (points - [x, y]) @ np.array([[c, -s], [s, c]])
        outside = np.maximum(np.abs(local) - [half_x, half_y], 0.0)
        least = min(least, np.hypot(*outside.T).min())
    return least


def test_the_default_flight_passes_the_wall_blocks_on_the_right_sides() -> None:
    def y_between(a: float, b: float) -> np.ndarray:
        return P[1, np.logical_and(P[0] >= a, P[0] <= b)]

    assert y_between(4.2, 7.2).min() > 0.0
    assert y_between(12.5, 15.5).max() < -0.97
    assert y_between(20.75, 21.0).max() < -2.5
    np.testing.assert_allclose(P[:, 0], [0.0, 0.0, 1.5], atol=1e-6)
    np.testing.assert_allclose(P[:, -1], [21.0, -3.2, 1.5], atol=1e-6)
    assert np.diff(P[0]).min() >= -1e-9  # x never goes back


def test_the_default_flight_keeps_its_outline_off_everything_by_each_things_own_shape() -> None:
    assert wall_distance(P[:2].T) > M100.radius + 0.3
    low, high = np.array(ROOM.interior.min[:2]), np.array(ROOM.interior.max[:2])
    assert np.all((low + M100.radius < P[:2].T) & (high - M100.radius > P[:2].T))
    for kind, x, y, z, *_ in ROOM.furniture:
        size_x, size_y, height = ROOM.furniture_size[kind]
        if z + height > 0.9:
            dx = np.maximum(np.abs(P[0] - x) - (size_x - min(size_x, size_y)) / 2, 0.0)
            dy = np.maximum(np.abs(P[1] - y) - (size_y - min(size_x, size_y)) / 2, 0.0)
            assert np.hypot(dx, dy).min() > M100.radius + min(size_x, size_y) / 2 + 0.01, kind
    blackout = P[:2, (P[0] >= 1.5) & (P[0] <= 5.5)].T
    assert wall_distance(blackout) > M100.radius + 0.7


def test_the_default_flight_keeps_its_limits_and_flies_at_its_speed() -> None:
    speed = np.linalg.norm(FLIGHT.MakeDerivative(1).vector_values(TIMES), axis=0)
    acceleration = np.linalg.norm(FLIGHT.MakeDerivative(2).vector_values(TIMES), axis=0)
    assert speed.max() <= 1.01 * SETTINGS.speed
    assert acceleration.max() <= 1.01 * SETTINGS.acceleration
    assert np.mean(speed > 0.99 * SETTINGS.speed) > 0.8
    assert FLIGHT.start_time() == 0.0


@pytest.mark.processes
def test_the_plan_is_the_same_bit_for_bit_in_another_process() -> None:
    program = (
        "import hashlib, test_planner as t; v = t.plan(t.SETTINGS, t.ROOM, t.M100).vector_values(t.TIMES);"
        "print(hashlib.sha256(v.tobytes()).hexdigest())"
    )
    here = Path(__file__).parent
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, cwd=here)
    again = plan(SETTINGS, ROOM, M100).vector_values(TIMES)
    assert np.array_equal(again, P)
    assert done.stdout.strip() == hashlib.sha256(P.tobytes()).hexdigest()


@pytest.mark.long
def test_the_way_round_changes_with_the_clearance_but_never_fails_where_the_vehicle_fits() -> None:
    for clearance in (0.0, 0.3, 1.5):
        flight = plan(SETTINGS.model_copy(update={"clearance": clearance}), ROOM, M100)
        points = flight.vector_values(np.linspace(0.0, flight.end_time(), 2000))
        assert wall_distance(points[:2].T) > M100.radius


def test_the_planner_plays_the_plan_and_then_rests_at_the_goal() -> None:
    source = make_planner(FLIGHT)
    context = source.CreateDefaultContext()
    assert source.get_name() == "planner"
    for t in (0.0, 10.0, 33.3):
        context.SetTime(t)
        output = source.get_output_port().Eval(context)
        expected = [FLIGHT.EvalDerivative(t, order)[:, 0] for order in range(3)]
        np.testing.assert_allclose(output, np.concatenate(expected), atol=1e-12)
    context.SetTime(FLIGHT.end_time() + 5.0)
    output = source.get_output_port().Eval(context)
    np.testing.assert_allclose(output, [21.0, -3.2, 1.5] + [0.0] * 6, atol=1e-6)


def test_hover_stays_at_its_point() -> None:
    flight = plan(HoverPlanner(kind="hover", point=(1.0, 2.0, 1.5), duration=4.0), ROOM, M100)
    assert (flight.start_time(), flight.end_time()) == (0.0, 4.0)
    context = (source := make_planner(flight)).CreateDefaultContext()
    for t in (0.0, 2.0, 4.0, 9.0):
        context.SetTime(t)
        assert source.get_output_port().Eval(context).tolist() == [1.0, 2.0, 1.5] + [0.0] * 6


def test_waypoints_are_passed_from_the_scenario_and_from_a_file(tmp_path: Path) -> None:
    points = ((0.0, 0.0, 1.5), (2.0, 1.5, 1.2), (4.0, 2.0, 1.8), (7.0, 2.0, 1.5))
    flight = plan(WaypointPlanner(kind="waypoints", points=points), ROOM, M100)
    flown = flight.vector_values(np.linspace(0.0, flight.end_time(), 20001)).T
    for point in points:
        assert np.linalg.norm(flown - point, axis=1).min() < 2e-3
    file = tmp_path / "path.txt"
    file.write_text("# x y z\n" + "\n".join(f"{x}, {y} {z}" for x, y, z in points))
    again = plan(WaypointPlanner(kind="waypoints", file=str(file)), ROOM, M100)
    assert np.array_equal(again.vector_values([3.0, 9.0]), flight.vector_values([3.0, 9.0]))


def test_the_curve_through_waypoints_is_the_centripetal_spline_that_begins_and_ends_along_its_chords() -> None:
    points = np.array([[0.0, 0.0, 1.5], [2.0, 1.5, 1.2], [4.0, 2.0, 1.8], [7.0, 2.5, 1.5]])
    curve = waypoint_path(WaypointPlanner(kind="waypoints", points=tuple(map(tuple, points.tolist()))))
    du = np.linalg.norm(np.diff(points, axis=0), axis=1) ** 0.5
    u = np.array([0.0, du[0], du[0] + du[1], du.sum()])
    ends = (points[1] - points[0]) / du[0], (points[3] - points[2]) / du[2]
    expected = CubicSpline(u, points, bc_type=((1, ends[0]), (1, ends[1])))
    at = np.linspace(0.0, u[-1], 101)
    assert curve.start_time() == 0.0
    assert curve.end_time() == pytest.approx(u[-1])
    np.testing.assert_allclose(curve.vector_values(at).T, expected(at), atol=1e-12)


def gcs(**changes: object) -> GcsPlanner:
    return SETTINGS.model_copy(update=changes)


def waypoints(*points: tuple[float, float, float], file: str | None = None) -> WaypointPlanner:
    return WaypointPlanner(kind="waypoints", points=points, file=file)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (
            gcs(start=(-5.0, 0.0)),
            r"planner\.start: \(-5, 0, 1\.5\): outside the room, which is x in \[-1\.53",
        ),
        (gcs(goal=(21.0, 9.0)), r"planner\.goal: .* outside the room"),
        (gcs(goal=(5.7, -1.0)), r"planner\.goal: .* 0\.00 m from 'wall', must be more than .* 0\.49 m"),
        (gcs(start=(26.8, 1.2)), r"planner\.start: .* m from 'person"),
        (gcs(goal=(29.2, 0.0)), r"planner\.goal: .* from '(outer )?wall'"),
        (gcs(height=3.2), r"planner\.height: 3\.2: must lie between 0 and 3 m"),
        (gcs(goal=(0.0, 0.0)), r"planner\.goal: .* is the start"),
        (waypoints((0.0, 0.0, 1.5)), r"planner\.points: 1 given, a path needs at least 2"),
        (waypoints((0.0, 0.0, 1.5), (0.0, 0.0, 1.5)), r"points 1 and 2 are the same: \(0\.0, 0\.0, 1\.5\)"),
        (
            waypoints((2.0, -1.3, 1.5), (9.0, -1.3, 1.5)),
            r"planner\.points: .* from '(stand|plant|wall|potted plant)'",
        ),
        (waypoints((0.0, 0.0, 1.5), (2.0, 1.0, 3.5)), r"planner\.points: .* outside the room"),
        (waypoints((0.0, 0.0, 1.5), (2.0, 1.0, 1.5), (0.0, 0.0, 1.5)), r"planner: path: turns too sharply"),
        (waypoints(file="/nowhere/path.txt"), r"/nowhere/path\.txt: cannot be read"),
        (HoverPlanner(kind="hover", point=(5.7, -1.0, 1.5)), r"planner\.point: .* from 'wall'"),
    ],
)
def test_bad_settings_are_refused_with_one_line(settings: GcsPlanner, message: str) -> None:
    with pytest.raises(InputError, match=message) as refused:
        plan(settings, ROOM, M100)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(("radius", "unit"), [(35.5, "cm"), (355.0, "mm")])
@pytest.mark.parametrize("settings", [gcs(), HoverPlanner(kind="hover", point=(0.0, 0.0, 1.5))], ids=["way", "hover"])
def test_a_radius_in_a_wrong_unit_is_asked_for_it(
    settings: GcsPlanner | HoverPlanner, radius: float, unit: str
) -> None:
    message = rf"more than the vehicle's radius, {radius:g} m; vehicle\.radius: {radius:g} m: .* is it in {unit}\?$"
    with pytest.raises(InputError, match=message):
        plan(settings, ROOM, M100.model_copy(update={"radius": radius}))


@pytest.mark.long
def test_a_goal_walled_in_is_refused() -> None:
    around = tuple((10.0 + dx, -1.0 + dy, yaw) for dx, dy, yaw in ((2, 0, 1.57), (-2, 0, 1.57), (0, 2, 0), (0, -2, 0)))
    room = Room.model_validate(ROOM.model_dump() | {"walls": ROOM.walls + around})
    with pytest.raises(InputError, match=r"planner\.goal: .* no free way leads there from \(0\.0, 0\.0\)"):
        plan(gcs(goal=(10.0, -1.0)), room, M100)


@pytest.mark.parametrize("t", [-1.0, 0.0, 0.37, 1.0, 2.5, 7.0])
def test_a_path_at_an_input_is_played_as_drakes_own_source_plays_it(t: float) -> None:
    points = np.array([[0.0, 1.0, 4.0], [0.0, 2.0, 1.0], [1.0, 1.5, 2.0]])
    path = PiecewisePolynomial.CubicShapePreserving([0.0, 1.0, 2.5], points, True)
    player, source = PathPlayer(), make_planner(path)
    context, its_context = player.CreateDefaultContext(), source.CreateDefaultContext()
    player.GetInputPort("path").FixValue(context, path_value(path))
    for each in (context, its_context):
        each.SetTime(t)
    played = player.get_output_port().Eval(context)
    np.testing.assert_array_equal(played, source.get_output_port().Eval(its_context))
    other = PiecewisePolynomial.ZeroOrderHold([0.0, 1.0], np.full((3, 2), 0.5))
    player.GetInputPort("path").FixValue(context, path_value(other))
    np.testing.assert_array_equal(player.get_output_port().Eval(context), [0.5] * 3 + [0.0] * 6)
