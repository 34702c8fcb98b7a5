"""What a compiled function is made of decides its name: a change of anything that it calls is noticed."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numba import njit
from small_loop import boxes, mass_step, sensor_out

from ortilo_drake.compiled.digest import digest_of, modules_of
from ortilo_drake.loop.native import native_of

HELPER = "def twice(x):\n    return {factor} * x\n"
CALLER = "from helper_of_{name} import twice\n\ndef f(x, out):\n"
CALLER += "    '{comment}'\n    # {comment}\n    out[0] = twice(x[0])\n"


def module(folder: Path, name: str, text: str) -> ModuleType:
    file = folder / f"{name}.py"
    file.write_text(text)
    spec = importlib.util.spec_from_file_location(name, file)
    assert spec is not None
    assert spec.loader is not None
    found = importlib.util.module_from_spec(spec)
    sys.modules[name] = found
    spec.loader.exec_module(found)
    return found


def digest_with(folder: Path, name: str, factor: str, comment: str) -> str:
    folder.mkdir(exist_ok=True)
    module(folder, f"helper_of_{name}", HELPER.format(factor=factor))
    return digest_of(module(folder, f"caller_{name}", CALLER.format(name=name, comment=comment)).f)


def test_a_changed_callee_changes_it_and_a_comment_or_docstring_does_not(tmp_path: Path) -> None:
    first = digest_with(tmp_path / "a", "x", "2.0", "once")
    assert digest_with(tmp_path / "b", "x", "2.0", "twice") == first
    assert digest_with(tmp_path / "c", "x", "3.0", "once") != first


def test_values_change_it() -> None:
    assert digest_of(mass_step) == digest_of(mass_step)
    assert len({digest_of(mass_step), digest_of(sensor_out), digest_of(mass_step, "v"), digest_of(np.zeros(2))}) == 4


def test_an_elements_functions_are_compiled_once_and_can_be_found() -> None:
    mass = next(box.element for box in boxes() if box.name == "mass")
    native = native_of(mass)
    assert native_of(mass) is native
    assert native["step"].symbol.startswith("ortilo_mass_")
    assert native["step"].address > 0
    assert native["step"].arguments == 5  # the record; x and u, each with its size


def test_the_modules_are_those_of_all_that_a_function_calls() -> None:
    elsewhere: dict[str, Any] = {"__name__": "nobodys_module"}
    exec("def called(x):\n    return x\n", elsewhere)
    called = njit(elsewhere["called"])

    def calls(x: float) -> float:
        return float(np.sqrt(called(x)))

    assert modules_of(calls) == {__name__, "nobodys_module"}
