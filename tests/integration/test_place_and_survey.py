"""The commands `ortilo room place` and `survey`: what they print, write and refuse."""

import json
import re
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from command_line import run

from ortilo_drake.flight.flight import fly
from ortilo_drake.flight.saved_flight import save_flight
from ortilo_drake.model.room import load_room
from ortilo_drake.scenario import load_scenario
from ortilo_drake.studies.room_design.place import room_text, with_anchors

PATH = "planner={kind: waypoints, points: [[0, 0, 1.5], [1.6, 0.6, 1.8]]}"


@pytest.mark.long
def test_place_writes_a_room_that_flies(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    room, report = tmp_path / "placed.yaml", tmp_path / "placed.json"
    settings = ("--set", "uwb.walls.kind=block", "--set", PATH)
    asked = ("--spacing", "4", "--out", str(room), "--json", str(report))
    assert run("room", "place", "nominal_imu_uwb", "5", *settings, *asked) == 0
    said, found = capsys.readouterr().out, json.loads(report.read_text(encoding="utf-8"))
    assert re.search(r"to see it: ortilo room show \S+\.yaml --png", said)
    assert set(found) == {"scenario", "candidates", "before", "after", "gain", "anchors", "landmarks"}
    assert set(found["before"]) == {"floor", "time", "place", "no_fix"}
    assert found["after"]["floor"] < found["before"]["floor"]
    np.testing.assert_allclose(found["gain"], 1.0 - found["after"]["floor"] / found["before"]["floor"])
    assert f"error bound {found['before']['floor']:.4f} m" in said
    assert f"error bound {found['after']['floor']:.4f} m" in said
    assert f"wrote {room}" in said
    assert load_room(room).anchor_positions.tolist() == found["anchors"]
    assert load_room(room).landmarks == load_room().landmarks
    flight = tmp_path / "flight.json"
    assert run("fly", "nominal_imu_uwb", "--set", f"room={room}", *settings, "--json", str(flight)) == 0
    assert json.loads(flight.read_text(encoding="utf-8"))["lost"] is None


@pytest.mark.long
def test_place_takes_a_room_as_coverage_does(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    room, report = tmp_path / "hall.yaml", tmp_path / "placed.json"
    assert run("room", "new", str(room), "--size", "8x6x3") == 0
    assert run("room", "place", str(room), "4", "--spacing", "4", "--json", str(report)) == 0
    assert "for a vehicle that has UWB alone: --set sensors=[uwb,imu]" in capsys.readouterr().out
    assert run("room", "place", str(room), "4", "--set", "uwb.link.rate=20") == 2
    assert f"{room}: uwb.link.rate: 20.0: must divide" in capsys.readouterr().err  # not the scenario it is flown as
    at = np.array(json.loads(report.read_text(encoding="utf-8"))["anchors"])
    assert at.shape == (4, 3)
    assert np.all((at >= 0.0) & (at <= [8.0, 6.0, 3.0]))


@pytest.mark.long
def test_survey_finds_anchors_that_a_flight_was_wrong_about(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    scenario = load_scenario("nominal_imu_uwb", (PATH, "truth.survey.anchors_sd=0.3", "uwb.link.blackouts=[]"), 3)
    save_flight(fly(scenario), tmp_path / "flight.nc")
    room = load_room()
    rng = np.random.default_rng(0)
    table = tmp_path / "between.csv"
    true = room.anchor_positions + 0.3 * rng.normal(size=(12, 3))
    lines = ["from,to,range"]
    for i, j in combinations(range(12), 2):
        d = np.linalg.norm(true[i] - true[j])
        lines += [f"a{i},a{j},{d + 0.01 * rng.normal()}" for _ in range(3)]
    table.write_text("\n".join(lines) + "\n")
    out, report = tmp_path / "found.yaml", tmp_path / "found.json"
    known = room.anchor_positions.copy()
    known[[1, 8, 9]] = true[[1, 8, 9]]
    (tmp_path / "room.yaml").write_text(room_text(with_anchors(room, known), "three are known"))
    words = (
        "--room",
        str(tmp_path / "room.yaml"),
        "--known",
        "1,8,9",
        "--range-sd",
        "0.01",
        "--out",
        str(out),
        "--json",
        str(report),
    )
    assert run("room", "survey", str(table), *words) == 0
    found = json.loads(report.read_text(encoding="utf-8"))
    assert set(found) == {
        "room", "known", "anchors", "sd", "moved", "ranges", "places", "chi2", "freedom", "doubts", "covariance"
    }  # fmt: skip
    anchors, sd = np.array(found["anchors"]), np.array(found["sd"])
    assert np.abs(anchors - true).max() < 0.06
    free = sd > 0.0
    assert free.sum() == 27
    assert np.abs((anchors - true)[free] / sd[free]).max() < 4.5
    assert load_room(out).anchor_positions.tolist() == found["anchors"]
    said = capsys.readouterr().out
    assert said.count("known") == 3
    assert said.count("sd (") == 9
    assert run("room", "survey", str(tmp_path / "flight.nc"), "--json", str(report)) == 0
    flown = json.loads(report.read_text(encoding="utf-8"))
    assert flown["ranges"] == 12 * flown["places"]
    assert 20 < flown["places"] < 100
    assert "on which side of it an anchor stands is a guess" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (("place", "nominal_imu_uwb", "2"), "N: 2: must be 3 to 1000"),
        (("place", "nominal_imu_uwb", "two"), "N"),
        (("place", "nominal_imu_uwb", "5", "--out", "room.txt"), "must end in .yaml"),
        (("place", "nominal_imu_uwb", "5", "--spacing", "nan"), "spacing"),
        (("place", "nominal_imu_uwb", "5", "--set", "sensors=[imu]"), "must have uwb"),
        (("place", "nominal_imu_uwb", "5", "--landmarks", "-1"), "--landmarks -1: must be 0 to 1000"),
        (("place", "nowhere", "5"), "'nowhere' is unknown"),
        (("survey", "missing.csv"), "missing.csv: cannot be read"),
        (("survey", "missing.nc"), "missing.nc: cannot be read"),
        (("survey", "missing"), "missing: no such log"),
        (("survey", "missing.csv", "--known", "0,b"), "--known '0,b': must be numbers"),
        (("survey", "missing.csv", "--loss", "square"), "square"),
        (("survey", "missing.csv", "--out", "x.nc"), "must end in .yaml"),
        (("survey", "missing.csv", "--room", "nowhere.yaml"), "nowhere.yaml: no such room file"),
    ],
)
def test_wrong_words_are_refused_in_one_line(
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    words: tuple[str, ...],
    named: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run("room", *words) == 2
    said = capsys.readouterr()
    assert named in said.err
    assert said.err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_a_survey_without_noise_of_ranges_is_refused(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    table = tmp_path / "between.csv"
    table.write_text("from,to,range\na0,a1,3\n")
    assert run("room", "survey", str(table), "--range-sd", "0") == 2
    assert "one of them must be above 0" in capsys.readouterr().err
    assert run("room", "survey", str(table)) == 2
    assert "anchor 3: 0 usable ranges" in capsys.readouterr().err
