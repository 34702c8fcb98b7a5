"""Whatever is wrong with the input: exit code 2, one line on stderr that names it, and nothing written."""

import json
from pathlib import Path
from typing import Any

import pytest
import yaml
from command_line import run

from ortilo_drake.model.room import ORTILO_ROOM
from ortilo_drake.world.scenery import rendering
from ortilo_drake.world.sensors.camera_calibration import CALIBRATION

HOVER = "planner={kind: hover, point: [8, 1, 1.5], duration: 0.2}"
INF = float("inf")


def room_file(folder: Path, **changes: Any) -> str:
    room = yaml.safe_load(ORTILO_ROOM.read_text(encoding="utf-8"))
    path = folder / "room.yaml"
    path.write_text(yaml.safe_dump(room | changes), encoding="utf-8")
    return f"room={path}"


# --- settings -------------------------------------------------------------------------------------------------


@pytest.mark.family
@pytest.mark.parametrize(
    ("setting", "named"),
    [
        # unknown
        ("frobs=1", ["frobs", "unknown"]),
        ("estimator.v.imu=[1, 1, 1]", ["estimator.v", "unknown"]),
        ("uwb.noise={kind: pink}", ["uwb.noise.kind", "'pink'", "proportional", "constant"]),
        ("world.kinematics=quaternion", ["world.kinematics", "quaternion", "rigid_body"]),
        ("sensors=[gps]", ["sensors", "'gps'", "uwb"]),
        ("sensors=[uwb, uwb]", ["sensors", "twice"]),
        # of the wrong type
        ("seed='1'", ["seed", "'1'", "integer"]),
        ("seed=true", ["seed", "True", "integer"]),
        ("control_rate=fast", ["control_rate", "'fast'", "number"]),
        ("sensors=imu", ["sensors", "'imu'"]),
        ("planner=null", ["planner", "None"]),
        ("estimator.V.imu=[1, 1]", ["estimator.V.imu"]),
        ("seed=2020-01-01", ["seed", "2020-01-01", "integer"]),
        # out of range
        ("seed=9223372036854775808", ["seed", "9223372036854775808"]),
        ("planner={kind: hover, duration: 5.0e-324}", ["planner.duration", "5e-324", "0.001"]),
        ("uwb.link.loss={kind: bernoulli, probability: 1.1}", ["probability", "1.1"]),
        ("uwb.link.blackouts=[{kind: time, start: 3, end: 2}]", ["uwb.link", "3.0", "2.0"]),
        ("uwb.link.delay=1000000000", ["uwb.link.delay", "1000000000"]),
        ("settle=1.0e+9", ["settle"]),
        ("planner={kind: hover, duration: 1.0e+300}", ["duration"]),
        ("vehicle.mass=1000", ["mass", "1000"]),
        ("vehicle=nowhere.yaml", ["vehicle", "nowhere.yaml", "no such vehicle file"]),
        ("vehicle.arms=[]", ["vehicle.arms", "[]", "at least 4"]),
        ("name=a/b", ["name", "a/b"]),
        ("name=''", ["name"]),
        # variances that are negative, and V not positive definite
        ("world.disturbance.force_density=-0.1", ["world.disturbance.force_density", "-0.1"]),
        ("estimator.V.imu=[-0.01, 0.01, 0.01]", ["estimator.V.imu", "-0.01"]),
        ("estimator.V.imu=[0.01, 0.0, 0.01]", ["estimator.V.imu", "0.0"]),
        ("estimator.V.uwb=[0.01, 0.01, 0.0]", ["estimator.V.uwb", "0.0"]),
        ("multilateration.noise={kind: proportional, fraction: 0.0}", ["multilateration.noise", "0.0"]),
        ("multilateration.noise={kind: constant, sd: 0.0}", ["multilateration.noise", "0.0"]),
        ("landmark_fix.center_sd=0.0", ["landmark_fix.center_sd", "0.0"]),
        ("estimator.W={kind: diagonal, position: -1, angle: 1, velocity: 1, rate: 1}", ["position", "-1"]),
        ("servo.weights.integral=[0, 1, 1]", ["servo.weights.integral", "0"]),
        ("servo.weights.control=[0, 1, 1, 1]", ["servo.weights.control", "0"]),
        # not numbers
        ("world.disturbance.force_density=.nan", ["world.disturbance.force_density", "nan", "finite"]),
        ("uwb.max_distance=.inf", ["uwb.max_distance", "inf", "finite"]),
        ("planner={kind: waypoints, points: [[0, 0, .nan], [1, 1, 1]]}", ["planner.points", "nan", "finite"]),
        # not a setting
        ("=1", ["=1", "key=value"]),
        ("uwb..noise=1", ["uwb..noise", "key=value"]),
        ("seed=[", ["seed=[", "YAML"]),
        ("seed={a: 1, a: 2}", ["'a'", "twice"]),
        ("name=!!python/object/apply:os.getcwd []", ["name", "YAML"]),
    ],
)
def test_a_wrong_setting(refused: Any, setting: str, named: list[str]) -> None:
    line = refused("scenario", "check", "nominal_imu_uwb", "--set", setting)
    assert [word for word in named if word not in line] == [], line


@pytest.mark.parametrize("command", [["fly"], ["scenario", "check"], ["scenario", "show"], ["diagram"]])
def test_an_unknown_scenario(refused: Any, command: list[str]) -> None:
    line = refused(*command, "imu_gps")
    assert "'imu_gps'" in line
    assert "imu_uwb" in line  # what there is instead
    assert "`ortilo scenario list`" in line


def test_a_wrong_seed_on_the_command_line(refused: Any) -> None:
    assert "seed: -1" in refused("fly", "nominal_imu_uwb", "--seed", "-1")


def test_a_wrong_setting_stops_the_tables_before_they_fly(refused: Any) -> None:
    assert "'seed'" in refused("tables", "--set", "seed", "--out", "out")
    assert "--beside imu_uwb: 'imu_uwb' is in the tables already" in refused("tables", "--beside", "imu_uwb")


# --- files ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("content", "named"),
    [
        (None, ["cannot be read", "No such file"]),
        (b"\x89PNG\r\n\x1a\n\xff\xfe", ["cannot be read", "UTF-8"]),
        (b"name: \x00\x01", ["not valid YAML"]),
        (b"name: a\nseed: 1\nseed: 2\n", ["line 3", "'seed'", "twice"]),
        (b"uwb:\n  noise: {kind: constant, sd: 1.0, sd: 2.0}\n", ["'sd'", "twice"]),
        (b"- 1\n- 2\n", ["list"]),
        (b"3\n", ["int"]),
        (b"name: [\n", ["not valid YAML"]),
        (b"\tname: a\n", ["not valid YAML"]),
        (b"1: 2\n", ["1", "not a name"]),
        (b"seed: 1\n---\nseed: 2\n", ["not valid YAML"]),
        (b"name: " + b"[" * 5000 + b"]" * 5000, ["bad.yaml"]),
        (b"seed: .nan\n", ["seed", "nan", "finite"]),
    ],
)
def test_a_wrong_scenario_file(refused: Any, tmp_path: Path, content: bytes | None, named: list[str]) -> None:
    path = tmp_path / "bad.yaml"
    if content is not None:
        path.write_bytes(content)
    line = refused("fly", str(path))
    assert [word for word in ["bad.yaml", *named] if word not in line] == [], line


def test_a_folder_for_a_scenario_file(refused: Any, tmp_path: Path) -> None:
    (tmp_path / "folder.yaml").mkdir()
    assert "folder.yaml: cannot be read" in refused("fly", str(tmp_path / "folder.yaml"))


def test_a_wrong_room_file(refused: Any, tmp_path: Path) -> None:
    """What else is wrong with one is refused in model/test_room.py."""
    line = refused("scenario", "check", "nominal_imu_uwb", "--set", room_file(tmp_path, wall_size=[3.0, INF, 3.0]))
    assert [word for word in ("room.yaml", "wall_size", "inf", "finite") if word not in line] == [], line


# --- paths ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("command", [["scenario", "check"], ["fly"]])
@pytest.mark.parametrize(
    ("planner", "named"),
    [
        ("{kind: gcs, goal: [5.7, -0.6]}", ["planner.goal", "5.7", "'wall'", "0.49"]),
        ("{kind: gcs, start: [5.7, -0.6]}", ["planner.start", "5.7", "'wall'"]),
        ("{kind: gcs, goal: [100, 0]}", ["planner.goal", "100", "outside the room"]),
        ("{kind: gcs, height: 5.0}", ["planner.height", "5", "0 and 3"]),
        ("{kind: gcs, goal: [0.0, 0.0]}", ["planner.goal", "start"]),
        ("{kind: hover, point: [5.7, -0.8, 1.5]}", ["planner.point", "'wall'"]),
        ("{kind: waypoints, points: [[0, 0, 1.5], [5.7, -0.8, 1.5]]}", ["planner.points", "'wall'"]),
        ("{kind: waypoints, points: [[0, 0, 1.5]]}", ["planner.points", "at least 2"]),
        ("{kind: waypoints, points: [[0, 0, 1.5], [0, 0, 1.5]]}", ["planner.points", "the same"]),
        ("{kind: waypoints}", ["planner", "points", "file"]),
        ("{kind: waypoints, file: /nowhere/points.txt}", ["/nowhere/points.txt", "cannot be read"]),
    ],
)
def test_a_path_that_cannot_be_flown(refused: Any, command: list[str], planner: str, named: list[str]) -> None:
    line = refused(*command, "nominal_imu_uwb", "--set", f"planner={planner}")
    assert [word for word in named if word not in line] == [], line


@pytest.mark.long
def test_no_free_path_through_a_wall_across_the_room(refused: Any, tmp_path: Path) -> None:
    walls = yaml.safe_load(ORTILO_ROOM.read_text(encoding="utf-8"))["walls"]
    across = [[10.0, -4.0 + k, 0.0] for k in range(9)]
    line = refused("fly", "nominal_imu_uwb", "--set", room_file(tmp_path, walls=walls + across))
    assert "planner.goal" in line
    assert "no free way" in line


def test_no_free_path_for_a_vehicle_as_wide_as_the_room(refused: Any) -> None:
    assert "1.1" in refused("fly", "nominal_imu_uwb", "--set", "vehicle.radius=1.1")


# --- check refuses what fly refuses -----------------------------------------------------------------------------


def calibration_file(folder: Path, **changes: Any) -> str:
    calibration = yaml.safe_load(CALIBRATION.read_text(encoding="utf-8"))
    path = folder / "calibration.yaml"
    path.write_text(yaml.safe_dump(calibration | changes), encoding="utf-8")
    return f"camera.errors.file={path}"


def refusals(refused: Any, *settings: str) -> str:
    """Return the line in which `scenario check` and `fly` both refuse these settings of nominal_imu_uwb_yolo."""
    laid_over = [word for setting in (HOVER, *settings) for word in ("--set", setting)]
    line = refused("scenario", "check", "nominal_imu_uwb_yolo", *laid_over)
    assert refused("fly", "nominal_imu_uwb_yolo", *laid_over) == line
    return str(line)


def test_a_calibration_that_is_missing_or_wrong(refused: Any, tmp_path: Path) -> None:
    projected = "camera.kind=projected"
    line = refusals(refused, projected, f"camera.errors.file={tmp_path}/none.yaml")
    assert "none.yaml: no such camera calibration" in line
    assert "slow_erors" in refusals(refused, projected, calibration_file(tmp_path, slow_erors={}))
    wrong = {"share": 1.5, "period": 1.0}
    assert "slow_errors.share: 1.5" in refusals(refused, projected, calibration_file(tmp_path, slow_errors=wrong))


def test_a_picture_of_no_height_names_the_camera_that_takes_it(refused: Any, tmp_path: Path) -> None:
    room = yaml.safe_load(ORTILO_ROOM.read_text(encoding="utf-8"))
    setting = room_file(tmp_path, camera=room["camera"] | {"height": 1})
    assert "camera.width: 640" in refusals(refused, "camera.kind=projected", "camera.width=640", setting)


@pytest.mark.long
@pytest.mark.egl
def test_a_class_that_the_detector_does_not_know(refused: Any, tmp_path: Path) -> None:
    room = yaml.safe_load(ORTILO_ROOM.read_text(encoding="utf-8"))
    sizes = room["landmark_size"] | {"unicorn": [1.0, 1.0, 1.0]}
    landmarks = [room["landmarks"][0] | {"label": "unicorn"}, *room["landmarks"][1:]]
    setting = room_file(tmp_path, landmark_size=sizes, landmarks=landmarks)
    assert "'unicorn'" in refusals(refused, setting)
    assert run("scenario", "check", "nominal_imu_uwb_yolo", "--set", setting, "--set", "camera.kind=projected") == 0


@pytest.mark.egl
@pytest.mark.parametrize(
    ("settings", "named"),
    [
        (("detector.cfg=none.cfg", "detector.weights=none.weights"), "none.cfg: cannot be read"),
        (("camera.width=2048", "camera.link.delay=1000"), "camera.link.delay: 1000"),
    ],
)
def test_pictures_that_nothing_can_look_at_or_hold(refused: Any, settings: tuple[str, ...], named: str) -> None:
    assert named in refusals(refused, *settings)


def test_without_a_renderer(refused: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rendering, "_egl_works", lambda: False)
    assert "libegl1" in refusals(refused)


# --- more than memory holds -------------------------------------------------------------------------------------


@pytest.mark.family
@pytest.mark.parametrize(
    ("settings", "named"),
    [
        (("control_rate=1000.0", "planner.duration=36000.0"), ["control_rate: 1000", "MiB", "2048 MiB"]),
        (("settle=3600.0", "control_rate=1000.0"), ["control_rate: 1000", "2048 MiB"]),
        (("planner={kind: gcs, goal: [1, 0], speed: 1.0e-6}",), ["planner", "36000 s"]),
        (("planner={kind: gcs, goal: [1, 0], speed: 1.0e-12}",), ["planner", "36000 s"]),
        (("planner={kind: gcs, goal: [1, 0], acceleration: 1.0e-12}",), ["planner", "36000 s"]),
        (("uwb.link.rate=1.0e-12",), ["uwb.link.rate", "0.001"]),
    ],
)
def test_a_flight_that_is_too_long(refused: Any, settings: tuple[str, ...], named: list[str]) -> None:
    line = refusals(refused, "camera.kind=projected", *settings)
    assert [word for word in named if word not in line] == [], line


def test_a_room_of_a_kilometre(refused: Any, tmp_path: Path) -> None:
    large = room_file(tmp_path, interior={"min": [-500.0, -500.0, 0.0], "max": [500.0, 500.0, 3.0]})
    line = refusals(refused, "camera.kind=projected", large, "planner={kind: gcs, goal: [1, 0]}")
    assert "interior: 1000 m x 1000 m" in line
    assert "10000 m^2" in line
    assert run("scenario", "check", "nominal_imu_uwb", "--set", large, "--set", HOVER) == 0


@pytest.mark.family
@pytest.mark.parametrize("camera", ["rendered", "projected"])
@pytest.mark.parametrize(("width", "height"), [(1, 100_000), (100_000, 1)])
def test_pictures_without_pixels_or_with_too_many(
    refused: Any, tmp_path: Path, camera: str, width: int, height: int
) -> None:
    room = yaml.safe_load(ORTILO_ROOM.read_text(encoding="utf-8"))
    changed = room_file(tmp_path, camera=room["camera"] | {"width": width, "height": height})
    line = refusals(refused, f"camera.kind={camera}", changed)
    assert f"{width} x {height} px" in line


@pytest.mark.long
@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"anchors": [[0.0, 0.0, 2.0] for _ in range(2000)]}, ["anchors", "1000", "2000"]),
        ({"stands": [[0.0, 0.0] for _ in range(6000)]}, ["stands", "5000", "6000"]),
        ({"name": "\x1b[2J"}, ["name", "x1b"]),
    ],
)
def test_a_room_that_holds_too_much(refused: Any, tmp_path: Path, changes: dict[str, Any], named: list[str]) -> None:
    line = refusals(refused, "camera.kind=projected", room_file(tmp_path, **changes))
    assert [word for word in named if word not in line] == [], line


# --- what cannot be written -----------------------------------------------------------------------------------


@pytest.mark.parametrize("option", ["--out", "--json", "--png", "--html"])
@pytest.mark.parametrize("where", ["file/x.png", "file/deeper/x.png", "folder.png"])
def test_a_result_that_cannot_be_written(refused: Any, tmp_path: Path, option: str, where: str) -> None:
    (tmp_path / "file").write_text("in the way")
    (tmp_path / "folder.png").mkdir()
    line = refused("fly", "nominal_imu_uwb", "--set", HOVER, option, where)
    assert where in line


def test_tables_and_diagrams_that_cannot_be_written(refused: Any, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    for where in ("file", "file/deeper"):
        assert where in refused("tables", "--flights", "1", "--set", HOVER, "--out", where)
    assert "file/x.json" in refused("tables", "--flights", "1", "--set", HOVER, "--json", "file/x.json")
    assert "file/x.svg" in refused("diagram", "--svg", "file/x.svg")


@pytest.mark.family
@pytest.mark.parametrize("where", ["x.frog", "x"])
def test_a_picture_of_an_unknown_kind(refused: Any, where: str) -> None:
    assert where in refused("fly", "nominal_imu_uwb", "--set", HOVER, "--png", where)


# --- options --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["tables", "--flights", "0"], ["--flights", "1"]),
        (["tables", "--workers", "0"], ["--workers", "1"]),
        (["tables", "--preset", "best"], ["--preset", "best", "tuned", "nominal", "paper", "printed"]),
        (["fly", "--seed", "one"], ["'--seed': must be an integer"]),
        (["rare", "--corridor", "20cm"], ["'--corridor': must be a number"]),
        (["fly", "--plugin", "mine.py"], ["--plugin: must stand before the command: ortilo --plugin ... fly ..."]),
        (["hil", "world", "--theme", "dark"], ["must stand before the command: ortilo --theme ... hil world ..."]),
        (["faults", "--figures", "pdf"], ["must stand before the command: ortilo --figures ... faults ..."]),
        (["--theme"], ["'--theme' requires an argument"]),
        (["fly", "nominal_imu_uwb", "nominal_imu_uwb"], ["nominal_imu_uwb"]),
        (["fly", "--fast"], ["--fast"]),
        (["fly", "--set"], ["--set"]),
        (["hover"], ["hover"]),
        (["diagram", "--depth", "9"], ["--depth", "3"]),
    ],
)
def test_a_wrong_option(refused: Any, words: list[str], named: list[str]) -> None:
    line = refused(*words)
    assert [word for word in named if word not in line] == [], line


# --- extremes that pass the checks of range -------------------------------------------------------------------


@pytest.mark.family
@pytest.mark.parametrize(
    "setting",
    [
        "estimator.initial_sd=[1.0e+200, 1, 1, 1]",
        "estimator.initial_sd=[1.0e-200, 1.0e-200, 1.0e-200, 1.0e-200]",
        "estimator.W={kind: diagonal, position: 1.0e+300, angle: 1, velocity: 1, rate: 1}",
        "servo.weights.position=[1.0e+300, 1, 1]",
        "uwb.noise={kind: constant, sd: 1.0e+200}",
        "world.disturbance.force_density=1.83e+199",
        "estimator.initial_sd=[1.0e+6, 1.0e+6, 1.0e+6, 1.0e+6]",
        "estimator.initial_sd=[1.0e-9, 1.0e-9, 1.0e-9, 1.0e-9]",
        "estimator.V.imu=[1.0e-12, 1.0e-12, 1.0e-12]",
        "servo.weights.position=[1.0e+9, 1, 1]",
        "servo.weights.control=[1.0e-9, 1, 1, 1]",
        "servo.weights.integral=[1.0e-9, 1.0e-9, 1.0e-9]",
        "world.disturbance.force_density=1.83e+05",
        "uwb.noise={kind: constant, sd: 1.0e+6}",
        "vehicle.inertia=[1.0e-9, 1.0e-9, 1.0e-9]",
        "control_rate=1000.0",
        "uwb.max_distance=0.001",
        "sensors=[]",
    ],
)
def test_an_extreme_setting_is_refused_in_one_line_or_flown(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, setting: str
) -> None:
    result = tmp_path / "flight.json"
    code = run("fly", "nominal_imu_uwb", "--set", HOVER, "--set", setting, "--json", str(result))
    printed = capsys.readouterr()
    assert code in (0, 2, 3), printed.err
    if code == 2:
        assert len(printed.err.splitlines()) == 1
        assert not result.exists()
    else:
        assert json.loads(result.read_text())["scenario"] == "nominal_imu_uwb"
