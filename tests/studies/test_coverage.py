"""Coverage of a room: floors with a sensor lost, where the way is worst, and maps, against other ways to the same."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from command_line import run
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation

from ortilo_drake.floor.cramer_rao import position_floor
from ortilo_drake.model.room import load_room
from ortilo_drake.model.vehicle import GRAVITY
from ortilo_drake.scenario import Scenario, load_scenario
from ortilo_drake.studies.rooms.coverage import coverage
from ortilo_drake.studies.rooms.coverage_figure import draw_coverage
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
