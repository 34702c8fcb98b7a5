"""Rules of the house that a machine can hold: layers, docstrings, and plain forms of the compiled equations."""

import ast
import importlib.util
import pkgutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest
from numba.core.dispatcher import Dispatcher

import ortilo_drake
from ortilo_drake.model.equations import DYNAMICS

PROJECT = Path(__file__).resolve().parents[1]
GENERATED = "ortilo_drake.hil.lcmtypes.ortilo."  # lcm-gen writes no docstrings
NAMES = sorted(
    module.name
    for module in pkgutil.walk_packages(ortilo_drake.__path__, "ortilo_drake.")
    if not module.name.startswith(GENERATED)
)


def source_of(name: str) -> ast.Module:
    path = importlib.util.find_spec(name).origin
    return ast.parse(Path(path).read_text(encoding="utf-8"))


def test_imports_go_one_way() -> None:
    command = [sys.executable, "-c", "from importlinter.cli import lint_imports_command as c; c()", "--no-cache"]
    done = subprocess.run(command, cwd=PROJECT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert " 0 broken" in done.stdout


def test_onboard_never_names_the_world() -> None:
    for name in NAMES:
        if not name.startswith("ortilo_drake.onboard"):
            continue
        for node in ast.walk(source_of(name)):
            modules = (
                [node.module or ""]
                if isinstance(node, ast.ImportFrom)
                else [alias.name for alias in node.names]
                if isinstance(node, ast.Import)
                else []
            )
            assert not any(module.startswith("ortilo_drake.world") for module in modules), name


def undocumented(tree: ast.Module) -> list[str]:
    """Public modules, classes, functions and methods without a docstring.

    Drake's overridden virtuals (DoXxx) and the scalar-typed class inside a TemplateSystem are Drake's to explain.
    """
    missing = [] if ast.get_docstring(tree) else ["the module"]

    def look(nodes: list[ast.stmt], prefix: str) -> None:
        for node in nodes:
            if not isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
                continue
            if node.name.startswith("_") or node.name.startswith("Do"):
                continue
            if not ast.get_docstring(node):
                missing.append(prefix + node.name)
            if isinstance(node, ast.ClassDef):
                look(node.body, f"{prefix}{node.name}.")

    look(tree.body, "")
    return missing


@pytest.mark.parametrize("name", ["ortilo_drake", *NAMES])
def test_everything_public_is_documented(name: str) -> None:
    assert undocumented(source_of(name)) == []


def test_the_look_for_docstrings_finds_what_is_missing() -> None:
    tree = ast.parse(
        '"""A module."""\ndef f(): pass\nclass A:\n    """A."""\n    def g(self): pass\n    def _h(self): pass\n'
    )
    assert undocumented(tree) == ["f", "A.g"]


def compiled_in(module: ModuleType) -> dict[str, Dispatcher]:
    return {
        key: value
        for key, value in vars(module).items()
        if isinstance(value, Dispatcher) and value.py_func.__module__ == module.__name__
    }


def test_every_compiled_function_has_its_plain_form() -> None:
    found = 0
    for name in NAMES:
        for key, compiled in compiled_in(importlib.import_module(name)).items():
            assert compiled.py_func.__doc__, f"{name}.{key}"
            assert not isinstance(compiled.py_func, Dispatcher)
            assert compiled.targetoptions["nopython"]
            found += 1
    assert found >= 20


def test_the_equations_of_motion_are_compiled() -> None:
    for dynamics in DYNAMICS.values():
        assert isinstance(dynamics, Dispatcher)
        assert callable(dynamics.py_func)
