"""`ortilo replay FOLDER --map` and `ortilo tune FOLDER --map`: what they write, print and refuse."""

import json
from pathlib import Path

import pytest
from command_line import run
from made_up_motion import TABLE_MAP, made_up, write_tables

from ortilo_drake.interop.recorded.map_file import load_map


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recorded")
    write_tables(folder / "walk", made_up(duration=40.0))
    (folder / "MAP.yaml").write_text(TABLE_MAP)
    return folder


def test_replay_writes_report_figures_and_json(capsys: pytest.CaptureFixture[str], place: Path, tmp_path: Path) -> None:
    words = ("--map", str(place / "MAP.yaml"), "--out", str(tmp_path / "out"), "--json", str(tmp_path / "r.json"))
    assert run("replay", str(place / "walk"), *words) == 0
    said = capsys.readouterr().out
    text = (tmp_path / "out/recorded.md").read_text(encoding="utf-8")
    assert text.startswith("# Recorded motions\n\n## In short\n\n- walk: RMS error in x, y, z 0.0")
    assert "Made by `ortilo replay" in text
    assert "| with IMU, smoothed |" in said
    assert (tmp_path / "out/walk.png").read_bytes()[1:4] == b"PNG"
    found = json.loads((tmp_path / "r.json").read_text(encoding="utf-8"))
    assert found["map"]["imu"]["axes"] == "flu"
    motion = found["motions"][0]
    assert set(motion["rows"]["with IMU"]) >= {"rmse", "ate", "rpe", "nees", "nis", "available"}
    assert motion["told_by"] == "rates"
    assert motion["rejected"] == {}


def test_replay_without_truth_or_imu(capsys: pytest.CaptureFixture[str], place: Path, tmp_path: Path) -> None:
    map_file = tmp_path / "bare.yaml"
    map_file.write_text(TABLE_MAP[: TABLE_MAP.index("imu:")])
    assert run("replay", str(place / "walk"), "--map", str(map_file), "--out", str(tmp_path)) == 0
    assert "walk: no truth; NIS" in capsys.readouterr().out
    map_file.write_text(TABLE_MAP.replace("imu:", "#"))
    assert run("replay", str(place / "walk"), "--map", str(map_file), "--out", str(tmp_path)) == 0
    said = capsys.readouterr().out
    assert "(constant velocity, calibrated on the first 30%)" in said
    assert "by the ranges" in said


def test_tune_writes_a_map_that_replays(capsys: pytest.CaptureFixture[str], place: Path, tmp_path: Path) -> None:
    tuned = tmp_path / "tuned.yaml"
    words = ("--map", str(place / "MAP.yaml"), "--out", str(tuned), "--json", str(tmp_path / "t.json"))
    assert run("tune", str(place / "walk"), *words) == 0
    said = capsys.readouterr().out
    assert "walk, fitted by innovations to the first parts" in said
    fitted = json.loads((tmp_path / "t.json").read_text(encoding="utf-8"))
    assert fitted["after"] > fitted["before"]
    assert load_map(tuned).filter.range_white == fitted["settings"]["range_white"]
    assert load_map(tuned).ranges == load_map(place / "MAP.yaml").ranges


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (("replay", "WALK", "WALK"), "2 logs given: one is replayed at a time; recordings of others need --map"),
        (("replay", "WALK", "WALK", "--map", "MAP"), "two folders of one name"),
        (("replay", "WALK/no", "--map", "MAP"), "no such file or folder"),
        (("replay", "WALK", "--map", "WALK/none.yaml"), "cannot be read: No such file"),
        (("replay", "WALK", "--map", "WALK/imu.csv"), "imu.csv"),
        (("tune", "WALK", "--map", "MAP", "--check", "3"), "--figure, --check: are for flights of ours"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(capsys: pytest.CaptureFixture[str], place: Path, words, line) -> None:
    said = [w.replace("WALK", str(place / "walk")).replace("MAP", str(place / "MAP.yaml")) for w in words]
    assert run(*said) == 2
    error = capsys.readouterr().err
    assert line in error
    assert error.count("\n") == 1
