"""cached_njit loads compiled code from the disk only if the function, and all that it calls, are as they were."""

import importlib
import sys
from pathlib import Path
from typing import Any

import pytest
from numba import njit

from ortilo_drake.compiled.cached import cached_njit

HEAD = "from ortilo_drake.compiled.cached import cached_njit\n"
HELPER = HEAD + "@cached_njit\ndef scaled(x):\n    return {factor} * x\n"
CALLER = HEAD + "from {package}.helper import scaled\n\n@cached_njit\ndef above(x):\n    return scaled(x) + offset(x)\n"
CALLER += "\n@cached_njit\ndef offset(x):\n    return {offset}\n"
FIRST = HEAD + "@cached_njit\ndef first_of(pair):\n    return pair.a\n"
PAIR = "from typing import NamedTuple\n\nclass Pair(NamedTuple):\n    {}: float\n    {}: float\n"


class Imported:
    """A package that is written, and imported anew as a new process would."""

    def __init__(self, folder: Path, name: str):
        self.folder, self.name = folder / name, name
        self.folder.mkdir()

    def write(self, **modules: str) -> None:
        for module, text in modules.items():
            (self.folder / f"{module}.py").write_text(text)

    def load(self, module: str) -> Any:
        for name in [name for name in sys.modules if name.partition(".")[0] == self.name]:
            del sys.modules[name]
        importlib.invalidate_caches()
        return importlib.import_module(f"{self.name}.{module}")

    def kept(self, function: str) -> list[str]:
        return sorted(file.name for file in (self.folder / "__pycache__").glob(f"*{function}*.nb[ic]"))


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Imported:
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(sys, "dont_write_bytecode", True)  # two changes within a second have one stamp
    return Imported(tmp_path, f"kept_{tmp_path.name}")


def hits(function: Any) -> int:
    return sum(function.stats.cache_hits.values())


def test_a_change_of_what_it_calls_compiles_it_anew(package: Imported) -> None:
    package.write(helper=HELPER.format(factor=2.0), caller=CALLER.format(package=package.name, offset=1.0))
    assert package.load("caller").above(5.0) == 11.0
    above = package.load("caller").above
    assert (above(5.0), hits(above)) == (11.0, 1)  # from the disk
    before = package.kept("above")

    package.write(helper=HELPER.format(factor=3.0))
    above = package.load("caller").above
    assert (above(5.0), hits(above)) == (16.0, 0)

    package.write(caller=CALLER.format(package=package.name, offset=7.0))  # in a function below it
    assert package.load("caller").above(5.0) == 22.0
    assert len(package.kept("above")) == len(before) == 2  # one index and its code: the old ones are gone
    assert not {*package.kept("above")} & {*before}


def test_another_line_and_time_of_a_file_compile_nothing(package: Imported) -> None:
    package.write(helper=HELPER.format(factor=2.0))
    package.load("helper").scaled(1.0)
    package.write(helper="# One line more.\n" + HELPER.format(factor=2.0))
    scaled = package.load("helper").scaled
    assert (scaled(1.0), hits(scaled)) == (2.0, 1)


def test_two_orders_of_the_same_fields_are_two_forms(package: Imported) -> None:
    package.write(
        first=FIRST, pair="from typing import NamedTuple\nclass Pair(NamedTuple):\n    a: float\n    b: float\n"
    )
    assert package.load("first").first_of(package.load("pair").Pair(1.0, 2.0)) == 1.0
    package.write(pair=PAIR.format("b", "a"))
    first_of = package.load("first").first_of
    assert first_of(importlib.import_module(f"{package.name}.pair").Pair(1.0, 2.0)) == 2.0


def test_code_for_a_class_that_has_moved_is_no_error(package: Imported) -> None:
    package.write(first=FIRST, pair=PAIR.format("a", "b"))
    assert package.load("first").first_of(package.load("pair").Pair(1.0, 2.0)) == 1.0
    package.write(other=PAIR.format("a", "b"))
    (package.folder / "pair.py").unlink()
    assert package.load("first").first_of(package.load("other").Pair(3.0, 2.0)) == 3.0


def test_it_is_njit() -> None:
    @cached_njit(error_model="numpy")
    def divided(x: float) -> float:
        return 1.0 / x

    assert divided(0.0) == njit(error_model="numpy")(divided.py_func)(0.0) == float("inf")
    assert divided.targetoptions["error_model"] == "numpy"
