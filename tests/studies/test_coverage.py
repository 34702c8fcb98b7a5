"""Coverage of a room: floors with a sensor lost, where the way is worst, and maps, against other ways to the same."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from command_line import run
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation

from ortilo_drake.floor.cramer_rao import position_floor
from ortilo_drake.model.room import Room, load_room
from ortilo_drake.model.typed_yaml import validate
from ortilo_drake.model.vehicle import GRAVITY
from ortilo_drake.scenario import Scenario, load_scenario
from ortilo_drake.studies.rooms.coverage import coverage
from ortilo_drake.studies.rooms.coverage_figure import draw_coverage
from ortilo_drake.studies.rooms.in_sight import Eyes, anchors_in_sight, dilution
from ortilo_drake.studies.rooms.new_room import new_room
from ortilo_drake.studies.rooms.planned_floor import first_lost, floors, planned_flight, worst_stretch
from ortilo_drake.studies.rooms.room_scenario import room_scenario, scenario_of

BLOCK = "uwb.walls={kind: block}"
HALVED: dict[str, Any] = {  # a wall from floor to ceiling at x = 5 with a door of 1.6 m at its north end
    "interior": {"min": [0, 0, 0], "max": [10, 6, 3]},
    "anchors": [[0.2, 0.2, 2.8], [0.2, 5.8, 0.2], [4.5, 0.2, 0.2], [4.5, 3.0, 2.8]],
    "landmarks": [{"label": "person", "position": [9.6, 5.2, 0.95]}, {"label": "chair", "position": [9.6, 4.4, 0.34]}],
    "walls": [[5.0, 2.2, 1.5708, 4.4, 0.2, 3.0]],
    "start": [1.0, 4.0],
    "goal": [8.5, 2.0],
}


@pytest.fixture(scope="module")
def halved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("room") / "halved.yaml"
    file.write_text(yaml.safe_dump(HALVED))
    return file


@pytest.fixture(scope="module")
def of_halved(halved: Path) -> Scenario:
    return room_scenario(halved, ("planner.clearance=0.3",))


def test_the_planned_flight_follows_the_path_as_its_acceleration_needs(of_halved: Scenario) -> None:
    flight = planned_flight(of_halved)
    x, h = flight.truth, of_halved.h
    np.testing.assert_allclose(x[0, :2], HALVED["start"], atol=1e-9)
    np.testing.assert_allclose(x[-1, :2], HALVED["goal"], atol=0.02)
    np.testing.assert_allclose(np.gradient(x[:, :3], h, axis=0)[2:-2], x[2:-2, 6:9], atol=2e-3)
    a = np.gradient(x[:, 6:9], h, axis=0)
    thrust = Rotation.from_euler("ZYX", x[:, [5, 4, 3]]).apply([0.0, 0.0, 1.0])  # yaw, then pitch, then roll
    needed = a + [0.0, 0.0, GRAVITY]
    needed /= np.linalg.norm(needed, axis=1, keepdims=True)
    np.testing.assert_allclose(thrust[3:-3], needed[3:-3], atol=2e-3)
    assert flight.distance[-1] > np.linalg.norm(np.subtract(HALVED["goal"], HALVED["start"]))


def test_a_lost_sensor_is_one_that_the_scenario_never_had(of_halved: Scenario) -> None:
    truth = planned_flight(of_halved).truth
    found = floors(of_halved, truth)
    assert set(found) == {"all", "uwb", "camera", "imu"}
    for lost, rows in found.items():
        left = [sensor for sensor in of_halved.sensors if sensor != lost]
        settings: tuple[Any, ...] = (("sensors", left), "camera.kind=projected", "uwb.link.blackouts=[]", BLOCK)
        base = "nominal_imu_uwb_yolo" if lost == "imu" else "imu_uwb_yolo"  # whose filter reads the imu's angles alone
        bound = position_floor(load_scenario(base, (("room", of_halved.room), *settings)), truth)
        assert bound is not None
        np.testing.assert_allclose(rows, np.sqrt(bound.sum(axis=1)), rtol=1e-12)
        assert np.all(rows >= found["all"] * (1.0 - 1e-9))


def test_the_worst_stretch_is_about_the_peak_and_hangs_on_what_raises_it_most() -> None:
    whole = np.array([1.0, 1.0, 3.3, 4.0, 3.5, 1.0, 3.9, 1.0])
    found = {
        "all": whole,
        "uwb": 1.5 * whole,
        "camera": whole + [0, 0, 0, 9, 0, 0, 0, 0],
        "imu": whole + [90, 90, 0, 0, 0, 0, 0, 0],
    }
    tells = {"uwb": np.array([1, 1, 0, 0, 1, 1, 1, 1], dtype=bool), "camera": np.ones(8, dtype=bool)}
    worst = worst_stretch(found, tells)
    assert (worst.first, worst.last, worst.floor) == (2, 4, 4.0)
    assert (worst.hangs_on, worst.floor_without, worst.silent) == ("camera", 13.0, ("uwb",))
    alone = worst_stretch({"all": whole, "uwb": 1.05 * whole}, {})
    assert (alone.hangs_on, alone.silent) == (None, ())


def test_a_flight_is_lost_where_three_sigma_first_reach_a_wall() -> None:
    free = np.array([1.0, 1.0, 0.5, 1.0])
    assert first_lost(np.array([0.1, 0.2, 0.16, 0.1]), free) is None
    assert first_lost(np.array([0.1, 0.2, 0.17, 0.5]), free) == 2


@pytest.mark.long
def test_behind_a_wall_no_anchor_is_in_sight_and_the_way_is_worst_there(of_halved: Scenario) -> None:
    found = coverage(of_halved)
    over = found.over_floor
    x, y = np.meshgrid(over.x, over.y)
    assert over.height == pytest.approx(1.5)
    before = over.free & (x < 4.0)
    assert np.all(over.anchors[before] == 4)
    assert np.all(np.isfinite(over.pdop[before]))
    behind = over.free & (x > 5.2) & (y < 4.0)  # the door is too far north for any line through it
    assert np.all(over.anchors[behind] < 4)
    assert np.all(over.anchors[over.free & (x > 5.5) & (y < 1.5)] == 0)
    assert np.all(np.isinf(over.pdop[over.free & (x > 5.5) & (y < 1.5)]))
    assert not over.free[(np.abs(x - 5.0) < 0.05) & (y < 4.3)].any()
    assert over.landmarks[0][over.free & (x > 8.0) & (np.abs(y - 4.8) < 0.3)].max() > 0  # heading east
    west = int(np.argmin(np.abs(over.headings - np.pi)))
    assert over.landmarks[west][over.free].max() == 0
    first = found.along.position[np.searchsorted(found.along.time, found.worst_times[0])]
    assert first[0] > 5.0
    assert found.cases["uwb"].floor >= found.cases["all"].floor
    assert "m of the way" in found.answer
    assert " s)" in found.answer


@pytest.mark.long
def test_in_the_blackouts_of_uwb_the_first_scenario_gets_lost() -> None:
    found = coverage(load_scenario("imu_uwb", (BLOCK, "planner.goal=[8.0, 0.9]")))
    first, last = found.worst_times
    (at,) = np.nonzero((found.along.time >= first) & (found.along.time < last))
    assert np.all((found.along.position[at, 0] > 1.5) & (found.along.position[at, 0] < 5.6))
    assert "uwb measures nothing there" in found.answer
    assert found.cases["all"].lost_at is not None


@pytest.mark.long
def test_the_figure_holds_three_maps_and_two_strips_wide_or_not(halved: Path, of_halved: Scenario) -> None:
    found = coverage(of_halved)
    figure = draw_coverage(found, load_room(halved))
    assert isinstance(figure, Figure)
    titles = " ".join(axes.get_title() for axes in figure.axes)
    for word in ("anchors", "PDOP", "landmarks (★) in view, heading 0", "Cramér-Rao", "by heading"):
        assert word in titles


@pytest.mark.long
def test_the_command_answers_first_and_writes_what_it_says(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, report, png = tmp_path / "room.yaml", tmp_path / "c.json", tmp_path / "c.png"
    file.write_text(new_room("hall", (5.0, 4.0, 3.0), 5))
    assert run("room", "coverage", str(file), "--json", str(report), "--png", str(png)) == 0
    said = capsys.readouterr().out.splitlines()
    found = json.loads(report.read_text())
    assert said[0] == f"Where will hall lose you? {found['answer']}"
    assert png.stat().st_size > 10_000
    along, over = found["along"], found["over_floor"]
    assert set(along["floor"]) == set(found["cases"]) == {"all", "uwb", "camera", "imu"}
    assert len(along["time"]) == len(along["pdop"]) == len(along["floor"]["all"])
    assert np.shape(over["landmarks"]) == (len(over["headings"]), len(over["y"]), len(over["x"]))
    assert run("room", "coverage", str(file), "--set", "planner.goal=[2.0, 9.0]") == 2
    assert "planner.goal" in capsys.readouterr().err


def test_a_scenario_file_is_no_room(tmp_path: Path, halved: Path) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text(f"base: imu_uwb\nroom: {halved}\n")
    assert scenario_of(str(file)).sensors == ("uwb", "imu")
    assert scenario_of(str(halved)).sensors == ("uwb", "camera", "imu")
    assert scenario_of("imu_uwb").name == "imu_uwb"


TETRAHEDRON = np.array([[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]])
LEAST: dict[str, Any] = {
    "interior": {"min": [0, 0, 0], "max": [10, 10, 3]},
    "anchors": [[1, 1, 1], [9, 1, 2], [9, 7, 1]],
}
OCTAHEDRON = np.vstack([np.eye(3), -np.eye(3)])


def room_with(**changes: Any) -> Room:
    return validate(Room, LEAST | changes, "room.yaml")


@given(st.floats(0.1, 30.0), st.tuples(*[st.floats(-20.0, 20.0)] * 3))
def test_anchors_spread_alike_dilute_by_3_over_root_n(scale: float, middle: tuple[float, float, float]) -> None:
    at = np.array([middle])
    for corners, expected in ((TETRAHEDRON, np.sqrt(9.0 / 4.0)), (OCTAHEDRON, np.sqrt(9.0 / 6.0))):
        found = dilution(at, at + scale * corners, np.ones((1, len(corners)), dtype=bool))
        np.testing.assert_allclose(found, expected, rtol=1e-9)


@given(st.integers(0, 10**6), st.integers(3, 9))
def test_dilution_is_the_inverse_of_the_normal_matrix_over_those_in_sight(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    point, anchors, seen = rng.normal(size=(1, 3)), 5.0 * rng.normal(size=(n + 2, 3)), np.ones((1, n + 2), dtype=bool)
    seen[0, :2] = False
    G = (anchors[2:] - point) / np.linalg.norm(anchors[2:] - point, axis=1)[:, None]
    expected = np.sqrt(np.trace(np.linalg.inv(G.T @ G)))
    np.testing.assert_allclose(dilution(point, anchors, seen), expected, rtol=1e-6)


def test_two_anchors_or_a_plane_through_the_vehicle_give_no_position() -> None:
    at, flat = np.zeros((1, 3)), np.array([[1.0, 0, 0], [0, 1, 0], [-1, 1, 0], [-1, -1, 0], [2, -1, 0]])
    assert dilution(at, TETRAHEDRON, np.array([[True, True, False, False]])) == np.inf
    assert dilution(at, flat, np.ones((1, 5), dtype=bool)) == np.inf
    assert dilution(at, TETRAHEDRON, np.zeros((1, 4), dtype=bool)) == np.inf


def test_a_wall_takes_the_sight_of_what_is_behind_it_and_no_more() -> None:
    """A wall at x = 5, 0.2 m thick, from y = 2 to 6 and 2 m high, seen from (2, 4, 1)."""
    anchors = {
        (8.0, 4.0, 1.0): False,  # straight behind it
        (8.0, 4.0, 4.9): True,  # over it: at x = 5.1 the line is 3.0 m high
        (8.0, 4.0, 2.9): False,  # not over it: at x = 5.1 the line is 1.98 m high
        (8.0, 8.9, 1.0): True,  # past its end: at x = 4.9 the line is at y = 6.37
        (8.0, 7.7, 1.0): False,  # at x = 4.9 the line is at y = 5.79
        (4.0, 4.0, 1.0): True,  # in front of it
        (5.0, 5.0, 1.0): True,  # in the wall, which holds it
    }
    room = room_with(anchors=[list(p) for p in anchors], walls=[[5.0, 4.0, np.pi / 2, 4.0, 0.2, 2.0]])
    at = np.array([[2.0, 4.0, 1.0]])
    assert anchors_in_sight(at, room, 100.0, walls_block=True).tolist() == [list(anchors.values())]
    assert anchors_in_sight(at, room, 100.0, walls_block=False).all()
    near = [np.linalg.norm(np.array(p) - at) <= 6.5 for p in anchors]
    assert anchors_in_sight(at, room, 6.5, walls_block=False).tolist() == [near]


@pytest.mark.parametrize("yaw", [0.0, np.pi / 2, np.pi, -np.pi / 2, 0.4, -2.5])
def test_a_landmark_is_in_view_where_the_vehicle_looks_at_it_and_no_wall_is_between(tmp_path: Path, yaw: float) -> None:
    """Persons 4 m away every 90 degrees; a picture spans 47 degrees to each side, and one is behind a wall."""
    around = np.arange(4) * np.pi / 2
    places = 5.0 + 4.0 * np.column_stack([np.cos(around), np.sin(around)])
    people = [{"label": "person", "position": [*p.tolist(), 1.0]} for p in places]
    walls = [[5.0, 3.0, 0.0, 3.0, 0.2, 3.0]]
    file = tmp_path / "room.yaml"
    file.write_text(yaml.safe_dump(LEAST | {"landmarks": people, "walls": walls}))
    scenario = load_scenario("imu_uwb_yolo", (f"room={file}", "camera.kind=projected", "planner.kind=hover"))
    found = Eyes(scenario).in_view(np.array([5.0, 5.0, 1.2]), yaw)
    off = np.abs((around - yaw + np.pi) % (2 * np.pi) - np.pi)
    assert found.tolist() == [i for i in range(3) if off[i] < np.radians(43)]
