"""The command `ortilo`: what it prints, writes and returns."""

import json
import re
import shutil
import subprocess
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import cv2
import pytest
from command_line import run, run_apart
from pydrake.systems.framework import Diagram

from ortilo_drake.diagrams.closed_loop import make_closed_loop
from ortilo_drake.diagrams.wiring.whole import boxes_of
from ortilo_drake.flight.flight import fly, scenario_of
from ortilo_drake.flight.metrics import summary
from ortilo_drake.flight.saved_flight import load_flight
from ortilo_drake.loop.wiring import Wiring
from ortilo_drake.model.as_data import as_data
from ortilo_drake.scenario import load_scenario

SHORT = "planner={kind: waypoints, points: [[0, 0, 1.5], [1.2, 0.6, 1.5]]}"
HOVER = "planner={kind: hover, point: [8, 1, 1.5], duration: 0.2}"
ASKED_FOR = {"scenario", "seed", "lost", "mse", "path_mse", "arrivals", "nees", "player", "real_time_factor"}
BESIDE = {"fix_errors", "contacts", "path_distance_mse", "max_path_distance", "max_reference_distance", "nis"}
BESIDE |= {"floor", "efficiency", "tick_efficiency"}
STATISTICS = {"mean", "median", "p75", "p25"}
NAMES = {"imu_uwb", "imu_uwb_yolo"}


# --- fly ------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, "subprocess.CompletedProcess[str]"]:
    folder = tmp_path_factory.mktemp("fly")
    files = ["--out", "new/flight.nc", "--json", "new/flight.json", "--png", "flight.png", "--html", "flight.html"]
    return folder, run_apart(
        "fly", "nominal_imu_uwb_yolo", "--seed", "3", "--set", SHORT, "--camera", "projected", *files, folder=folder
    )


@pytest.mark.processes
def test_fly_succeeds_and_its_standard_error_is_silent(flown: Any) -> None:
    _, done = flown
    assert done.code == 0
    assert done.stderr == ""


@pytest.mark.processes
def test_fly_writes_the_files_asked_for_and_no_other(flown: Any) -> None:
    folder, done = flown
    files = sorted(str(p.relative_to(folder)) for p in folder.rglob("*") if p.is_file())
    assert files == ["flight.html", "flight.png", "new/flight.json", "new/flight.nc"]
    for name in files:
        assert f"wrote {name}" in done.stdout
    assert cv2.imread(str(folder / "flight.png")) is not None
    assert "<html" in (folder / "flight.html").read_text(encoding="utf-8")


@pytest.mark.processes
def test_fly_writes_the_keys_asked_for(flown: Any) -> None:
    found = json.loads((flown[0] / "new/flight.json").read_text(encoding="utf-8"))
    assert set(found) == ASKED_FOR | BESIDE
    assert (found["scenario"], found["seed"], found["lost"], found["contacts"]) == ("nominal_imu_uwb_yolo", 3, None, [])
    assert set(found["mse"]) == {"x", "y", "z"}
    assert set(found["arrivals"]) == {"uwb", "camera"}
    assert set(found["nis"]) == {"uwb", "camera", "imu"}
    assert all(0.0 < rate <= 1.0 for rate in found["arrivals"].values())
    assert all(0.0 < found["mse"][axis] < 0.1 for axis in "xyz")
    assert found["real_time_factor"] > 0.0


@pytest.mark.processes
def test_fly_prints_and_writes_what_a_flight_in_this_process_gives(flown: Any) -> None:
    folder, done = flown
    scenario = load_scenario("nominal_imu_uwb_yolo", (SHORT, "camera.kind=projected"), 3)
    written = load_flight(folder / "new/flight.nc")
    assert scenario_of(written) == scenario
    here, there = as_data(summary(fly(scenario))), json.loads((folder / "new/flight.json").read_text(encoding="utf-8"))
    assert as_data(summary(written)) == there
    assert (here.pop("player"), there.pop("player")) == ("drake", "engine")
    del here["real_time_factor"], there["real_time_factor"]
    assert here == there
    assert done.stdout.startswith("nominal_imu_uwb_yolo, seed 3\n")
    for axis, value in here["mse"].items():
        assert f"{axis} {value:.5f}" in done.stdout
    assert f"{here['path_mse']:.5f}" in done.stdout
    assert f"uwb {here['arrivals']['uwb']:.1%}, camera {here['arrivals']['camera']:.1%}" in done.stdout


def test_a_lost_flight_is_written_and_has_an_exit_code_of_its_own(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    low = "planner={kind: hover, point: [8, 1, 0.02]}"
    result = tmp_path / "lost.json"
    assert run("fly", "nominal_imu_uwb", "--set", low, "--json", str(result)) == 3
    lost = json.loads(result.read_text(encoding="utf-8"))["lost"]
    assert set(lost) == {"time", "cause"}
    assert 0.0 < lost["time"] < 12.0
    assert lost["cause"] == "left the room"
    said = capsys.readouterr().out
    assert f"lost at {lost['time']:.1f} s: left the room" in said
    assert "`ortilo rare` estimates it for the same scenario and settings" in said


def test_a_sensor_that_does_not_fly_and_a_path_error_that_is_not_defined_are_null(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    result = tmp_path / "flight.json"
    assert run("fly", "nominal_imu_uwb", "--set", HOVER, "--json", str(result)) == 0
    found = json.loads(result.read_text(encoding="utf-8"))
    assert set(found) == ASKED_FOR | BESIDE
    assert found["path_mse"] is None
    assert found["arrivals"]["camera"] is None
    assert "not defined" in capsys.readouterr().out


def test_long_file_names_are_printed_whole(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    path = tmp_path / "[bold]a folder with a very long name[x]" / "and another one below it, long too" / "flight.json"
    assert run("fly", "nominal_imu_uwb", "--set", HOVER, "--json", str(path)) == 0
    assert f"wrote {path}\n" in capsys.readouterr().out


# --- tables ---------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def tabled(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, "subprocess.CompletedProcess[str]"]:
    folder = tmp_path_factory.mktemp("tables")
    words = [
        "--flights",
        "2",
        "--workers",
        "2",
        "--set",
        SHORT,
        "--camera",
        "projected",
        "--out",
        "out",
        "--json",
        "tables.json",
    ]
    return folder, run_apart("tables", *words, folder=folder)


@pytest.mark.processes
def test_tables_succeed_and_their_standard_error_is_silent(tabled: Any) -> None:
    _, done = tabled
    assert done.code == 0
    assert done.stderr == ""


@pytest.mark.processes
def test_tables_write_the_keys_asked_for(tabled: Any) -> None:
    found = json.loads((tabled[0] / "tables.json").read_text(encoding="utf-8"))
    assert {"preset", "flights", "lost", "estimation", "path", "paper"} <= set(found)
    assert (found["preset"], found["flights"]) == ("tuned", 2)
    assert found["lost"] == {"imu_uwb": 0, "imu_uwb_yolo": 0}
    for tables in (found, found["paper"]):
        assert set(tables["estimation"]) == set(tables["path"]) == NAMES
        for name in NAMES:
            assert set(tables["estimation"][name]) == {"x", "y", "z"}
            assert all(set(tables["estimation"][name][axis]) == STATISTICS for axis in "xyz")
            assert set(tables["path"][name]) == STATISTICS


@pytest.mark.processes
def test_tables_write_flights_figures_and_text_and_nothing_half_done(tabled: Any) -> None:
    folder, done = tabled
    files = {str(p.relative_to(folder)) for p in folder.rglob("*") if p.is_file()}
    flights = {name for name in files if name.startswith("out/flights/")}
    assert len(flights) == 4
    assert all(re.fullmatch(r"out/flights/imu_uwb(_yolo)?-[0-9a-f]{8}/seed_00000[01]\.nc", name) for name in flights)
    figures = {f"out/{figure}_tuned.png" for figure in ("trajectories", "errors", "arrivals")}
    assert files - flights == figures | {"out/tables_tuned.md", "tables.json"}
    assert all(cv2.imread(str(folder / figure)) is not None for figure in figures)
    text = (folder / "out/tables_tuned.md").read_text(encoding="utf-8")
    shown, _, made = text.rpartition("\n\nMade by ")
    assert shown in done.stdout
    assert made.startswith("`ortilo tables --flights 2 ")
    assert "IMU+UWB+YOLO" in text


@pytest.mark.processes
def test_a_second_run_of_the_tables_flies_nothing_and_gives_the_same(
    tabled: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, _ = tabled
    monkeypatch.chdir(folder)
    before = {p: p.stat().st_mtime_ns for p in (folder / "out/flights").rglob("*.nc")}
    words = [
        "--flights",
        "2",
        "--workers",
        "1",
        "--set",
        SHORT,
        "--camera",
        "projected",
        "--out",
        "out",
        "--json",
        "again.json",
    ]
    assert run("tables", *words) == 0
    capsys.readouterr()
    assert {p: p.stat().st_mtime_ns for p in (folder / "out/flights").rglob("*.nc")} == before
    assert (folder / "again.json").read_bytes() == (folder / "tables.json").read_bytes()
    (folder / "again.json").unlink()


@pytest.mark.long
@pytest.mark.parametrize("preset", ["paper", "tuned", "nominal", "printed"])
def test_tables_of_lost_flights_count_them(capsys: pytest.CaptureFixture[str], tmp_path: Path, preset: str) -> None:
    storm = "world.disturbance.torque_density=0.913"
    words = ["--flights", "1", "--workers", "1", "--preset", preset, "--set", HOVER, "--set", storm]
    result = tmp_path / "tables.json"
    assert run("tables", *words, "--out", str(tmp_path), "--json", str(result)) == 0
    found = json.loads(result.read_text(encoding="utf-8"))
    assert found["preset"] == preset
    assert found["lost"] == {"imu_uwb": 1, "imu_uwb_yolo": 1}
    assert found["estimation"]["imu_uwb"]["x"] == dict.fromkeys(STATISTICS)
    assert "1 of 1 flights lost" in capsys.readouterr().out


# --- diagram --------------------------------------------------------------------------------------------------


def subsystem_names(diagram: Diagram) -> set[str]:
    names = set()
    for system in diagram.GetSystems():
        own = system.get_name().rpartition("/")[2].partition("@")[0]  # of unnamed ones the type, as drawn
        names |= {own} | (subsystem_names(system) if isinstance(system, Diagram) else set())
    return names


@pytest.mark.skipif(shutil.which("dot") is None, reason="Graphviz's dot is not installed")
def test_drakes_diagram_is_svg_that_names_every_subsystem(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    path = tmp_path / "new" / "loop.svg"
    words = ("diagram", "nominal_imu_uwb_yolo", "--set", SHORT, "--set", "camera.kind=projected")
    assert run(*words, "--drake", str(path)) == 0
    assert capsys.readouterr().err == ""
    root = ElementTree.parse(path).getroot()
    assert root.tag == "{http://www.w3.org/2000/svg}svg"
    texts = {"".join(node.itertext()).strip() for node in root.iter("{http://www.w3.org/2000/svg}text")}
    names = subsystem_names(make_closed_loop(load_scenario("nominal_imu_uwb_yolo", (SHORT, "camera.kind=projected"))))
    assert {"world", "onboard", "plant", "uwb", "imu", "filter", "servo", "reference"} <= names
    assert {name for name in names if not any(name in text for text in texts)} == set()


@pytest.mark.parametrize(("depth", "named"), [("1", "uwb fix"), ("2", "in each tick says"), ("3", "servo_out")])
def test_the_diagram_is_printed(capsys: pytest.CaptureFixture[str], depth: str, named: str) -> None:
    assert run("diagram", "paper_imu_uwb", "--set", SHORT, "--depth", depth) == 0
    printed = capsys.readouterr()
    assert printed.err == ""
    assert printed.out.startswith("paper_imu_uwb: 16 boxes, 30 ticks a second\n")
    assert named in printed.out


def test_a_diagram_names_the_system_that_is_no_element(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("diagram", "imu_uwb_yolo", "--set", SHORT) == 0
    printed = capsys.readouterr()
    assert printed.err == ""
    assert "camera fix" in printed.out
    assert run("diagram", "imu_uwb_yolo", "--set", SHORT, "--depth", "3") == 0
    assert "Detector" in capsys.readouterr().out


@pytest.mark.skipif(shutil.which("dot") is None, reason="Graphviz's dot is not installed")
@pytest.mark.parametrize("depth", ["2", "3"])
def test_a_picture_names_every_box(tmp_path: Path, depth: str) -> None:
    path = tmp_path / "loop.svg"
    assert run("diagram", "robust_imu_uwb", "--set", SHORT, "--svg", str(path), "--depth", depth) == 0
    texts = {"".join(node.itertext()) for node in ElementTree.parse(path).iter("{http://www.w3.org/2000/svg}text")}
    wiring = Wiring(boxes_of(load_scenario("robust_imu_uwb", (SHORT,)), 1))
    assert wiring.boxes.keys() <= texts


def test_without_graphviz_a_picture_of_boxes_is_refused_in_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setattr(shutil, "which", lambda _: None)
    assert run("diagram", "paper_imu_uwb", "--svg", str(tmp_path / "loop.svg"), "--depth", "2") == 2
    printed = capsys.readouterr()
    assert len(printed.err.splitlines()) == 1
    assert "Graphviz" in printed.err
    assert list(tmp_path.iterdir()) == []


# --- help and errors ------------------------------------------------------------------------------------------


def test_a_flight_with_losses_says_what_was_set_and_what_was_missing(capsys: pytest.CaptureFixture[str]) -> None:
    settings = ("--set", SHORT, "--set", "uwb.link.blackouts=[]")
    assert run("fly", "nominal_imu_uwb", *settings, "--set", "uwb.link.loss=0.5") == 0
    said = " ".join(capsys.readouterr().out.split())
    used = re.search(r"fixes used uwb ([0-9.]+)%", said)
    loss = re.search(r"loss uwb set to 50.0%, in this flight ([0-9.]+)%", said)
    assert used is not None
    assert loss is not None
    assert float(used[1]) + float(loss[1]) == pytest.approx(100.0, abs=0.11)
    assert run("fly", "nominal_imu_uwb", *settings) == 0
    assert "set to" not in capsys.readouterr().out


def test_a_checked_scenario_says_what_its_vehicle_can_do(capsys: pytest.CaptureFixture[str]) -> None:
    vehicle = {"mass": 1.2, "rotor_lift": 0.00002, "rotor_drag": 0.0000004, "rotor_max_speed": 900.0}
    settings = [word for key, value in vehicle.items() for word in ("--set", f"vehicle.{key}={value:.7f}")]
    assert run("scenario", "check", "rotors", *settings) == 0
    hover = (1.2 * 9.81 / (4 * 0.00002)) ** 0.5
    said = capsys.readouterr().out
    assert f"1.2 kg, 4 rotors; hovers at {hover:.4g} rad/s, {hover / 900.0:.0%} of the largest speed" in said
    assert f"lifts at most {(900.0 / hover) ** 2:.1f} times its weight" in said


def test_a_lag_that_ideal_rotors_do_not_fly_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "v.yaml"
    said = "rotors: ideal: the vehicle's lag of 0.03 and 0.04 s is not simulated; `--set 'world={"
    file.write_text("mass: 2.7\nrotor_time_constant: [0.03, 0.04]\n")
    for scenario, expected in (("imu_uwb", True), ("rotors", False)):
        assert run("scenario", "check", scenario, "--set", f"vehicle={file}") in (0, 3)
        assert (said in capsys.readouterr().out) == expected


def test_a_scenario_that_is_doubted_can_be_told_by_the_exit_code(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("scenario", "check", "nominal_imu_uwb") == 0
    assert "nominal_imu_uwb: valid; flies" in capsys.readouterr().out
    assert run("scenario", "check", "nominal_imu_uwb", "--set", "vehicle.inertia=[155, 166, 208]") == 3
    said = capsys.readouterr()
    assert "nominal_imu_uwb: doubtful; flies" in said.out
    assert said.err.startswith("warning  vehicle.inertia: 155, 166, 208 kg m²: ")
    assert run("scenario", "check", "nominal_imu_uwb", "--set", "vehicle.radius=-1") == 2


@pytest.mark.family
@pytest.mark.parametrize(
    "words", [[], ["fly"], ["tables"], ["diagram"], ["scenario"], ["scenario", "check"], ["scenario", "show"]]
)
def test_every_command_has_help(capsys: pytest.CaptureFixture[str], words: list[str]) -> None:
    assert run(*words, "--help") == 0
    printed = capsys.readouterr()
    assert "Usage:" in printed.out
    assert printed.err == ""


@pytest.mark.processes
def test_bad_input_ends_the_process_with_code_two_and_one_line(tmp_path: Path) -> None:
    done = run_apart("fly", "imu_gps", "--json", "flight.json", folder=tmp_path)
    assert done.code == 2
    assert done.stdout == ""
    assert re.fullmatch(r"ortilo: .*'imu_gps'.*\n", done.stderr)
    assert list(tmp_path.iterdir()) == []


def test_control_c_ends_with_code_130_and_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    from ortilo_drake.flight import players

    def press_control_c(*_: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(players, "fly", press_control_c)
    assert run("fly", "nominal_imu_uwb", "--set", HOVER, "--out", str(tmp_path / "flight.nc")) == 130
    assert len(capsys.readouterr().err.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (
            ("fly", "nominal_imu_uwb", "--detector", "a.cfg", "a.weights"),
            "needs a camera, which nominal_imu_uwb",
        ),
        (("fly", "nominal_imu_uwb_yolo", "--camera", "projected", "--detector", "a.cfg", "a.weights"), "does not draw"),
        (("detector", "evaluate", "--detector", "a.cfg", "a.weights"), "a.cfg: cannot be read"),
        (("detector", "calibrate", "--detector", "a.cfg", "a.weights"), "a.cfg: cannot be read"),
    ],
)
def test_a_detector_that_cannot_be_used_is_refused(
    words: tuple[str, ...],
    why: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(*words) == 2
    assert why in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_detector_leaves_the_other_settings_of_one() -> None:
    from ortilo_drake.commands.options import with_camera

    laid_over = with_camera(
        ["detector.threshold=0.2", "detector.names=a.names"], None, (Path("a.cfg"), Path("b.weights"))
    )
    detector = load_scenario("nominal_imu_uwb_yolo", laid_over).detector
    assert detector.threshold == 0.2
    assert [Path(str(f)).name for f in (detector.cfg, detector.weights, detector.names)] == [
        "a.cfg",
        "b.weights",
        "a.names",
    ]
