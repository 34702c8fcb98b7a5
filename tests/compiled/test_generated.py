"""Generated files stay as long as they are asked for, with what is compiled of them, and no longer."""

import os
import time
from pathlib import Path

import numpy as np
import pytest
from numba import njit

from ortilo_drake.compiled import generated
from ortilo_drake.compiled.generated import clear, load

TEXT = """from numba import njit

@njit(cache=True)
def twice(x):
    return 2.0 * x
"""
DAY = 86400.0


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(generated, "generated_folder", lambda: tmp_path / "generated")
    return tmp_path / "generated"


def asked_for(file: Path, days_ago: float) -> None:
    os.utime(file, (time.time() - days_ago * DAY, file.stat().st_mtime))


def write(folder: Path, name: str, days_ago: float) -> None:
    (folder / "__pycache__").mkdir(parents=True, exist_ok=True)
    (folder / f"{name}.py").write_text("")
    for end in ("fly-1.py311.nbi", "fly-1.py311.1.nbc"):
        (folder / "__pycache__" / f"{name}.{end}").write_text("")
    asked_for(folder / f"{name}.py", days_ago)


def names(folder: Path) -> set[str]:
    return {file.name.partition(".")[0] for file in folder.rglob("*") if file.is_file()}


def test_what_nobody_asks_for_goes_with_what_is_compiled_of_it(tmp_path: Path) -> None:
    folder = tmp_path / "generated"
    for name, days in (("old", 31.0), ("older", 300.0), ("young", 29.0)):
        write(folder, name, days)
    other = tmp_path / "generated_0123"  # where NUMBA_CACHE_DIR has numba keep it
    other.mkdir()
    (other / "old.fly-1.py311.nbi").write_text("")
    clear(folder)
    assert names(folder) == {"young"}
    assert len(list(folder.rglob("*.*"))) == 3
    assert not list(other.iterdir())


def test_of_too_many_those_stay_that_were_asked_for_last(tmp_path: Path) -> None:
    folder = tmp_path / "generated"
    for i in range(5):
        write(folder, f"file_{i}", float(i))
    clear(folder, most=2)
    assert names(folder) == {"file_0", "file_1"}


def test_what_goes_under_another_process_s_hands_is_no_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "generated"
    write(folder, "old", 31.0)
    unlink = Path.unlink

    def gone(file: Path) -> None:
        unlink(file)
        raise FileNotFoundError(file)

    monkeypatch.setattr(Path, "unlink", gone)
    clear(folder)
    assert not names(folder)
    clear(folder / "nowhere")


def test_a_file_that_is_loaded_is_marked_and_what_is_compiled_of_it_holds(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    name = f"twice_{time.time_ns()}"
    assert load(name, TEXT, {"np": np, "njit": njit}).twice(3.0) == 6.0
    file = folder / f"{name}.py"
    asked_for(file, 40.0)
    changed = file.stat().st_mtime_ns
    monkeypatch.delitem(generated.sys.modules, f"ortilo_generated.{name}")
    again = load(name, TEXT, {})
    assert again.twice(3.0) == 6.0
    assert sum(again.twice.stats.cache_hits.values()) == 1  # numba takes it from the disk
    assert time.time() - file.stat().st_atime < DAY
    assert file.stat().st_mtime_ns == changed
    load(f"{name}_other", TEXT, {})
    assert file.exists()
