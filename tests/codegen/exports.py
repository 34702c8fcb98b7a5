"""What the tests of exports have in common: a short flight, programs that they need, and the golden test."""

import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from ortilo_drake.codegen.exported_half import build, emulated, programs_of

SHORT = "planner={kind: waypoints, points: [[0, 0, 1.5], [0.3, 0.2, 1.5]]}"
Exported = Callable[..., Path]


def needs(*programs: str) -> None:
    missing = [program for program in programs if shutil.which(program) is None]
    if missing:
        pytest.skip(f"{', '.join(missing)}: not installed (make setup EXPORT=1 YES=1)")


def do(*command: object, folder: Path) -> str:
    done = subprocess.run([*map(str, command)], cwd=folder, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def golden(folder: Path, target: str, made: Path) -> list[str]:
    """Build test_golden of an export for its target; return the command that runs it."""
    needs(*programs_of(target))
    build(folder, target, folder / "test_golden.c", made / "golden")
    return emulated(target, made / "golden", "-nographic")
