"""`ortilo replay FOLDER --map` and `ortilo tune FOLDER --map`: what they write, print and refuse."""

import json
from pathlib import Path

import numpy as np
import pytest
from command_line import run
from evo.tools import file_interface
from made_up_motion import TABLE_MAP, attitude, made_up, write_tables
from made_up_motion import place as made_up_place
from scipy.spatial.transform import Rotation

from ortilo_drake.interop.recorded.map_file import load_map


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recorded")
    write_tables(folder / "walk", made_up(duration=40.0))
    (folder / "MAP.yaml").write_text(TABLE_MAP)
    return folder


def check_trajectories(folder: Path, said: str) -> None:
    """The truth written is the made-up one, in the anchors' frame by the sensors' clock; the estimate is near."""
    read = {}
    for kind in ("estimate", "smoother", "truth"):
        read[kind] = file_interface.read_tum_trajectory_file(folder / f"walk_{kind}.tum")
        table = np.genfromtxt(folder / f"walk_{kind}.csv", delimiter=",", names=True)
        np.testing.assert_allclose(np.column_stack([table["x"], table["y"], table["z"]]), read[kind].positions_xyz)
        assert f"walk_{kind}.tum" in said
        assert f"walk_{kind}.csv" in said
    t = read["truth"].timestamps
    np.testing.assert_array_equal(read["estimate"].timestamps, t)
    np.testing.assert_allclose(read["truth"].positions_xyz, made_up_place(t), atol=0.05)
    turned = (Rotation.from_quat(read["truth"].orientations_quat_wxyz[:, [1, 2, 3, 0]]).inv() * attitude(t)).magnitude()
    assert turned.max() < np.radians(1.0)
    rmse = [np.sqrt(np.mean((read[k].positions_xyz - made_up_place(t))[len(t) // 3 :] ** 2)) for k in read]
    assert rmse[1] < rmse[0] < 0.05  # the smoother, the estimate


@pytest.mark.long
def test_replay_writes_report_figures_and_json(capsys: pytest.CaptureFixture[str], place: Path, tmp_path: Path) -> None:
    words = ("--map", str(place / "MAP.yaml"), "--out", str(tmp_path / "out"), "--json", str(tmp_path / "r.json"))
    assert run("replay", str(place / "walk"), *words) == 0
    said = capsys.readouterr().out
    text = (tmp_path / "out/recorded.md").read_text(encoding="utf-8")
    assert text.startswith("# Recorded motions\n\n## In short\n\n- walk: RMS error in x, y, z 0.0")
    assert "Made by `ortilo replay" in text
    assert "| with IMU, smoothed |" in said
    assert (tmp_path / "out/walk.png").read_bytes()[1:4] == b"PNG"
    check_trajectories(tmp_path / "out", said)
    found = json.loads((tmp_path / "r.json").read_text(encoding="utf-8"))
    assert found["map"]["imu"]["axes"] == "flu"
    motion = found["motions"][0]
    assert set(motion["rows"]["with IMU"]) >= {"rmse", "ate", "rpe", "nees", "nis", "available"}
    assert motion["told_by"] == "rates"
    assert motion["rejected"] == {}


@pytest.mark.long
def test_replay_without_truth_or_imu(capsys: pytest.CaptureFixture[str], place: Path, tmp_path: Path) -> None:
    map_file = tmp_path / "bare.yaml"
    map_file.write_text(TABLE_MAP[: TABLE_MAP.index("imu:")])
    assert run("replay", str(place / "walk"), "--map", str(map_file), "--out", str(tmp_path)) == 0
    assert "walk: no truth; NIS" in capsys.readouterr().out
    map_file.write_text(TABLE_MAP.replace("imu:", "#"))
    assert run("replay", str(place / "walk"), "--map", str(map_file), "--out", str(tmp_path)) == 0
    said = capsys.readouterr().out
    assert "(constant velocity, after the first 30%, which calibrated it)" in said
    assert "by the ranges" in said


@pytest.mark.long
def test_tune_writes_a_map_that_replays(capsys: pytest.CaptureFixture[str], place: Path, tmp_path: Path) -> None:
    tuned = tmp_path / "tuned.yaml"
    words = ("--map", str(place / "MAP.yaml"), "--out", str(tuned), "--json", str(tmp_path / "t.json"))
    code = run("tune", str(place / "walk"), *words)
    said = capsys.readouterr().out
    assert "walk, fitted by innovations to the first parts" in said
    fitted = json.loads((tmp_path / "t.json").read_text(encoding="utf-8"))
    assert code == (0 if fitted["verdict"] == "better" else 3)
    assert "s that were not fitted, before -> after" in said
    assert fitted["after"] > fitted["before"]
    assert load_map(tuned).filter.range_white == fitted["settings"]["range_white"]
    assert load_map(tuned).ranges == load_map(place / "MAP.yaml").ranges


@pytest.mark.long
def test_tune_names_an_anchor_that_is_off_and_does_not_say_better(capsys, place: Path, tmp_path: Path) -> None:
    """As far off as replay tells, with the truth and without; noise that is fitted to it would hide it."""
    text = load_map(place / "MAP.yaml").anchors
    moved = [list(p) for p in text]
    moved[0][0] += 0.7
    own = next(line for line in TABLE_MAP.splitlines() if line.startswith("anchors:"))
    wrong = TABLE_MAP.replace(own, f"anchors: {moved}")
    for name, map_text in (("truth", wrong), ("none", wrong[: wrong.index("truth:")])):
        (tmp_path / f"{name}.yaml").write_text(map_text)
        assert run("tune", str(place / "walk"), "--map", str(tmp_path / f"{name}.yaml")) == 3
        said = capsys.readouterr()
        assert "mend these first" in said.out
        assert "walk: anchors: entry 1 at about [0, 0, 0.2], not [0.7, 0, 0.2]," in said.err
        assert "better" not in said.out.replace("would fit better", "")


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (("replay", "WALK", "WALK"), "LOG: 2 given: must be one log, or recordings with --map"),
        (("replay", "WALK", "WALK", "--map", "MAP"), "folders must have different names"),
        (("replay", "WALK/no", "--map", "MAP"), "no such file or folder"),
        (("replay", "WALK", "--map", "WALK/none.yaml"), "cannot be read: No such file"),
        (("replay", "WALK", "--map", "WALK/imu.csv"), "imu.csv"),
        (("tune", "WALK", "--map", "MAP", "--check", "3"), "--figure, --check: cannot be combined with --map"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(capsys: pytest.CaptureFixture[str], place: Path, words, line) -> None:
    said = [w.replace("WALK", str(place / "walk")).replace("MAP", str(place / "MAP.yaml")) for w in words]
    assert run(*said) == 2
    error = capsys.readouterr().err
    assert line in error
    assert error.count("\n") == 1
