"""What numba has compiled is kept: a process that flies compiles nothing that another one had compiled."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from command_line import run

from ortilo_drake.commands.terminal import say_if_compiling

FLY = ("fly", "nominal_imu_uwb_yolo", "--camera", "projected", "--set", "planner={kind: hover, duration: 0.5}")
FLOWN = (FLY, (*FLY, "--set", "estimator.force=measured", "--set", "estimator.delay=replay"))
PROGRAM = f"""
from command_line import run
for words in {FLOWN!r}:
    assert run(*words) == 0
"""


@pytest.mark.processes
def test_a_second_process_compiles_nothing() -> None:
    for words in FLOWN:
        assert run(*words) == 0
    environment = os.environ | {"NUMBA_DEBUG_CACHE": "1", "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    second = subprocess.run(
        [sys.executable, "-c", PROGRAM], env=environment, capture_output=True, text=True, check=True
    )
    assert "loaded from" in second.stdout
    assert [line for line in second.stdout.splitlines() if "data saved" in line] == []


def test_the_user_is_told_of_compiling_only_while_nothing_compiled_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    say_if_compiling()
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("compiling, only this once")
    (tmp_path / "filter_1").mkdir()
    (tmp_path / "filter_1" / "step-1.py311.nbi").touch()
    say_if_compiling()
    assert capsys.readouterr().err == ""
