"""Bad input to `ortilo room`: one line that names it, exit code 2, nothing written."""

import re
from pathlib import Path

import pytest
from command_line import run

from ortilo_drake.studies.rooms.new_room import new_room

COMMANDS = ("check", "show", "coverage")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "hall.yaml").write_text(new_room("hall", (8.0, 6.0, 3.0), 5))
    (tmp_path / "text.yaml").write_text("interior: [")
    (tmp_path / "bytes.yaml").write_bytes(b"\xff\xfe\x00")
    for folder in ("folder.yaml", "folder.png"):
        (tmp_path / folder).mkdir()
    (tmp_path / "no_way.yaml").write_text(
        new_room("hall", (8.0, 6.0, 3.0), 5).replace("walls: []", "walls: [[3.5, 3.0, 1.5708, 6, 0.1, 3]]")
    )
    (tmp_path / "nameless.yaml").write_text(re.sub("(start|goal): .*", "", new_room("hall", (8.0, 6.0, 3.0), 5)))
    return tmp_path


@pytest.mark.parametrize(
    ("words", "named"),
    [
        *[(f"{command} {file}", file) for command in COMMANDS for file in ("none.yaml", "text.yaml", "bytes.yaml")],
        *[(f"{command} folder.yaml", "folder.yaml: cannot be read") for command in COMMANDS],
        ("coverage no_such_scenario", "no_such_scenario"),
        ("coverage no_way.yaml", "planner.goal"),
        ("coverage nameless.yaml", "planner"),
        ("coverage hall.yaml --set planner.goal=[1,99]", "planner.goal"),
        ("coverage hall.yaml --set uwb.max=3", "uwb.max"),
        ("coverage hall.yaml --png map.frog", "map.frog"),
        ("coverage hall.yaml --json folder.yaml", "folder.yaml: cannot be written"),
        ("show hall.yaml --png folder.png", "folder.png: cannot be written"),
        ("new hall.yaml", "hall.yaml: exists; --force overwrites it"),
        ("new own.yaml --size 8x6", "--size: '8x6'"),
        ("new own.yaml --anchors 2", "--anchors: 2"),
        ("new own.yaml --anchors two", "--anchors"),
        ("new folder.yaml --force", "folder.yaml: cannot be written"),
        ("trace hall.yaml --scale 50 --out own.yaml", "--scale: 50: must be left out"),
        ("trace none.png --scale 50 --out own.yaml", "none.png: cannot be read"),
        ("trace none.png --scale nan --out own.yaml", "--scale"),
        ("trace none.png --scale 50", "--out"),
        ("trace hall.yaml --out own.yaml", "hall.yaml: image: is missing"),
        ("trace none.png --scale 50 --out hall.yaml", "hall.yaml: exists; --force overwrites it"),
    ],
)
def test_bad_input_is_one_line_and_writes_nothing(
    folder: Path, capsys: pytest.CaptureFixture[str], words: str, named: str
) -> None:
    before = {path: path.stat().st_mtime_ns for path in folder.iterdir()}
    assert run("room", *words.split()) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert named in line
    assert {path: path.stat().st_mtime_ns for path in folder.iterdir()} == before
